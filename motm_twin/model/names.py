"""Names in user input: hints at similar ones, and the error of an unknown method."""

import difflib
from collections.abc import Iterable

LOOKED_AT = 64  # characters of a wrong name that is compared; longer ones are slow to compare, and no typos


def hint(wrong: str, names: Iterable[str]) -> str:
    """The names that were probably meant, as a question; all names when none is similar."""
    known = list(names)
    near = difflib.get_close_matches(wrong[:LOOKED_AT], known, 3)
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"there are: {', '.join(known) or 'none'}"


class MethodError(ValueError):
    """A method that cannot be used; ``str()`` of it is one line for the person who named it."""


def scene_name(scene: str, variant: str | None) -> str:
    """Name of a scene to be shown, with its variant where it has one."""
    return f"{scene} / {variant}" if variant else scene
