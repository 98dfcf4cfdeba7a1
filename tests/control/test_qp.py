"""The redundancy-resolution QP: two solvers agree, and no answer is trusted unchecked."""

import msgspec
import numpy as np
import pytest

from motm_twin.control.arm.qp import Program, solve, violation


def random_program(seed: int) -> Program:
    """A problem shaped like an arm step: 17 variables, 6 equalities with slacks, a dozen elastic rows, bounds."""
    rng = np.random.default_rng(seed)
    n = 17
    A = np.hstack([rng.normal(size=(6, 9)), np.eye(6), np.zeros((6, 2))])
    G = np.hstack([rng.normal(size=(12, 9)), np.zeros((12, 6)), -np.eye(2)[rng.integers(0, 2, 12)]])
    bound = np.concatenate([rng.uniform(0.1, 2.0, 9), np.full(6, 20.0), np.full(2, 1000.0)])
    return Program(
        P=np.concatenate([np.full(2, 1e3), np.full(7, 0.05), np.full(3, 1e3), np.full(3, 3.0), np.full(2, 1e3)]),
        c=np.concatenate([rng.normal(size=9), np.zeros(6), np.full(2, 1e3)]),
        A=A,
        b=rng.normal(size=6),
        G=G,
        h=rng.normal(size=12),
        lower=np.concatenate([-bound[:15], np.zeros(2)]),
        upper=bound[:n],
    )


@pytest.mark.parametrize("seed", range(20))
def test_two_solvers_give_the_same_answer(seed):
    program = random_program(seed)
    first = solve(program, solver="daqp", residual=1e-5)
    second = solve(program, solver="osqp", residual=1e-3)
    assert first.reason == "" and second.reason == ""
    assert violation(program, first.x) <= 1e-6
    np.testing.assert_allclose(second.x, first.x, atol=2e-3)


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("bound", [20.0, 0.3])
def test_without_its_slack_a_program_has_the_same_answer(seed, bound):
    """Also where the slack is at its bound, and where a row and the cost are about it."""
    program = random_program(seed)
    lower, upper, G, c = program.lower.copy(), program.upper.copy(), program.G.copy(), program.c.copy()
    lower[9:15], upper[9:15] = -bound, bound
    G[:2, 9:15], c[9:15] = np.random.default_rng(seed).normal(size=(2, 6)), 0.5
    program = msgspec.structs.replace(program, lower=lower, upper=upper, G=G, c=c)
    whole = solve(program, solver="daqp", residual=1e-5)
    short = solve(msgspec.structs.replace(program, slack=(9, 6)), solver="daqp", residual=1e-5)
    assert short.reason == whole.reason
    np.testing.assert_allclose(short.x, whole.x, atol=1e-7)
    at_bound = np.isclose(np.abs(whole.x[9:15]), bound).any()
    assert at_bound == (bound == 0.3 and not whole.reason)


def cost(program: Program, x: np.ndarray) -> float:
    return float(0.5 * x @ (program.P * x) + program.c @ x)


def test_no_feasible_step_from_the_answer_is_better():
    program = random_program(3)
    x = solve(program, solver="daqp", residual=1e-5).x
    rng = np.random.default_rng(0)
    null = np.linalg.svd(program.A)[2][6:]
    for _ in range(300):
        other = x + 1e-3 * rng.normal(size=len(null)) @ null
        if violation(program, other) <= 1e-9:
            assert cost(program, other) >= cost(program, x) - 1e-9


@pytest.mark.parametrize("name", ["c", "A", "b", "G", "h", "lower"])
def test_numbers_that_are_not_finite_are_refused_before_solving(name):
    program = random_program(0)
    spoiled = getattr(program, name).copy()
    spoiled.flat[0] = np.nan
    answer = solve(msgspec.structs.replace(program, **{name: spoiled}), solver="daqp", residual=1e-5)
    assert answer.reason == f"QP input {name} not finite"
    assert not answer.x.any()


def test_a_problem_without_solution_says_so():
    program = random_program(0)
    G = np.vstack([program.G, np.eye(17)[:1]])
    h = np.append(program.h, -100.0)
    answer = solve(msgspec.structs.replace(program, G=G, h=h), solver="daqp", residual=1e-5)
    assert "no answer" in answer.reason


def test_bounds_that_cross_are_refused():
    program = random_program(0)
    answer = solve(msgspec.structs.replace(program, lower=program.upper + 1.0), solver="daqp", residual=1e-5)
    assert answer.reason == "bounds cross"


def test_an_unknown_solver_is_named_with_the_known_ones():
    with pytest.raises(ValueError, match="use one of daqp"):
        solve(random_program(0), solver="quadprog", residual=1e-5)
