"""Parts of every program: exit codes, output to a terminal, one-line errors, memory of long-lived processes."""

import contextlib
import ctypes
import gc
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.text import Text

OK = 0
FAILED = 1  # it ran, but did not succeed
BAD_INPUT = 2  # the user can correct it
INTERRUPTED = 130  # Ctrl-C
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # that numeric libraries compute in


_NEEDED = 200  # columns: no table of ours is wider
_KEPT = "\n\t"


def printable(text: str) -> str:
    """The text with question marks for control characters and those that turn the direction of writing."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c in _KEPT else "?" for c in text)


class PlainConsole(Console):
    """A console that prints only printable characters."""

    def on_broken_pipe(self) -> None:
        """Raise on a closed output, for the caller to handle."""
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


ARENAS = 2  # of the C library, for all threads
_M_ARENA_MAX = -8  # of glibc's malloc.h

_frozen = False


def freeze_setup() -> None:
    """Exclude everything that exists now from later garbage collections; only the first call has an effect.

    A full collection goes through all modules and kernels: 40 ms of a period of 50 ms. What was set up for a run is
    freed as usual when unreferenced, except for cycles in what exists at the first call.
    """
    global _frozen  # noqa: PLW0603 - once per process
    if not _frozen:
        _frozen = True
        gc.collect()
        gc.freeze()


def share_arenas() -> None:
    """Let all threads allocate from `ARENAS` arenas, where the C library is glibc; call it before they start.

    By default glibc gives each thread one, up to eight per core, and each keeps its thread's peak: a
    server that 1,000 clients had come to and left was 5.7 MB larger than before; with two arenas it is 3.3 MB.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, ARENAS)


def give_back() -> None:
    """Collect what is left in cycles, and hand free memory back to the system, where the C library is glibc.

    By default glibc keeps free memory between used pieces: 100 pages that came and went left 46 MB.
    """
    gc.collect()
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)


@contextmanager
def clean_exit() -> Iterator[None]:
    """Decorator of a program's ``main``, ``@clean_exit()``: errors that its user can fix end it with one line.

    These are a scene, method or configuration that cannot be used, a twin that is absent, refuses or does not answer in
    time (exit code 2), and Ctrl-C (130). Every other exception passes, with its traceback.
    """
    from motm_twin.bus.commands import Refused
    from motm_twin.bus.connection import ConfigError
    from motm_twin.client.discover import NoTwin
    from motm_twin.model.names import MethodError, SceneError

    try:
        yield
    except (SceneError, MethodError, ConfigError, NoTwin, Refused, TimeoutError) as error:
        print(error, file=sys.stderr)
        sys.exit(BAD_INPUT)
    except KeyboardInterrupt:
        print("stopped", file=sys.stderr)
        sys.exit(INTERRUPTED)
