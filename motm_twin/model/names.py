"""Names in user input: hints at similar ones, and the refusal of a scene or method."""

import difflib
from collections.abc import Iterable

SHOWN = 30  # names of a list that are shown
LOOKED_AT = 64  # characters: longer wrong names are not compared, which is slow; they are no typos


def hint(wrong: str, names: Iterable[str]) -> str:
    """The names that were probably meant, as a question; all names, or the first `SHOWN`, when none is similar."""
    known = list(names)
    lower = {name.lower(): name for name in known}
    near = [lower[name] for name in difflib.get_close_matches(wrong[:LOOKED_AT].lower(), list(lower), 3)]
    if near:
        return f"did you mean {' or '.join(near)}?"
    return f"there are: {', '.join(known[:SHOWN]) or 'none'}{', ...' if len(known) > SHOWN else ''}"


class MethodError(ValueError):
    """A method that cannot be used; ``str()`` of it is one line for the person who named it."""


def scene_name(scene: str, variant: str | None) -> str:
    """Name of a scene to be shown, with its variant where it has one."""
    return f"{scene} / {variant}" if variant else scene


class SceneError(ValueError):
    """A scene cannot be used; ``str()`` of it is one line for the person who wrote the file."""

    def __init__(self, problem: str, *, file: str = "", line: int | None = None, place: str = "") -> None:
        self.problem, self.file, self.line, self.place = problem, file, line, place
        where = file if line is None else f"{file}:{line}"
        text = ": ".join(part for part in (where, place, problem) if part)
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in text))
