"""The solvers that are reached through qpsolvers, for comparison: OSQP, which the paper uses."""

from typing import Any

import numpy as np
from qpsolvers import Problem, solve_problem
from scipy.sparse import csc_matrix

from motm_twin.control.arm.qp import Program
from motm_twin.model.geometry import Array

_OPTIONS: dict[str, dict[str, Any]] = {
    "osqp": {"eps_abs": 1e-5, "eps_rel": 1e-5, "polishing": True, "max_iter": 20000, "adaptive_rho_interval": 50},
}


def minimiser(program: Program, solver: str) -> Array | None:
    """The solver's answer, shape (n,), as it is; None when it found none."""
    p = program
    rows = len(p.h) > 0
    problem = Problem(
        csc_matrix(np.diag(p.P)), p.c, csc_matrix(p.G) if rows else None, p.h if rows else None, csc_matrix(p.A), p.b,
        p.lower, p.upper,
    )  # fmt: skip
    solution = solve_problem(problem, solver=solver, **_OPTIONS[solver])
    return np.asarray(solution.x) if solution.found and solution.x is not None else None
