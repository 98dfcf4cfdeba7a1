import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, READY, BaseLimits
from motm_twin.sim.mechanics import Arm, Base
from motm_twin.sim.plant_state import ArmState, BaseState

DT = 0.01


def test_base_reaches_full_speed_with_limited_acceleration_and_goes_straight():
    base, state = Base(BaseLimits(velocity_lag=0.0), DT), BaseState(pose=np.zeros(3))
    for _ in range(200):
        base.step(state, np.array([2.0, 0.0]))
    assert state.v == pytest.approx(0.5)
    assert state.pose[0] == pytest.approx(0.5 * 2.0 - 0.5 * 0.5 * 1.0)  # 1 s of acceleration at 0.5 m/s^2, then 1 s
    assert state.pose[1] == 0.0


def test_base_velocity_follows_small_commands_with_the_time_constant_of_its_lag():
    base, state = Base(BaseLimits(), DT), BaseState(pose=np.zeros(3))
    for _ in range(10):
        base.step(state, np.array([0.01, 0.0]))
    assert state.v == pytest.approx(0.01 * (1.0 - np.exp(-1.0)))


def test_base_drives_a_circle_exactly():
    base, state = Base(BaseLimits(), DT), BaseState(pose=np.zeros(3), v=0.4, w=0.5)
    for _ in range(round(np.pi / 0.5 / DT)):
        base.step(state, np.array([0.4, 0.5]))
    turned = 0.5 * DT * round(np.pi / 0.5 / DT)
    expected = [0.8 * np.sin(turned), 0.8 * (1.0 - np.cos(turned))]
    np.testing.assert_allclose(state.pose[:2], expected, atol=1e-12)


def test_base_backs_up_no_faster_than_its_reverse_speed():
    base, state = Base(BaseLimits(), DT), BaseState(pose=np.zeros(3))
    for _ in range(300):
        base.step(state, np.array([-1.0, 9.0]))
    assert state.v == pytest.approx(-0.25)
    assert state.w == pytest.approx(BaseLimits().yaw_rate)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 60))
def test_arm_keeps_all_its_limits_for_any_commands(seed, hold):
    rng = np.random.default_rng(seed)
    arm, state = Arm(0.01, DT), ArmState(q=READY.copy(), dq=np.zeros(7))
    seen = [(state.q, state.dq)]
    for k in range(400):
        if k % hold == 0:
            command = rng.uniform(-4.0, 4.0, 7)
        arm.step(state, command)
        seen.append((state.q.copy(), state.dq.copy()))
    q, dq = np.array(seen).transpose(1, 0, 2)
    assert np.all(np.abs(dq) <= DQ_MAX + 1e-9)
    assert np.all(np.abs(np.diff(dq, axis=0)) <= DDQ_MAX * DT + 1e-9)
    assert np.all(q <= Q_MAX)
    assert np.all(q >= Q_MIN)
    np.testing.assert_allclose(np.diff(q, axis=0), 0.5 * (dq[:-1] + dq[1:]) * DT, atol=1e-9)  # the clamp never acts


def test_arm_runs_up_to_its_position_limits_and_stays_there():
    arm, state = Arm(0.01, DT), ArmState(q=READY.copy(), dq=np.zeros(7))
    for _ in range(600):
        arm.step(state, 3.0 * np.ones(7))
    np.testing.assert_allclose(state.q, Q_MAX, atol=2e-3)
    np.testing.assert_allclose(state.dq, 0.0, atol=1e-2)
