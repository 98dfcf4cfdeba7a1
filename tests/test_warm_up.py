"""The first start: kernels are compiled with a word about it, and what they take counts in no period."""

import os
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from numba import njit

from motm_twin import warm_up
from motm_twin.warm_up import compile_kernels, program_clock


def test_the_clock_of_the_program_stands_while_a_kernel_is_compiled() -> None:
    @njit
    def inner(x):
        return np.sort(x)[::-1]

    @njit
    def kernel(x):
        return inner(x).sum()

    real, counted = time.perf_counter(), program_clock()
    kernel(np.ones(3))
    assert time.perf_counter() - real > 0.1
    assert program_clock() - counted < 0.5 * (time.perf_counter() - real)
    counted = program_clock()
    time.sleep(0.05)
    assert program_clock() - counted >= 0.05


@pytest.fixture
def cold(monkeypatch, tmp_path):
    """No kernel of the search is compiled; its cache would be this folder."""
    monkeypatch.setattr(
        warm_up, "run_search", SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path)), __name__="x")
    )
    return tmp_path


def test_the_first_start_says_that_it_compiles_and_how_far_it_is(cold, monkeypatch) -> None:
    monkeypatch.setattr(warm_up, "_start", lambda part: subprocess.Popen([sys.executable, "-c", f"'{part}'"]))
    said: list[str] = []
    compile_kernels(said.append)
    assert said[0].startswith("Compiling the numeric kernels, once per installation")
    assert said[-1].startswith("  5 of 5 parts after ")


def test_where_kernels_cannot_be_kept_it_says_so_once_and_compiles_as_it_goes(cold, monkeypatch) -> None:
    monkeypatch.setattr(warm_up, "can_keep", lambda: False)
    said: list[str] = []
    compile_kernels(said.append)
    (text,) = said
    assert "NUMBA_CACHE_DIR" in text


def test_what_compiles_ends_with_its_parent(tmp_path) -> None:
    process = warm_up._start("search")
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(60.0) == 1


def test_a_script_of_three_lines_may_be_the_first_start(tmp_path) -> None:
    """Processes that import the script again would run it again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from motm_twin import warm_up\nprint('once')\nwarm_up.is_warm = lambda: False\n"
        "warm_up.PARTS = {'placement': None}\nwarm_up.compile_kernels()\n"
    )
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=200, check=True, env=environment
    )
    assert done.stdout == "once\n"
    assert "1 of 1 parts" in done.stderr
    assert "Traceback" not in done.stderr
