"""The task sequence."""

import msgspec
import numpy as np

from motm_twin.control.sequence import SequenceParameters, TaskSequence
from motm_twin.model.edits import InsertTask
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Bin, DriveTo, Pick, Place

LIMITS = SequenceParameters()
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
    for _ in range(LIMITS.most_attempts - 1):
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
    tasks.watch(LIMITS.stall_limit - 1.0, True, ELSEWHERE)
    assert tasks.index == 0
    tasks.watch(LIMITS.stall_limit + 1.0, True, ELSEWHERE)
    assert tasks.index == 2
    assert "in reach" in tasks.failures[0]


def test_the_reason_is_what_the_arm_waited_for_most_and_neither_the_last_nor_that_it_starts_over():
    tasks = sequence()
    for k in range(int(LIMITS.stall_limit) + 2):
        held = Reason(kind=Kind.HELD_OFF, subject="hand", other="static obstacle", value=0.1 + 0.01 * k)
        why = held if k % 3 == 0 else Reason(kind=Kind.STARTS_OVER)
        last = Reason(kind=Kind.WAITS_FOR_SIGHT, subject="cube1")
        tasks.watch(float(k), True, ELSEWHERE, why=last if k == LIMITS.stall_limit + 1 else why)
    assert "not done: the hand keeps off a static obstacle, 0.40 m away" in tasks.failures[0]


def test_being_out_of_reach_for_long_starts_the_stall_clock_again():
    tasks = sequence()
    tasks.watch(0.0, True, ELSEWHERE)
    tasks.watch(LIMITS.stall_limit - LIMITS.out_of_reach - 2.0, False, ELSEWHERE)
    tasks.watch(LIMITS.stall_limit - 1.0, False, ELSEWHERE)
    tasks.watch(LIMITS.stall_limit, True, ELSEWHERE)
    tasks.watch(LIMITS.stall_limit + 5.0, True, ELSEWHERE)
    assert tasks.index == 0


def test_a_base_that_swings_in_and_out_of_reach_does_not_stop_the_stall_clock():
    tasks = sequence()
    for k in range(int(LIMITS.stall_limit) + 3):
        tasks.watch(float(k), k % 2 == 0, ELSEWHERE)
    assert tasks.index == 2
    assert "in reach" in tasks.failures[0]


DRIVE_BETWEEN = (Pick(object="a"), DriveTo(point=(0.0, 0.0)), Place(bin="bin1"), Pick(object="b"), Place(bin="bin2"))


def test_a_pick_that_is_given_up_takes_its_place_along_past_a_drive():
    tasks = sequence(DRIVE_BETWEEN)
    for _ in range(LIMITS.most_attempts - 1):
        tasks.apply("missed", 1.0)
    assert tasks.tasks[:3] == (DRIVE_BETWEEN[0], DRIVE_BETWEEN[2], DRIVE_BETWEEN[1])
    assert [task.status for task in tasks.report()] == ["failed", "failed", "active", "waiting", "waiting"]
    tasks.watch(2.0, False, np.zeros(3))
    assert tasks.active == DRIVE_BETWEEN[3]
    assert len(tasks.failures) == 1


def test_an_object_lost_too_often_takes_its_place_along_past_a_drive():
    tasks = sequence(DRIVE_BETWEEN)
    for _ in range(LIMITS.most_attempts - 1):
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
    assert not tasks.watch(LIMITS.closest_limit - 0.1, False, ELSEWHERE, outside=True)
    (event,) = tasks.watch(LIMITS.closest_limit + 0.1, False, ELSEWHERE, outside=True)
    assert "outside the map" in event.text
    assert tasks.active == TASKS[2]


def test_a_pose_is_only_reached_with_its_heading():
    tasks = sequence()
    for outcome in ("picked", "placed", "picked", "placed"):
        tasks.apply(outcome, 1.0)
    tasks.watch(2.0, False, np.array([1.0, 0.0, 1.5]))
    assert not tasks.done


def two_bins() -> TaskSequence:
    """A sequence that holds "a", with two bins."""
    bins = tuple(
        Bin(name=name, centre=(x, 0.0), side=0.3, floor_z=0.5, rim_z=0.6, wall=0.01)
        for name, x in (("bin1", 1.0), ("bin2", 2.0))
    )
    tasks = TaskSequence(msgspec.structs.replace(sequence().known, bins=bins))
    tasks.apply("picked", 1.0)
    return tasks


def stall(tasks: TaskSequence, tries: int) -> str:
    """Let the active task make no progress so many times; text of the last event."""
    text = ""
    while tries:
        stalled = tasks.watch(1000.0 * tries, True, ELSEWHERE) or tasks.watch(1000.0 * tries + 31.0, True, ELSEWHERE)
        text, tries = stalled[0].text, tries - 1
        tasks._state.in_reach_since = None
    return text


def test_a_place_is_tried_again_before_what_is_held_goes_to_the_nearest_other_bin():
    tasks = two_bins()
    assert stall(tasks, LIMITS.place_attempts - 1).endswith("trying again")
    assert tasks.active == TASKS[1]
    assert stall(tasks, 1).endswith("a goes to bin2 instead")
    assert tasks.active == Place(bin="bin2")
    assert tasks.report()[1].status == "failed"
    tasks.apply("placed", 2.0)
    assert (tasks.active, tasks.refused) == (TASKS[2], ())


def test_what_no_bin_takes_is_kept_and_nothing_else_is_picked():
    tasks = two_bins()
    stall(tasks, LIMITS.place_attempts)
    assert stall(tasks, LIMITS.place_attempts).endswith("a stays in the gripper: there is no other bin")
    assert tasks.tasks[tasks.index] == TASKS[2]
    assert tasks.active is None
    assert tasks.refused == ("bin1", "bin2")
    assert not tasks.watch(9000.0, True, ELSEWHERE)
    tasks.edit(InsertTask(tasks=(Place(bin="bin1"),), index=tasks.index), tasks.known, engaged=False)
    assert tasks.active == Place(bin="bin1")


def test_a_bin_outside_the_map_is_not_tried_again():
    tasks = two_bins()
    tasks.watch(0.0, False, ELSEWHERE, outside=True)
    (event,) = tasks.watch(LIMITS.closest_limit + 0.1, False, ELSEWHERE, outside=True)
    assert event.text.endswith("a goes to bin2 instead")


def test_what_is_lost_on_its_way_to_the_other_bin_goes_there_after_all():
    tasks = two_bins()
    stall(tasks, LIMITS.place_attempts)
    tasks.apply("lost", 2.0)
    assert [task.status for task in tasks.report()[:3]] == ["failed", "active", "waiting"]
    assert tasks.active == TASKS[0]
    tasks.apply("picked", 3.0)
    assert tasks.active == Place(bin="bin2")
    assert len(tasks.failures) == 1


def test_nothing_is_given_up_while_the_fingers_are_at_work():
    tasks = sequence()
    tasks.watch(0.0, True, ELSEWHERE)
    assert not tasks.watch(LIMITS.stall_limit + 1.0, True, ELSEWHERE, busy=True)
    assert tasks.watch(LIMITS.stall_limit + 1.0, True, ELSEWHERE)
