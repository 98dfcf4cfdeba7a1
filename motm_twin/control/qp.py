"""One quadratic program, solved and checked: solver answers are not trusted."""

import math
from typing import Any

import daqp
import msgspec
import numpy as np
from numba import njit
from numpy.typing import NDArray
from qpsolvers import Problem, solve_problem

from motm_twin.model.geometry import Array

SOLVERS = ("daqp", "osqp")
_NO_BOUND, _EQUALITY = -1e30, 5  # as DAQP writes them
_INFINITE, _CROSSING = 1, 2  # flaws of a program
_OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-5, "eps_rel": 1e-5, "polishing": True, "max_iter": 20000, "adaptive_rho_interval": 50},
}


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


class Answer(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """The minimiser, or why there is none."""

    x: Array  # shape (n,); zeros when there is none
    reason: str  # "" when solved and checked


def solve(program: Program, *, solver: str, residual: float) -> Answer:
    """Solve and check: inputs finite, found, answer finite, no row violated by more than ``residual``."""
    if solver not in SOLVERS:
        raise ValueError(f"QP solver {solver!r}: use one of {', '.join(SOLVERS)}")
    flaw, x = _daqp(program) if solver == "daqp" else _by_qpsolvers(program, solver)
    if flaw == _INFINITE:
        return _none(program, f"{_not_finite(program)} not finite")
    if flaw == _CROSSING:
        return _none(program, "bounds cross")
    if x is None:
        return _none(program, f"{solver} found no answer")
    worst = violation(program, x)
    if math.isnan(worst):
        return _none(program, f"{solver} answered with numbers that are not finite")
    if worst > residual:
        return _none(program, f"{solver} left a residual of {worst:.1e}")
    return Answer(x=x, reason="")


@njit(cache=True)
def _flaw(P: Array, c: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array) -> int:
    """What keeps a program from being given to a solver; 0: nothing."""
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


def _daqp(program: Program) -> tuple[int, Array | None]:
    """Flaw, or the minimiser by DAQP without the 50 us that qpsolvers takes for its checks and its report."""
    p = program
    n, k, e = len(p.P), len(p.h), len(p.b)
    H, rows, bounds, sense = (
        np.zeros((n, n)),
        np.empty((k + e, n)),
        np.empty((2, n + k + e)),
        np.zeros(n + k + e, np.int32),
    )
    flaw = _fill_daqp(p.P, p.c, p.A, p.b, p.G, p.h, p.lower, p.upper, H, rows, bounds, sense)
    if flaw:
        return flaw, None
    x, _, flag, _ = daqp.solve(H, p.c, rows, bounds[1], bounds[0], sense)
    return 0, np.asarray(x) if flag > 0 else None


@njit(cache=True)
def _fill_daqp(
    P: Array, c: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array,
    H: Array, rows: Array, bounds: Array, sense: NDArray[np.int32],
) -> int:  # fmt: skip
    """Fill in DAQP's form: cost matrix, rows, lower and upper bounds, kinds; variables first, then G, then A (equal).

    ``H`` and ``sense`` come as zeros. Returns the flaw of a program that is not to be solved.
    """
    flaw = _flaw(P, c, A, b, G, h, lower, upper)
    if flaw:
        return flaw
    n, k, e = P.shape[0], h.shape[0], b.shape[0]
    low, high = bounds[0], bounds[1]
    low[n:] = _NO_BOUND
    for i in range(n):
        H[i, i], high[i], low[i] = P[i], upper[i], lower[i]
    for r in range(k):
        high[n + r] = h[r]
        for i in range(n):
            rows[r, i] = G[r, i]
    for r in range(e):
        high[n + k + r], sense[n + k + r] = b[r], _EQUALITY
        for i in range(n):
            rows[k + r, i] = A[r, i]
    return 0


def _by_qpsolvers(program: Program, solver: str) -> tuple[int, Array | None]:
    p = program
    flaw = _flaw(p.P, p.c, p.A, p.b, p.G, p.h, p.lower, p.upper)
    if flaw:
        return flaw, None
    rows = len(p.h) > 0
    problem = Problem(np.diag(p.P), p.c, p.G if rows else None, p.h if rows else None, p.A, p.b, p.lower, p.upper)
    solution = solve_problem(_sparse(problem), solver=solver, **_OPTIONS[solver])
    return 0, np.asarray(solution.x) if solution.found and solution.x is not None else None


def violation(program: Program, x: Array) -> float:
    """Largest violation of any equality, row or bound; nan when x is not finite."""
    return float(_violation(program.A, program.b, program.G, program.h, program.lower, program.upper, x))


@njit(cache=True)
def _violation(A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array, x: Array) -> float:
    worst = 0.0
    for i in range(x.shape[0]):
        if not math.isfinite(x[i]):
            return math.nan
        worst = max(worst, lower[i] - x[i], x[i] - upper[i])
    for r in range(b.shape[0]):
        total = -b[r]
        for i in range(x.shape[0]):
            total += A[r, i] * x[i]
        worst = max(worst, abs(total))
    for r in range(h.shape[0]):
        total = -h[r]
        for i in range(x.shape[0]):
            total += G[r, i] * x[i]
        worst = max(worst, total)
    return worst


def _sparse(problem: Problem) -> Problem:
    from scipy.sparse import csc_matrix

    G = None if problem.G is None else csc_matrix(problem.G)
    return Problem(
        csc_matrix(problem.P), problem.q, G, problem.h, csc_matrix(problem.A), problem.b, problem.lb, problem.ub
    )


def _not_finite(program: Program) -> str:
    """The first array with a number that is not finite."""
    names = (name for name in program.__struct_fields__ if not np.isfinite(getattr(program, name)).all())
    return f"QP input {next(names)}"


def _none(program: Program, reason: str) -> Answer:
    return Answer(x=np.zeros(len(program.c)), reason=reason)
