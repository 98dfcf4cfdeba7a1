"""For all tests: their helpers by name (here and in bus), and an order that leaves no worker alone with the long ones.

Hypothesis draws the same examples in every run, so that a change is judged by what it changes; MOTM_EXAMPLES=fresh
draws new ones. How long one takes is no finding on a busy machine: pytest's timeout ends what hangs.

Kernels that a change has made stale are compiled as `motm_twin.warm_up` does it, in a seventh of numba's usual time,
and before the workers start: each would compile the same ones.
"""

import importlib.util
import io
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import settings
from rich.console import Console

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parent / "bus")]

os.environ.setdefault("NUMBA_OPT", "1")  # before numba is imported; the same bits

settings.register_profile("same", derandomize=True, database=None, deadline=None)
settings.register_profile("fresh", derandomize=False, deadline=None)
settings.load_profile(os.environ.get("MOTM_EXAMPLES", "same"))


def pytest_configure(config):
    """Compile once for all workers what they have in common."""
    several = getattr(config.option, "numprocesses", None) and not hasattr(config, "workerinput")
    if several and not config.option.collectonly:
        code = "from motm_twin.warm_up import compile_kernels; compile_kernels()"
        subprocess.run([sys.executable, "-c", code], cwd=Path(__file__).parents[1], check=False)


def pytest_collection_modifyitems(items):
    """The long tests, those in a browser, come first, and of them those that may take longest.

    `--dist worksteal` begins with a contiguous share for each worker: so they fall to one, which runs one browser at a
    time (each draws with all processors), while the others take the short ones, and then those that are left to it.
    """
    items.sort(key=lambda item: (item.get_closest_marker("browser") is None, -_allowed(item)))


def _allowed(item):
    """The time [s] that a browser test may take; 0 for the others, which stay in their order."""
    limit = item.get_closest_marker("timeout")
    return limit.args[0] if limit and item.get_closest_marker("browser") else 0


@pytest.fixture(scope="module")
def tool(request):
    """The program of the folder tools that a test file names TOOL, as a module."""
    path = Path(__file__).parents[1] / "tools" / f"{request.module.TOOL}.py"
    spec = importlib.util.spec_from_file_location(f"tool_{path.stem}", path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def call(capfd, monkeypatch):
    """`motm-twin` with these words, in this process: a start of its own takes seconds of imports."""
    from motm_twin.cli import main

    def called(*words, cwd=None, **variables):
        capfd.readouterr()
        with monkeypatch.context() as patch, pytest.raises(SystemExit) as end:
            patch.setattr(sys, "argv", ["motm-twin", *map(str, words)])
            for name, value in variables.items():
                patch.setenv(name, value)
            if cwd is not None:
                patch.chdir(cwd)
            main()
        out, err = capfd.readouterr()
        return SimpleNamespace(returncode=end.value.code, stdout=out, stderr=err)

    return called


@pytest.fixture
def console():
    """A console whose text `export_text` gives, wide enough for any table."""
    return Console(width=220, record=True, file=io.StringIO())
