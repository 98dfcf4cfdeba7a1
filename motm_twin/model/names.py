"""Names that users wrote: hints at near ones, and the error of a wrong method."""

import difflib
from collections.abc import Iterable

LOOKED_AT = 64  # characters of the wrong name; longer ones are compared slowly, and are no slip of the pen


def hint(wrong: str, names: Iterable[str]) -> str:
    """The names that were probably meant, as a question; when none is near, all that there are."""
    known = list(names)
    near = difflib.get_close_matches(wrong[:LOOKED_AT], known, 3)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"there are: {', '.join(known) or 'none'}"


class MethodError(ValueError):
    """A method that cannot be used; ``str()`` of it is one line for the person who named it."""
