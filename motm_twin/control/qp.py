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
    bad = _not_finite(program)
    if bad:
        return _none(program, f"{bad} not finite")
    if crossing(program.lower, program.upper):
        return _none(program, "bounds cross")
    x = _daqp(program) if solver == "daqp" else _by_qpsolvers(program, solver)
    if x is None:
        return _none(program, f"{solver} found no answer")
    if not all_finite(x):
        return _none(program, f"{solver} answered with numbers that are not finite")
    worst = violation(program, x)
    if worst > residual:
        return _none(program, f"{solver} left a residual of {worst:.1e}")
    return Answer(x=x, reason="")


@njit(cache=True)
def all_finite(values: Array) -> bool:
    """Whether every number is finite, shape (n,)."""
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit(cache=True)
def crossing(lower: Array, upper: Array) -> bool:
    """Whether a lower bound is above its upper one."""
    for i in range(lower.shape[0]):
        if lower[i] > upper[i]:
            return True
    return False


def _daqp(program: Program) -> Array | None:
    """The minimiser by DAQP, without the 50 us that qpsolvers takes for its checks and its report."""
    p = program
    H, rows, upper, lower, sense = _as_daqp(p.P, p.A, p.b, p.G, p.h, p.lower, p.upper)
    x, _, flag, _ = daqp.solve(H, p.c, rows, upper, lower, sense)
    return np.asarray(x) if flag > 0 else None


@njit(cache=True)
def _as_daqp(
    P: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array
) -> tuple[Array, Array, Array, Array, NDArray[np.int32]]:
    """Cost matrix, rows, upper and lower bounds and kinds in DAQP's form: bounds first, then G, then A (equalities)."""
    n, k, e = P.shape[0], h.shape[0], b.shape[0]
    H, rows = np.zeros((n, n)), np.empty((k + e, n))
    high, low, sense = np.empty(n + k + e), np.full(n + k + e, _NO_BOUND), np.zeros(n + k + e, np.int32)
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
    return H, rows, high, low, sense


def _by_qpsolvers(program: Program, solver: str) -> Array | None:
    rows = len(program.h) > 0
    problem = Problem(
        np.diag(program.P),
        program.c,
        program.G if rows else None,
        program.h if rows else None,
        program.A,
        program.b,
        program.lower,
        program.upper,
    )
    solution = solve_problem(_sparse(problem), solver=solver, **_OPTIONS[solver])
    return np.asarray(solution.x) if solution.found and solution.x is not None else None


def violation(program: Program, x: Array) -> float:
    """Largest violation of any equality, row or bound."""
    return float(_violation(program.A, program.b, program.G, program.h, program.lower, program.upper, x))


@njit(cache=True)
def _violation(A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array, x: Array) -> float:
    worst = 0.0
    for i in range(x.shape[0]):
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
    p = program
    if math.isfinite(_total(p.P, p.c, p.A, p.b, p.G, p.h, p.lower, p.upper)):
        return ""
    for name in program.__struct_fields__:
        if not np.isfinite(getattr(program, name)).all():
            return f"QP input {name}"
    return ""


@njit(cache=True)
def _total(P: Array, c: Array, A: Array, b: Array, G: Array, h: Array, lower: Array, upper: Array) -> float:
    """A sum that is finite only when every number is (or nearly: then each is looked at)."""
    total = 0.0
    for values in (P, c, b, h, lower, upper):
        for i in range(values.shape[0]):
            total += abs(values[i])
    for matrix in (A, G):
        for r in range(matrix.shape[0]):
            for i in range(matrix.shape[1]):
                total += abs(matrix[r, i])
    return total


def _none(program: Program, reason: str) -> Answer:
    return Answer(x=np.zeros(len(program.c)), reason=reason)
