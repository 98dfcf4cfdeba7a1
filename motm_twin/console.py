"""Output to a terminal: as wide as it needs, and without control characters of files and of other programs."""

import os
import sys
from typing import Any

from rich.console import Console
from rich.text import Text

_NEEDED = 200  # columns: no table of ours is wider
_KEPT = "\n\t"


def printable(text: str) -> str:
    """The text with a question mark for all that a terminal might obey, and for what turns the direction of writing."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c in _KEPT else "?" for c in text)


class PlainConsole(Console):
    """Prints nothing that is not printable, whoever wrote it."""

    def on_broken_pipe(self) -> None:
        """Nobody reads this any more: whoever prints decides what that means. Called where the exception is handled."""
        raise  # noqa: PLE0704

    def render_str(self, text: str, **options: Any) -> Text:
        """As of rich."""
        return super().render_str(printable(text), **options)


def plain_console(*, stderr: bool = False) -> PlainConsole:
    """Standard output, or standard error, for lines that are never broken."""
    return PlainConsole(stderr=stderr, highlight=False, soft_wrap=True)


def table_console() -> PlainConsole:
    """Standard output; rich takes 80 columns for what is no terminal, and cuts the cells."""
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    return PlainConsole(highlight=False, soft_wrap=True, width=None if known else _NEEDED)
