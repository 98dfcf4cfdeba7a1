"""`motm-twin doctor`: one line for each check of this machine, with a remedy if it fails."""

import ctypes.util
import importlib
import importlib.metadata
import os
import platform
import shutil
import sys
from collections.abc import Callable, Iterator
from enum import StrEnum
from typing import NamedTuple

from motm_twin import __version__
from motm_twin.bus.connection import DEFAULT_PORT, LOOPBACK, require_free_port
from motm_twin.program import FAILED, OK, kernel_problem, table_console

PAGE_PORT = 8080
CHROMIUMS = ("chromium", "chromium-browser", "google-chrome-stable", "google-chrome")
NEEDED = {  # module: distribution
    "numpy": "numpy", "numba": "numba", "pinocchio": "pin", "scipy": "scipy", "shapely": "shapely", "daqp": "daqp",
    "qpsolvers": "qpsolvers", "trimesh": "trimesh", "viser": "viser", "zenoh": "eclipse-zenoh", "mcap": "mcap",
    "matplotlib": "matplotlib",
}  # fmt: skip


class Mark(StrEnum):
    """Grade of a finding."""

    GOOD = "good"
    NOTE = "note"  # something optional is missing
    WRONG = "wrong"


class Finding(NamedTuple):
    """One line; ``cure`` is the remedy."""

    mark: Mark
    text: str
    cure: str = ""


def doctor() -> int:
    """Check this machine: packages, kernels, ports, browser, Zenoh. One line each, with what to do if it fails.

    Exit code 0: everything that the twin needs works; 1: not.
    """
    console, worst = table_console(), OK
    colours = {Mark.GOOD: "green", Mark.NOTE: "yellow", Mark.WRONG: "red"}
    for check in CHECKS:
        for finding in _findings(check):
            console.print(f"[{colours[finding.mark]}]{finding.mark:5}[/]  ", end="")
            console.print(finding.text + (f": {finding.cure}" if finding.cure else ""), markup=False)
            worst = FAILED if finding.mark == Mark.WRONG else worst
    return worst


def _findings(check: Callable[[], Iterator[Finding]]) -> list[Finding]:
    """Findings of one check; an exception is a finding, too, unless `_cache` has reported its cause already."""
    try:
        return list(check())
    except Exception as error:
        if check is not _cache and kernel_problem():
            return []
        return [Finding(Mark.WRONG, f"{check.__name__.strip('_')}: {type(error).__name__}: {error}")]


def _versions() -> Iterator[Finding]:
    python = platform.python_version()
    text = f"motm-twin {__version__}, Python {python}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores"
    old = sys.version_info < (3, 11)
    yield Finding(Mark.WRONG if old else Mark.GOOD, text, "Python 3.11 or newer is needed" if old else "")


def _packages() -> Iterator[Finding]:
    good = []
    for module, name in NEEDED.items():
        try:
            importlib.import_module(module)
            good.append(f"{name} {importlib.metadata.version(name)}")
        except (ImportError, OSError) as error:
            yield Finding(Mark.WRONG, f"{name} cannot be imported ({error})", "run make run, or pip install motm_twin")
    yield Finding(Mark.GOOD, f"packages: {', '.join(good)}")


def _models() -> Iterator[Finding]:
    from motm_twin.model.assets import web_assets_dir
    from motm_twin.model.scene_file import list_scenes

    model = web_assets_dir() / "frankie.urdf"
    if not model.is_file():
        yield Finding(Mark.WRONG, f"{model} is missing", "install again, or restore the folder web_assets")
    yield Finding(Mark.GOOD, f"{len(list_scenes())} shipped scenes, robot model in {model.parent}")


def _cache() -> Iterator[Finding]:
    if problem := kernel_problem():
        yield Finding(Mark.WRONG, problem)


def _kernels() -> Iterator[Finding]:
    from motm_twin.planning.staa import run_search
    from motm_twin.warm_up import is_warm

    where = run_search.stats.cache_path
    if not os.access(where, os.W_OK):
        yield Finding(
            Mark.WRONG, f"compiled kernels cannot be kept in {where}",
            "every start compiles for a minute; set NUMBA_CACHE_DIR to a folder of yours",
        )  # fmt: skip
    elif is_warm():
        yield Finding(Mark.GOOD, f"numeric kernels are compiled ({where})")
    else:
        cure = "the next start does it; to do it now: motm-twin warm-up"
        yield Finding(Mark.NOTE, "numeric kernels are not compiled yet", cure)


def _ports() -> Iterator[Finding]:
    for port, use in ((PAGE_PORT, "page"), (DEFAULT_PORT, "Zenoh")):
        try:
            require_free_port(LOOPBACK, port, use)
        except OSError:
            option = "--port" if use == "page" else "--zenoh-port"
            cure = f"motm-twin twins lists the twins that run; or choose another port with {option}"
            yield Finding(Mark.NOTE, f"port {port} ({use}) is taken", cure)
        else:
            yield Finding(Mark.GOOD, f"port {port} ({use}) is free")


def _browser() -> Iterator[Finding]:
    given = os.environ.get("MOTM_CHROMIUM")
    found = next((path for name in (given, *CHROMIUMS) if name and (path := shutil.which(name))), None)
    if found is None:
        yield Finding(
            Mark.NOTE, "no Chromium found", "browser tests, bench page and screenshots of the report need it; "
            "the page itself opens in any browser with WebGL",
        )  # fmt: skip
    else:
        yield Finding(Mark.GOOD, f"Chromium: {found}")
    if ctypes.util.find_library("GL") is None and ctypes.util.find_library("EGL") is None:
        yield Finding(Mark.NOTE, "no OpenGL library found", "a browser on this machine draws the page slowly")
    else:
        yield Finding(Mark.GOOD, "OpenGL library found")


def _zenoh() -> Iterator[Finding]:
    from motm_twin.bus.connection import free_port, open_member, open_server
    from motm_twin.client.discover import running_twins

    port = free_port()
    with open_server(port), open_member(f"tcp/{LOOPBACK}:{port}", wait=5.0):
        pass
    yield Finding(Mark.GOOD, "Zenoh works on loopback")
    found = [one for one in running_twins() if one.alive]
    names = ", ".join(f"{one.twin} at {one.endpoint} ({one.scene})" for one in found)
    yield Finding(Mark.GOOD, f"running twins: {names}" if found else "no twin is running on this machine")


CHECKS = (_versions, _packages, _cache, _models, _kernels, _ports, _browser, _zenoh)
