"""The same plan, open loop: exact where nothing is unexpected, and blind where something is."""

import msgspec
import numpy as np
import pytest

from motm_twin.control.method import ArmParts, PlannerParts
from motm_twin.dry_run import nominal_scene
from motm_twin.methods.registry import MOTM
from motm_twin.model.edits import InsertTask
from motm_twin.model.known import known_world
from motm_twin.model.motion import drive
from motm_twin.model.names import MethodError
from motm_twin.model.scene import Bin, DriveTo, Faults, Pick, Place
from motm_twin.model.scene_file import load_scene
from motm_twin.rivals.open_loop import OPEN_LOOP, docking_twist, tracking_twist
from motm_twin.trial import run_scene
from motm_twin.twin import Twin


@pytest.fixture(scope="module")
def quiet():
    """Line, as it is known beforehand: with the title of a scene, since it is the truth here."""
    return nominal_scene(known_world(load_scene("line", None, 0)))


@pytest.fixture(scope="module")
def noisy():
    return load_scene("line", None, 0)


def test_the_tracking_law_is_the_plan_where_the_base_is_on_it():
    pose, twist = np.array([1.0, 2.0, 0.7]), np.array([0.5, -0.3])
    np.testing.assert_array_equal(tracking_twist(pose, pose, twist), twist)


@pytest.mark.parametrize("start", [(0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, -0.1, 0.3), (-0.1, 0.1, -0.3)])
def test_the_tracking_law_brings_the_base_back_to_a_moving_plan(start):
    plan, base, twist = np.zeros(3), np.array(start), np.array([0.5, 0.2])
    for _ in range(200):
        v, w = tracking_twist(base, plan, twist)
        base, plan = drive(base, v, w, 0.05), drive(plan, *twist, 0.05)
    np.testing.assert_allclose(base, plan, atol=2e-3)


@pytest.mark.parametrize("start", [(-0.5, 0.1, 0.2), (0.5, -0.1, -0.2), (0.1, 0.4, 0.0)])
def test_a_base_that_is_late_goes_on_to_the_end_of_the_plan(start):
    base, end = np.array(start), np.zeros(3)
    for _ in range(400):
        v, w = docking_twist(base, end)
        base = drive(base, v, w, 0.05)
    assert np.hypot(*base[:2]) < 0.05
    assert abs(base[2]) < 0.01


def test_it_needs_somebody_to_rehearse_with():
    known, twin = known_world(load_scene("line", None, 0)), Twin(load_scene("line", None, 0))
    with pytest.raises(MethodError, match="rehearsal"):
        OPEN_LOOP.planner(PlannerParts(known=known, parameters=twin.loop.planner.parameters))
    with pytest.raises(MethodError, match="rehearsal"):
        OPEN_LOOP.arm(ArmParts(known=known, parameters=twin.loop.manipulator.parameters))


def test_in_the_world_that_was_rehearsed_it_does_what_the_paper_s_method_does(quiet):
    ours, planned = run_scene(quiet, method=MOTM), run_scene(quiet, method=OPEN_LOOP)
    assert ours["success"]
    assert planned["success"]
    assert planned["picks_done"] == 1
    assert planned["time_s"] == ours["time_s"]
    assert planned["path_length_m"] == pytest.approx(ours["path_length_m"], abs=2e-3)


def test_it_looks_at_nothing_and_misses_a_cube_that_was_moved(quiet):
    moved = msgspec.structs.replace(quiet, tasks=quiet.tasks[:1], faults=Faults(cube_moved_by=0.08))
    assert run_scene(moved)["picks_done"] == 1
    planned = run_scene(moved, method=OPEN_LOOP)
    assert not planned["success"]
    assert planned["picks_done"] == 0
    assert "nothing in the gripper" in planned["reason"]


def test_a_grasp_that_takes_longer_than_rehearsed_is_not_waited_for(quiet):
    late = msgspec.structs.replace(quiet, tasks=quiet.tasks[:1], faults=Faults(grasp_delay=3.0))
    assert run_scene(late)["success"]
    assert run_scene(late, method=OPEN_LOOP)["picks_done"] == 0


def test_it_is_copied_and_restored_with_its_plan(noisy):
    twin = Twin(noisy, method=OPEN_LOOP)
    for _ in range(40):
        twin.advance()
    then = twin.snapshot()
    for _ in range(40):
        twin.advance()
    after = twin.state_hash()
    again = Twin(noisy, method=OPEN_LOOP)
    again.restore(then)
    for _ in range(40):
        again.advance()
    assert again.state_hash() == after


def test_a_person_who_changes_the_task_list_gets_a_new_plan(quiet):
    tray, tasks = Bin(name="tray", centre=(4.2, 0.7)), (Pick(object="cube"), Place(bin="tray"))
    twin = Twin(msgspec.structs.replace(quiet, bins=(tray,), tasks=tasks), method=OPEN_LOOP)
    for _ in range(40):
        twin.advance()
    twin.post(InsertTask(tasks=(DriveTo(point=(4.5, -1.0)),)))
    while not twin.done and twin.index < 500:
        tick = twin.advance()
    assert twin.done
    assert [task.status for task in tick.tasks] == ["done"] * 3
    assert tick.truth.places == 1
    assert np.hypot(*(tick.observation.pose[:2] - (4.5, -1.0))) < 0.2
