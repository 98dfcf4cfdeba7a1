"""A run is the same bit for bit whatever kernels BLAS and NumPy choose for a processor, with any number of threads."""

import ast
import os
import subprocess
import sys
from pathlib import Path

import numpy._core._multiarray_umath as umath
import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGE = ROOT / "motm_twin"
HASHED_ROOMS = ("model", "perception", "planning", "control", "sim", "methods", "gym", "external")
FILES = sorted([*(path for room in HASHED_ROOMS for path in (PACKAGE / room).rglob("*.py")), *PACKAGE.glob("*.py")])
BLAS = {  # names of NumPy and Numba that end in a product of BLAS
    "dot", "vdot", "inner", "matmul", "tensordot", "einsum", "multi_dot", "linalg", "convolve", "correlate", "cov",
    "corrcoef", "polyfit", "lstsq", "vecdot", "matvec", "vecmat", "trapezoid",
}  # fmt: skip
BY_PROCESSOR = {  # functions of NumPy that have another kernel where there is AVX-512
    "arctan2", "arctan", "tan", "arcsin", "arccos", "exp", "exp2", "expm1", "log", "log2", "log10", "log1p", "cbrt",
    "sinh", "cosh", "tanh", "arcsinh", "arccosh", "arctanh", "power", "float_power", "angle",
}  # fmt: skip
PART = """
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

twin = Twin(load_scene("exp1a", "random", 1))
for _ in range(210):
    twin.advance()
print(twin.state_hash())
"""  # drives to the first cube past boxes that the map does not know, and takes it


def inexact(tree: ast.AST):
    """Line and name of every operation whose last bit is the processor's choice."""
    for node in ast.walk(tree):
        if isinstance(node, ast.BinOp | ast.AugAssign) and isinstance(node.op, ast.MatMult):
            yield node.lineno, "@"
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name) and node.value.id == "np":
            if node.attr in BLAS | BY_PROCESSOR:
                yield node.lineno, f"np.{node.attr}"
        elif (
            isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in ("dot", "matmul")
        ):
            yield node.lineno, f".{node.func.attr}"


def test_no_hashed_room_computes_by_blas_or_by_kernels_of_a_processor():
    found = [
        f"{path.relative_to(ROOT)}:{line}: {name}"
        for path in FILES
        for line, name in inexact(ast.parse(path.read_text()))
    ]
    assert not found, "motm_twin/model/exact.py has what takes their place"


def test_the_search_for_them_finds_them():
    found = list(inexact(ast.parse("a @ b\na @= b\nnp.linalg.norm(a)\na.dot(b)\nnp.arctan2(y, x)\nnp.hypot(x, y)")))
    assert sorted(found) == [(1, "@"), (2, "@"), (3, "np.linalg"), (4, ".dot"), (5, "np.arctan2")]


def started(**settings: str) -> subprocess.Popen[str]:
    chosen = {"OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"}
    environment = {name: value for name, value in os.environ.items() if name not in chosen} | settings
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    return subprocess.Popen([sys.executable, "-c", PART], cwd=ROOT, env=environment, text=True, **pipes)


def state_of(run: subprocess.Popen[str]) -> str:
    said, errors = run.communicate()
    assert run.returncode == 0, errors
    return said.strip()


@pytest.mark.slow
def test_a_run_is_the_same_with_every_kernel_of_blas_and_any_number_of_threads():
    settings = (
        {"OPENBLAS_CORETYPE": "Nehalem", "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"},
        {"OPENBLAS_CORETYPE": "Prescott", "OPENBLAS_NUM_THREADS": "4", "OMP_NUM_THREADS": "4"} | without_avx512(),
        {},  # as the processor has it
    )
    runs = [started(**one) for one in settings]  # at the same time
    try:
        states = [state_of(run) for run in runs]
    finally:
        for run in runs:
            run.kill()
    assert len(states[0]) == 64
    assert len(set(states)) == 1, dict(zip(map(str, settings), states, strict=True))


def without_avx512() -> dict[str, str]:
    """Nothing where there is none: NumPy warns about features that it is to leave out and does not have."""
    there = umath.__cpu_features__.get("X86_V4", False)
    return {"NPY_DISABLE_CPU_FEATURES": "X86_V4"} if there else {}
