"""The task sequence."""

import numpy as np

from motm_twin.control.sequence import MAX_ATTEMPTS, OUT_OF_REACH, OUTSIDE_LIMIT, STALL_LIMIT, TaskSequence
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import DriveTo, Pick, Place

TASKS = (
    Pick(object="a"),
    Place(bin="bin1"),
    Pick(object="b"),
    Place(bin="bin2"),
    DriveTo(point=(1.0, 0.0), heading=0.0),
)
ELSEWHERE = np.array([5.0, 5.0, 0.0])


def sequence(listed: tuple = TASKS) -> TaskSequence:
    return TaskSequence(
        KnownWorld(
            robot=RobotProfile(),
            start=(0.0, 0.0, 0.0),
            solids=(),
            objects=(),
            object_sd=0.0,
            bins=(),
            tasks=listed,
            bounds=(-1.0, -1.0, 1.0, 1.0),
        )
    )


def test_outcomes_lead_through_the_list_in_order():
    tasks = sequence()
    for outcome in ("picked", "placed", "picked", "placed"):
        assert tasks.apply(outcome, 1.0)
    assert tasks.active == TASKS[4]
    tasks.watch(2.0, False, np.array([1.05, 0.0, 0.1]))
    assert tasks.done
    assert not tasks.failures


def test_an_outcome_of_the_wrong_kind_changes_nothing():
    tasks = sequence()
    assert tasks.apply("placed", 1.0) == ()
    assert tasks.index == 0


def test_a_missed_grasp_is_tried_again_and_given_up_at_the_limit():
    tasks = sequence()
    for _ in range(MAX_ATTEMPTS - 1):
        assert tasks.index == 0
        tasks.apply("missed", 1.0)
    assert tasks.index == 2, "the place task of an object that was not picked is skipped"
    assert [task.status for task in tasks.report()[:3]] == ["failed", "failed", "active"]
    assert "a" in tasks.failures[0]


def test_a_lost_object_is_picked_again():
    tasks = sequence()
    tasks.apply("picked", 1.0)
    assert tasks.held == "a"
    tasks.apply("lost", 2.0)
    assert tasks.index == 0
    assert tasks.held == ""
    assert tasks.report()[0].attempts == 2


def test_a_task_in_reach_without_progress_is_given_up_with_a_reason():
    tasks = sequence()
    tasks.watch(0.0, True, ELSEWHERE)
    tasks.watch(STALL_LIMIT - 1.0, True, ELSEWHERE)
    assert tasks.index == 0
    tasks.watch(STALL_LIMIT + 1.0, True, ELSEWHERE)
    assert tasks.index == 2
    assert "in reach" in tasks.failures[0]


def test_being_out_of_reach_for_long_starts_the_stall_clock_again():
    tasks = sequence()
    tasks.watch(0.0, True, ELSEWHERE)
    tasks.watch(STALL_LIMIT - OUT_OF_REACH - 2.0, False, ELSEWHERE)
    tasks.watch(STALL_LIMIT - 1.0, False, ELSEWHERE)
    tasks.watch(STALL_LIMIT, True, ELSEWHERE)
    tasks.watch(STALL_LIMIT + 5.0, True, ELSEWHERE)
    assert tasks.index == 0


def test_a_base_that_swings_in_and_out_of_reach_does_not_stop_the_stall_clock():
    tasks = sequence()
    for k in range(int(STALL_LIMIT) + 3):
        tasks.watch(float(k), k % 2 == 0, ELSEWHERE)
    assert tasks.index == 2
    assert "in reach" in tasks.failures[0]


DRIVE_BETWEEN = (Pick(object="a"), DriveTo(point=(0.0, 0.0)), Place(bin="bin1"), Pick(object="b"), Place(bin="bin2"))


def test_a_pick_that_is_given_up_takes_its_place_along_past_a_drive():
    tasks = sequence(DRIVE_BETWEEN)
    for _ in range(MAX_ATTEMPTS - 1):
        tasks.apply("missed", 1.0)
    assert tasks.tasks[:3] == (DRIVE_BETWEEN[0], DRIVE_BETWEEN[2], DRIVE_BETWEEN[1])
    assert [task.status for task in tasks.report()] == ["failed", "failed", "active", "waiting", "waiting"]
    tasks.watch(2.0, False, np.zeros(3))
    assert tasks.active == DRIVE_BETWEEN[3]
    assert len(tasks.failures) == 1


def test_an_object_lost_too_often_takes_its_place_along_past_a_drive():
    tasks = sequence(DRIVE_BETWEEN)
    for _ in range(MAX_ATTEMPTS - 1):
        assert not tasks.failures
        tasks.apply("picked", 1.0)
        tasks.apply("lost", 2.0)
    assert "lost" in tasks.failures[0]
    assert [task.status for task in tasks.report()[1:3]] == ["failed", "active"]
    assert isinstance(tasks.tasks[1], Place)
    tasks.watch(3.0, False, np.zeros(3))
    assert tasks.active == DRIVE_BETWEEN[3]


def test_a_place_with_nothing_held_is_given_up_at_once():
    tasks = sequence((Place(bin="bin1"), Place(bin="bin2"), Pick(object="a"), Place(bin="bin1")))
    (event,) = tasks.watch(0.0, False, ELSEWHERE)
    assert "nothing is held" in event.text
    assert "bin1" in event.text
    tasks.watch(0.05, False, ELSEWHERE)
    assert tasks.active == Pick(object="a")
    assert len(tasks.failures) == 2


def test_a_target_that_stays_outside_the_map_is_given_up():
    tasks = sequence()
    tasks.watch(0.0, False, ELSEWHERE, outside=True)
    assert not tasks.watch(OUTSIDE_LIMIT - 0.1, False, ELSEWHERE, outside=True)
    (event,) = tasks.watch(OUTSIDE_LIMIT + 0.1, False, ELSEWHERE, outside=True)
    assert "outside the map" in event.text
    assert tasks.active == TASKS[2]


def test_a_pose_is_only_reached_with_its_heading():
    tasks = sequence()
    for outcome in ("picked", "placed", "picked", "placed"):
        tasks.apply(outcome, 1.0)
    tasks.watch(2.0, False, np.array([1.0, 0.0, 1.5]))
    assert not tasks.done
