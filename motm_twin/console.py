"""Where tables are printed: as wide as the terminal, and as wide as they need in a pipe or a file."""

import os
import sys

from rich.console import Console

_NEEDED = 200  # columns: no table of ours is wider


def table_console() -> Console:
    """Standard output; rich takes 80 columns for what is no terminal, and cuts the cells."""
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    return Console(highlight=False, soft_wrap=True, width=None if known else _NEEDED)
