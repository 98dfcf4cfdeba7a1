"""One quadratic program, solved and checked: solver answers are not trusted."""

import importlib
import math
from typing import Any

import daqp
import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array

SOLVERS = ("daqp", "osqp")
_OPTIONS: dict[str, dict[str, Any]] = {  # of solvers used for comparison: OSQP, as in the paper
    "osqp": {"eps_abs": 1e-5, "eps_rel": 1e-5, "polishing": True, "max_iter": 20000, "adaptive_rho_interval": 50},
}
_NO_BOUND, _EQUALITY = -1e30, 5  # as DAQP writes them
_INFINITE, _CROSSING = 1, 2  # flaws of a program
_ACTIVE = 1e-6  # a row or bound this close to equality is active
_NOTHING = np.zeros(0, np.int64)


class Program(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """min 1/2 x' diag(P) x + c' x  with  A x = b,  G x <= h,  lower <= x <= upper."""

    P: Array  # shape (n,), positive
    c: Array  # shape (n,)
    A: Array  # shape (e, n)
    b: Array  # shape (e,)
    G: Array  # shape (k, n)
    h: Array  # shape (k,)
    lower: Array  # shape (n,)
    upper: Array  # shape (n,)
    slack: tuple[int, int] = (0, 0)  # index of the first of s variables whose columns of A are the identity, and s


class Solution(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The minimiser, or why there is none."""

    x: Array  # shape (n,); zeros when there is none
    reason: str  # "" when solved and checked
    active: NDArray[np.int64] = _NOTHING  # indices of rows of G, then k + i of variables i, that are at their bound


def load(solver: str) -> None:
    """Import the libraries of a solver now, not in its first step; ValueError when there is no such solver.

    DAQP needs nothing more: without qpsolvers, and SciPy's sparse matrices with it, a program starts sooner.
    """
    _refuse_unknown(solver)
    if solver != "daqp":
        importlib.import_module("qpsolvers")
        importlib.import_module("scipy.sparse")


def solve(program: Program, *, solver: str, residual: float) -> Solution:
    """Solve and check: inputs finite, found, answer finite, no row violated by more than ``residual``.

    DAQP solves the program with its slack eliminated; if that answer fails the check (slack at a bound), the full one.
    """
    _refuse_unknown(solver)
    if solver == "daqp" and program.slack[1]:
        answer = _checked(program, solver, residual, *program.slack)
        if not answer.reason:
            return answer
    return _checked(program, solver, residual, 0, 0)


def _refuse_unknown(solver: str) -> None:
    if solver not in SOLVERS:
        raise ValueError(f"QP solver {solver!r}: use one of {', '.join(SOLVERS)}")


def _checked(program: Program, solver: str, residual: float, first: int, count: int) -> Solution:
    """`solve` with ``count`` slack variables, from ``first`` on, eliminated."""
    flaw, u = _daqp(program, first, count) if solver == "daqp" else _by_qpsolvers(program, solver)
    if flaw == _INFINITE:
        return _none(program, f"{_not_finite(program)} not finite")
    if flaw == _CROSSING:
        return _none(program, "bounds cross")
    if u is None:
        return _none(program, f"{solver} found no answer")
    p, x = program, np.empty(len(program.c))
    worst, active = _complete(u, p.A, p.b, p.G, p.h, p.lower, p.upper, first, count, x)
    if math.isnan(worst):
        return _none(program, f"{solver} answered with numbers that are not finite")
    if worst > residual:
        return _none(program, f"{solver} left a residual of {worst:.1e}")
    return Solution(x=x, reason="", active=active)


@njit(cache=True)
def _flaw(P: Array, c: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array) -> int:
    """Flaw that keeps a program from being given to a solver; 0: none."""
    for values in (P, c, b, h, lower, upper):
        for value in values:
            if not math.isfinite(value):
                return _INFINITE
    for matrix in (A, G):
        for r in range(matrix.shape[0]):
            for i in range(matrix.shape[1]):
                if not math.isfinite(matrix[r, i]):
                    return _INFINITE
    for i in range(lower.shape[0]):
        if lower[i] > upper[i]:
            return _CROSSING
    return 0


def _daqp(program: Program, first: int, count: int) -> tuple[int, Array | None]:
    """Flaw, or the minimiser by DAQP without the 50 us that qpsolvers takes for its checks and its report.

    Without the hand's six slack variables, and the six equalities with them, DAQP has two thirds of the work.
    """
    p = program
    n, k = len(p.P) - count, len(p.h) + len(p.b) - count
    H, c, rows = np.empty((n, n)), np.empty(n), np.empty((k, n))
    low, high, sense = np.empty(n + k), np.empty(n + k), np.empty(n + k, np.int32)
    flaw = _fill_daqp(p.P, p.c, p.A, p.b, p.G, p.h, p.lower, p.upper, first, count, H, c, rows, low, high, sense)
    if flaw:
        return flaw, None
    x, _, flag, _ = daqp.solve(H, c, rows, high, low, sense)
    return 0, np.asarray(x) if flag > 0 else None


@njit(cache=True)
def _fill_daqp(
    P: Array, c: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array, first: int, count: int,
    H: Array, f: Array, rows: Array, low: Array, high: Array, sense: NDArray[np.int32],
) -> int:  # fmt: skip
    """Fill in DAQP's form: cost, rows, lower and upper bounds, kinds; variables, then G, then A unless eliminated.

    With s = b - A u for the ``count`` slack variables from ``first`` on, and u the others, the cost is
    1/2 u' (P_u + A' P_s A) u + (c_u - A' (P_s b + c_s))' u. Returns the flaw of a program that is not to be solved.
    """
    flaw = _flaw(P, c, A, b, G, h, lower, upper)
    if flaw:
        return flaw
    n, k, e = H.shape[0], h.shape[0], b.shape[0] - count
    low[n:], sense[:] = _NO_BOUND, 0
    for i in range(n):
        own = i if i < first else i + count
        f[i], high[i], low[i] = c[own], upper[own], lower[own]
        for j in range(i + 1):
            H[i, j] = 0.0
        H[i, i] = P[own]
        for r in range(count):
            weighted = A[r, own] * P[first + r]
            if weighted != 0.0:
                f[i] -= weighted * b[r]
                for j in range(i + 1):
                    H[i, j] += weighted * A[r, j if j < first else j + count]
            f[i] -= A[r, own] * c[first + r]
        for j in range(i):
            H[j, i] = H[i, j]
    for r in range(k):
        high[n + r] = h[r]
        for i in range(n):
            rows[r, i] = G[r, i if i < first else i + count]
        for m in range(count):
            part = G[r, first + m]
            if part != 0.0:
                high[n + r] -= part * b[m]
                for i in range(n):
                    rows[r, i] -= part * A[m, i if i < first else i + count]
    for r in range(e):
        high[n + k + r], sense[n + k + r] = b[r], _EQUALITY
        for i in range(n):
            rows[k + r, i] = A[r, i]
    return 0


def violation(program: Program, x: Array) -> float:
    """Largest violation of any equality, row or bound; nan when x is not finite."""
    p = program
    return float(_complete(x, p.A, p.b, p.G, p.h, p.lower, p.upper, 0, 0, np.empty(len(x)))[0])


@njit(cache=True)
def _complete(
    u: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array, first: int, count: int, x: Array
) -> tuple[float, NDArray[np.int64]]:  # fmt: skip
    """Fill in x, the answer with its slack; returns its largest violation, nan if not finite, and `Solution.active`."""
    n, k = x.shape[0], h.shape[0]
    active, size = np.empty(k + n, np.int64), 0
    for i in range(u.shape[0]):
        x[i if i < first else i + count] = u[i]
    for r in range(count):
        left = b[r]
        for i in range(n):
            if i < first or i >= first + count:
                left -= A[r, i] * x[i]
        x[first + r] = left
    worst = 0.0
    for i in range(n):
        if not math.isfinite(x[i]):
            return math.nan, active[:0]
        worst = max(worst, lower[i] - x[i], x[i] - upper[i])
    for r in range(count, b.shape[0]):
        total = -b[r]
        for i in range(n):
            total += A[r, i] * x[i]
        worst = max(worst, abs(total))
    for r in range(k):
        total = 0.0
        for i in range(n):
            total += G[r, i] * x[i]
        worst = max(worst, total - h[r])
        if total >= h[r] - _ACTIVE:
            active[size] = r
            size += 1
    for i in range(n):
        if x[i] <= lower[i] + _ACTIVE or x[i] >= upper[i] - _ACTIVE:
            active[size] = k + i
            size += 1
    return worst, active[:size]


def _not_finite(program: Program) -> str:
    """The first array with a number that is not finite."""
    names = (name for name in program.__struct_fields__ if not np.isfinite(getattr(program, name)).all())
    return f"QP input {next(names)}"


def _by_qpsolvers(program: Program, solver: str) -> tuple[int, Array | None]:

    p = program
    flaw = _flaw(p.P, p.c, p.A, p.b, p.G, p.h, p.lower, p.upper)
    return (flaw, None) if flaw else (0, _minimiser(program, solver))


def _minimiser(program: Program, solver: str) -> Array | None:
    """The unchecked answer of a solver of qpsolvers, shape (n,); None when it found none."""
    from qpsolvers import Problem, solve_problem  # see `load`
    from scipy.sparse import csc_matrix

    p, rows = program, len(program.h) > 0
    problem = Problem(
        csc_matrix(np.diag(p.P)), p.c, csc_matrix(p.G) if rows else None, p.h if rows else None, csc_matrix(p.A), p.b,
        p.lower, p.upper,
    )  # fmt: skip
    solution = solve_problem(problem, solver=solver, **_OPTIONS[solver])
    return np.asarray(solution.x) if solution.found and solution.x is not None else None


def _none(program: Program, reason: str) -> Solution:
    return Solution(x=np.zeros(len(program.c)), reason=reason)
