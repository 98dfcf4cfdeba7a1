"""One quadratic program, solved and checked: solver answers are not trusted."""

from typing import Any

import msgspec
import numpy as np
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
    worst = max(float((program.lower - x).max()), float((x - program.upper).max()), 0.0)
    if len(program.b):
        worst = max(worst, float(np.abs(program.A @ x - program.b).max()))
    if len(program.h):
        worst = max(worst, float((program.G @ x - program.h).max()))
    return worst


def _sparse(problem: Problem) -> Problem:
    from scipy.sparse import csc_matrix

    G = None if problem.G is None else csc_matrix(problem.G)
    return Problem(
        csc_matrix(problem.P), problem.q, G, problem.h, csc_matrix(problem.A), problem.b, problem.lb, problem.ub
    )


def _not_finite(program: Program) -> str:
    for name in program.__struct_fields__:
        if not np.isfinite(getattr(program, name)).all():
            return f"QP input {name}"
    return ""


def _none(program: Program, reason: str) -> Answer:
    return Answer(x=np.zeros(len(program.c)), reason=reason)
