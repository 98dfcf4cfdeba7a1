"""Driving by hand in the real twin: within the limits of the base, the monitor in the way, and reruns repeat."""

import numpy as np
import pytest

from motm_twin.model.edits import AddObstacle, Drive
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import rerun
from motm_twin.twin import Twin


def driven(twin, periods, **twist):
    ticks = []
    for _ in range(periods):
        twin.post(Drive(**twist))
        ticks.append(twin.advance())
    return ticks


@pytest.fixture(scope="module")
def twin():
    return Twin(load_scene("exp1", None, None))


def test_the_base_goes_as_it_is_told_within_its_limits_and_then_on_with_its_task(twin):
    twin.reset()
    ticks = driven(twin, 30, v=-0.2, w=0.5)
    assert all(tick.plan.status == "by hand" and "driven by hand" in tick.stop_reason for tick in ticks)
    assert ticks[-1].observation.twist == pytest.approx([-0.2, 0.5], abs=0.02)
    limits = twin.scene.robot.base
    commanded = np.array([step.actuation.twist for tick in ticks for step in tick.arm])
    steps = np.abs(np.diff(commanded, axis=0)).max(axis=0)
    assert (steps <= np.array([limits.linear_acceleration, limits.yaw_acceleration]) * 0.01 + 1e-6).all()
    assert all(tick.task_index == 0 for tick in ticks)
    after = [twin.advance() for _ in range(8)]
    assert [tick.plan.status == "by hand" for tick in after] == [True] * 5 + [False] * 3  # 0.3 s with its own period
    assert after[-1].tasks[0].status == "active"


def test_more_than_the_base_can_is_cut(twin):
    twin.reset()
    ticks = driven(twin, 40, v=-9.0)
    assert min(tick.observation.twist[0] for tick in ticks) == pytest.approx(-0.25, abs=0.02)


def test_it_cannot_be_driven_into_what_it_sees_but_away_from_it(twin):
    twin.reset()
    x, y, heading = twin.scene.start
    twin.post(AddObstacle(name="box", x=x + 1.6 * np.cos(heading), y=y + 1.6 * np.sin(heading)))
    ticks = driven(twin, 200, v=0.5)
    assert "slowed" in ticks[-1].stop_reason
    assert abs(ticks[-1].observation.twist[0]) < 0.05
    way = np.array([tick.truth.pose[:2] for tick in ticks]) - (x, y)
    left = 1.0 - np.linalg.norm(way[-1])  # half a base and half a box: 0.6 m from centre to centre
    assert 0.05 < left < 0.12  # what is kept, and a cell and the circles that cover the base besides
    turned = driven(twin, 60, v=0.3, w=1.0)  # its corner would touch
    back = driven(twin, 40, v=-0.2)
    assert not back[-1].truth.contacts
    assert np.linalg.norm(back[-1].truth.pose[:2] - turned[-1].truth.pose[:2]) > 0.2


def test_driving_is_recorded_and_runs_again_bit_for_bit(twin):
    twin.reset()
    driven(twin, 12, v=0.1, w=-0.4)
    for _ in range(20):
        twin.advance()
    session = twin.session()
    assert sum(isinstance(entry.edit, Drive) for entry in session.edits) == 12
    assert rerun(session).state_hash == twin.state_hash()


def test_a_snapshot_knows_how_long_the_hand_still_drives(twin):
    twin.reset()
    driven(twin, 3, v=0.1)
    state = twin.snapshot()
    first = [twin.advance().plan.status for _ in range(8)]
    twin.restore(state)
    assert [twin.advance().plan.status for _ in range(8)] == first


def test_only_the_newest_twist_waits_and_it_must_be_finite(twin):
    twin.reset()
    twin.post(Drive(v=0.4))
    twin.post(Drive(v=0.0, w=0.3))
    tick = twin.advance()
    assert tick.edits == (Drive(v=0.0, w=0.3),)
    with pytest.raises(ValueError, match="finite"):
        twin.post(Drive(v=float("nan")))
