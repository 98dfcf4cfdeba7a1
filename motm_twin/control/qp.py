"""One quadratic program, solved and checked: solver answers are not trusted."""

import math
from typing import Any

import msgspec
import numpy as np
from numba import njit
from qpsolvers import Problem, solve_problem

from motm_twin.model.geometry import Array

SOLVERS = ("daqp", "osqp")
_OPTIONS: dict[str, dict[str, Any]] = {
    "daqp": {},
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
    if (program.lower > program.upper).any():
        return _none(program, "bounds cross")
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
    if solver != "daqp":
        problem = _sparse(problem)
    solution = solve_problem(problem, solver=solver, **_OPTIONS[solver])
    if not solution.found or solution.x is None:
        return _none(program, f"{solver} found no answer")
    x = np.asarray(solution.x)
    if not np.isfinite(x).all():
        return _none(program, f"{solver} answered with numbers that are not finite")
    worst = violation(program, x)
    if worst > residual:
        return _none(program, f"{solver} left a residual of {worst:.1e}")
    return Answer(x=x, reason="")


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
