"""Files and folders that commands write to: one that cannot be written is refused before the command runs."""

import json
import tempfile
from pathlib import Path
from typing import Any

from numba import njit

from motm_twin.sessions.session import SessionError

STANDARD_OUTPUT = "-"


def refuse_unwritable(*files: str | Path | None) -> None:
    """Raise SessionError for a file that cannot be made where it should be, or that is a folder.

    None and standard output are always possible.
    """
    for file in files:
        if file is None or file == STANDARD_OUTPUT:
            continue
        if not Path(file).parent.is_dir() or Path(file).is_dir():
            raise SessionError("cannot be written: give a file in a folder that exists", file=str(file))
        if not Path(file).exists() and (problem := folder_problem(Path(file).parent)):
            raise SessionError(problem, file=str(file))


def refuse_existing(file: str | Path | None) -> None:
    """Raise SessionError for a file that exists; None passes."""
    if file is not None and Path(file).exists():
        raise SessionError("exists already: choose another name, or remove it", file=str(file))


def folder_problem(folder: Path) -> str:
    """Reason why a folder, which need not exist yet, cannot be written to; "" when it can."""
    there = folder
    try:
        there = next(path for path in (folder, *folder.absolute().parents) if path.exists())
        if not there.is_dir():
            return f"{there} is a file: give a folder"
        with tempfile.TemporaryFile(dir=there):  # tried: root has the right to write to /proc, but cannot
            return ""
    except OSError:
        return f"{there} cannot be written to: give another folder"


def kernel_problem() -> str:
    """Reason why Numba finds no folder for compiled kernels, and the cure; "" when it finds one.

    Without one, modules with kernels cannot be imported.
    """
    try:
        njit(cache=True)(folder_problem)  # any function: nothing is compiled before the first call
    except RuntimeError:
        package = Path(__file__).parents[1]
        return (
            f"there is no folder for compiled kernels: neither {package} nor your home can be written to. "
            "Set NUMBA_CACHE_DIR to a folder of yours"
        )
    return ""


def write_json(report: dict[str, Any], target: str) -> None:
    """Write a report to a file, or to standard output with '-'. Raises SessionError when it cannot be written."""
    text = json.dumps(report, indent=2)
    if target == STANDARD_OUTPUT:
        print(text)
        return
    try:
        Path(target).write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise SessionError(f"cannot be written: {error.strerror or error}", file=target) from error
