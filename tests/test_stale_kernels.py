"""Compiled kernels do not outlive the source of those that they call."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from motm_twin import drop_stale_kernels

INNER = "from numba import njit\n\n@njit(cache=True)\ndef inner(x):\n    return x + {}\n"
OUTER = (
    "from numba import njit\nfrom inner import inner\n\n@njit(cache=True)\ndef outer(x):\n    return 10 * inner(x)\n"
)


def outer_of_1(folder: Path) -> int:
    """What a process of its own computes, with what numba kept."""
    code = "from outer import outer; print(outer(1))"
    told = subprocess.run([sys.executable, "-c", code], cwd=folder, capture_output=True, text=True, check=True)
    return int(told.stdout)


def later(path: Path, text: str) -> None:
    """Write a source a second after everything else was."""
    path.write_text(text)
    newest = max(entry.stat().st_mtime_ns for entry in path.parent.glob("**/*")) + 1_000_000_000
    os.utime(path, ns=(newest, newest))


@pytest.mark.parametrize("elsewhere", [False, True])
def test_a_kernel_is_compiled_again_when_one_that_it_calls_has_changed(tmp_path, monkeypatch, elsewhere):
    if elsewhere:
        monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "kernels"))
    (tmp_path / "inner.py").write_text(INNER.format(1))
    (tmp_path / "outer.py").write_text(OUTER)
    assert outer_of_1(tmp_path) == 20
    later(tmp_path / "inner.py", INNER.format(2))
    assert outer_of_1(tmp_path) == 20, "numba looks at callees by now: drop_stale_kernels is no longer needed"
    assert drop_stale_kernels(tmp_path) > 0
    assert outer_of_1(tmp_path) == 30


def test_what_is_newer_than_all_sources_stays(tmp_path):
    (tmp_path / "inner.py").write_text(INNER.format(1))
    (tmp_path / "outer.py").write_text(OUTER)
    assert outer_of_1(tmp_path) == 20
    kept = sorted(tmp_path.glob("**/*.nbi"))
    assert len(kept) == 2
    assert drop_stale_kernels(tmp_path) == 0
    assert sorted(tmp_path.glob("**/*.nbi")) == kept
