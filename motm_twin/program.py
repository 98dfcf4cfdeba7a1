"""Parts of every program: exit codes, output to a terminal and to files, one-line errors, memory of servers."""

import contextlib
import ctypes
import gc
import json
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.text import Text

OK = 0
FAILED = 1  # it ran, but did not succeed
BAD_INPUT = 2  # the user can correct it
INTERRUPTED = 130  # Ctrl-C
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # of numeric libraries


_NEEDED = 200  # columns: no table of ours is wider
_KEPT = "\n\t"


def printable(text: str) -> str:
    """The text with question marks for unprintable characters, such as controls and changes of writing direction."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c in _KEPT else "?" for c in text)


class PlainConsole(Console):
    """A console that prints only printable characters."""

    def on_broken_pipe(self) -> None:
        """Raise the error of a closed output for the caller to handle."""
        raise  # noqa: PLE0704

    def render_str(self, text: str, **options: Any) -> Text:
        """Render markup as rich does, with only printable characters."""
        return super().render_str(printable(text), **options)


def plain_console(*, stderr: bool = False) -> PlainConsole:
    """A console on standard output or standard error that never breaks lines."""
    return PlainConsole(stderr=stderr, highlight=False, soft_wrap=True)


def table_console() -> PlainConsole:
    """A console on standard output for tables: without a terminal, rich would assume 80 columns and cut the cells."""
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    return PlainConsole(highlight=False, soft_wrap=True, width=None if known else _NEEDED)


STANDARD_OUTPUT = "-"


def refuse_unwritable(*files: str | Path | None) -> None:
    """Raise SessionError for a file that cannot be created, or that is a folder. None and standard output pass."""
    from motm_twin.sessions.session import SessionError

    for file in files:
        if file is None or file == STANDARD_OUTPUT:
            continue
        if not Path(file).parent.is_dir() or Path(file).is_dir():
            raise SessionError("cannot be written: give a file in a folder that exists", file=str(file))
        if not Path(file).exists() and (problem := folder_problem(Path(file).parent)):
            raise SessionError(problem, file=str(file))


def refuse_existing(file: str | Path | None) -> None:
    """Raise SessionError for a file that exists; None passes."""
    from motm_twin.sessions.session import SessionError

    if file is not None and Path(file).exists():
        raise SessionError("exists already: choose another name, or remove it", file=str(file))


def folder_problem(folder: Path) -> str:
    """Reason why a folder, which need not exist yet, cannot be written to; "" when it can."""
    there = folder
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not there.is_dir():
            return f"{there} is a file: give a folder"
        with tempfile.TemporaryFile(dir=there):  # tested by writing: root has the right to write to /proc, but cannot
            return ""
    except OSError:
        return f"{there} cannot be written to: give another folder"


def kernel_problem() -> str:
    """Reason why Numba finds no folder for compiled kernels, and the cure; "" when it finds one.

    Without one, modules with kernels cannot be imported.
    """
    from numba import njit

    try:
        njit(cache=True)(folder_problem)  # any function: nothing is compiled before the first call
    except RuntimeError:
        package = Path(__file__).parent
        return (
            f"there is no folder for compiled kernels: neither {package} nor your home can be written to. "
            "Set NUMBA_CACHE_DIR to a folder of yours"
        )
    return ""


def write_json(report: dict[str, Any], target: str) -> None:
    """Write a report to a file, or to standard output with '-'. Raises SessionError when it cannot be written."""
    from motm_twin.sessions.session import SessionError

    text = json.dumps(report, indent=2)
    if target == STANDARD_OUTPUT:
        print(text)
        return
    try:
        Path(target).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise SessionError(f"cannot be written: {error.strerror or error}", file=target) from error


ARENAS = 2  # of the C library, for all threads
_M_ARENA_MAX = -8  # of glibc's malloc.h

_frozen = False


def freeze_setup() -> None:
    """Exclude everything that exists now from later garbage collections; only the first call has an effect.

    A full collection goes through all modules and kernels: 40 ms of a period of 50 ms. Objects set up for a run are
    freed as usual when unreferenced, except for cycles among objects that existed at the first call.
    """
    global _frozen  # noqa: PLW0603 - once per process
    if not _frozen:
        _frozen = True
        gc.collect()
        gc.freeze()


def share_arenas() -> None:
    """Let all threads allocate from `ARENAS` arenas if the C library is glibc; call it before they start.

    By default glibc gives each thread an arena, up to eight per core, and each keeps its thread's peak: after 1,000
    clients had come and gone, a server was 5.7 MB larger than before; with two arenas it is 3.3 MB.
    """
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).mallopt(_M_ARENA_MAX, ARENAS)


def give_back() -> None:
    """Collect unreferenced cycles, and return free memory to the system if the C library is glibc.

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
