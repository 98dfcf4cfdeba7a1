"""motm_twin: a web-served digital twin of reactive manipulation on the move.

    import motm_twin

    result = motm_twin.run("exp1", seed=3)
    print(result.time_s, result.contacts)
    result.plot("speed.png")

`run` runs one headless trial; `load_scene` loads and checks a `Scene`; `Twin` runs the same loop period by period;
`connect` returns a client of a running twin; `methods` lists the methods. Only these names and `Result` are stable.
"""

import hashlib
import importlib
import os
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from motm_twin.processes import starting

if TYPE_CHECKING:
    from motm_twin import methods
    from motm_twin.client import connect
    from motm_twin.model.scene import Scene
    from motm_twin.model.scene_file import load_scene
    from motm_twin.trial import Result, run
    from motm_twin.twin import Twin

__version__ = "0.1.0"
__all__ = ["Result", "Scene", "Twin", "connect", "load_scene", "methods", "run"]

_HOMES = {  # imported by `__getattr__`
    "Result": "trial",
    "Scene": "model.scene",
    "Twin": "twin",
    "connect": "client",
    "load_scene": "model.scene_file",
    "run": "trial",
}


def drop_stale_kernels(package: Path) -> int:
    """Delete compiled kernels of a folder that are older than the newest source with kernels; returns their number.

    They are beside the sources, or in folders of ``NUMBA_CACHE_DIR`` with names that numba makes.

    Numba recompiles a kernel when its own file has changed, but not when a kernel that it calls has: after a `git pull`
    or an edit a run would mix old and new kernels. Called when the package is imported, before any kernel is loaded. A
    read-only installation is not touched: its sources do not change either.
    """
    sources = {index: folder / f"{index.name.partition('.')[0]}.py" for folder, index in _compiled(package)}
    newest = max((source.stat().st_mtime_ns for source in set(sources.values()) if source.exists()), default=0)
    dropped = 0
    for index in sources:
        try:
            if index.stat().st_mtime_ns < newest:
                index.unlink()
                dropped += 1
        except OSError:  # another process was faster, or the installation is read-only
            continue
    return dropped


def _compiled(package: Path) -> Iterator[tuple[Path, Path]]:
    """Pairs of a source folder and numba's index file of a cached kernel from it."""
    elsewhere = os.environ.get("NUMBA_CACHE_DIR")
    for folder in package.absolute().glob("**/"):
        places = {folder / "__pycache__"}
        if elsewhere:
            digest = hashlib.sha1(str(folder).encode(), usedforsecurity=False).hexdigest()
            places.add(Path(elsewhere) / f"{folder.name}_{digest}")
        yield from ((folder, index) for place in places for index in place.glob("*.nbi"))


if Path(sys.argv[0]).name == "motm-twin" or sys.orig_argv[1:3] == ["-m", "motm_twin"]:
    starting()  # as early as possible: our command line is being loaded

drop_stale_kernels(Path(__file__).parent)


def __getattr__(name: str) -> Any:
    """Import a public name when it is first used: some of them take seconds."""
    if name == "methods":
        return importlib.import_module("motm_twin.methods")
    if name not in _HOMES:
        raise AttributeError(f"module 'motm_twin' has no attribute {name!r}; it offers {', '.join(__all__)}")
    value = getattr(importlib.import_module(f"motm_twin.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
