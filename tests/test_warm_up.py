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
from motm_twin.warm_up import PARTS, compile_kernels, parts_of, program_clock, shares


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
    """No kernel is compiled; the cache would be this folder."""
    missing = SimpleNamespace(stats=SimpleNamespace(cache_path=str(tmp_path)), __name__="x", py_func=compile_kernels)
    monkeypatch.setattr(warm_up, "PARTS", {name: part._replace(largest=missing) for name, part in PARTS.items()})
    return tmp_path


def test_the_first_start_says_that_it_compiles_and_how_far_it_is(cold, monkeypatch) -> None:
    monkeypatch.setattr(warm_up, "_start", lambda parts: subprocess.Popen([sys.executable, "-c", "''"]))
    said: list[str] = []
    compile_kernels(tell=said.append)
    assert said[0].startswith("Compiling the numeric kernels, once per installation")
    assert said[-1].startswith("  5 of 5 parts after ")


def test_a_part_that_fails_is_not_counted_and_said(cold, monkeypatch) -> None:
    monkeypatch.setattr(
        warm_up, "_start", lambda parts: subprocess.Popen([sys.executable, "-c", "raise SystemExit(1)"])
    )
    said: list[str] = []
    compile_kernels(tell=said.append)
    assert len(said) == 2 and "failed to compile" in said[-1]


def test_what_is_compiled_is_not_compiled_again(monkeypatch) -> None:
    monkeypatch.setattr(warm_up, "is_warm", lambda parts: "arm" not in parts)
    started: list[list[str]] = []

    def start(parts):
        started.append(parts)
        return subprocess.Popen([sys.executable, "-c", "''"])

    monkeypatch.setattr(warm_up, "_start", start)
    compile_kernels(["arm", "search"], tell=lambda text: None)
    assert started == [["arm"]]


def test_a_run_waits_only_for_what_it_needs() -> None:
    alone = set(parts_of({}, agents=False))
    assert alone == {"arm", "perception", "placement", "plant", "search"}
    assert set(parts_of({}, agents=True)) == alone - {"plant"} | {"agents"}
    assert set(parts_of({"risk_weight": 10.0}, agents=False)) == alone - {"search"} | {"foresight"}


def test_parts_are_shared_out_so_that_all_processes_take_about_as_long() -> None:
    parts = parts_of({}, agents=False)
    assert sorted(part for share in shares(parts, 3) for part in share) == sorted(parts)
    assert [len(share) for share in shares(parts, 8)] == [1] * len(parts)
    took = [sum(PARTS[part].seconds for part in share) for share in shares(parts, 2)]
    assert max(took) < 1.2 * min(took)


def test_the_search_is_compiled_after_placement_whose_kernels_it_needs() -> None:
    (all_in_one,) = shares(parts_of({}, agents=False), 1)
    assert all_in_one[0] == "placement"
    assert all_in_one[-1] == "search"


def test_where_kernels_cannot_be_kept_it_says_so_once_and_compiles_as_it_goes(cold, monkeypatch) -> None:
    monkeypatch.setattr(warm_up, "can_keep", lambda: False)
    said: list[str] = []
    compile_kernels(tell=said.append)
    (text,) = said
    assert "NUMBA_CACHE_DIR" in text


def test_what_compiles_ends_with_its_parent(tmp_path) -> None:
    process = warm_up._start(["search"])
    assert process.stdin is not None
    process.stdin.close()
    assert process.wait(60.0) == 1


def test_a_script_of_three_lines_may_be_the_first_start(tmp_path) -> None:
    """Processes that import the script again would run it again."""
    script = tmp_path / "script.py"
    script.write_text(
        "from motm_twin import warm_up\nprint('once')\nwarm_up.is_warm = lambda parts: False\n"
        "warm_up.compile_kernels(['placement'])\n"
    )
    environment = os.environ | {"PYTHONPATH": str(Path.cwd())}
    done = subprocess.run(
        [sys.executable, str(script)], capture_output=True, text=True, timeout=200, check=True, env=environment
    )
    assert done.stdout == "once\n"
    assert "1 of 1 parts" in done.stderr
    assert "Traceback" not in done.stderr
