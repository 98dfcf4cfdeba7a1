"""Refusal of a scene file: a single message with file, line, place and what to do."""

import difflib
from collections.abc import Iterable


class SceneError(ValueError):
    """A scene cannot be used; ``str()`` of it is one line for the person who wrote the file."""

    def __init__(self, problem: str, *, file: str = "", line: int | None = None, place: str = "") -> None:
        self.problem, self.file, self.line, self.place = problem, file, line, place
        where = file if line is None else f"{file}:{line}"
        text = ": ".join(part for part in (where, place, problem) if part)
        super().__init__("".join(letter if letter.isprintable() else "?" for letter in text))


def near(wrong: str, allowed: Iterable[str]) -> str:
    """A hint for a wrong name: the nearest allowed names first, else all of them (at most 20)."""
    names = list(allowed)
    if not names:
        return "there are none"
    lower = {name.lower(): name for name in names}
    close = [lower[name] for name in difflib.get_close_matches(wrong[:60].lower(), list(lower), n=3, cutoff=0.6)]
    if close:
        return "did you mean " + " or ".join(close) + "?"
    shown = ", ".join(names[:20])
    return f"allowed: {shown}" + (", ..." if len(names) > 20 else "")
