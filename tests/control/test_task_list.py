"""Changing the task list while it is worked through."""

import math

import pytest

from motm_twin.control.sequence import SequenceParameters, TaskSequence
from motm_twin.control.task_list import titled
from motm_twin.model.edits import InsertTask, MoveTask, RemoveTask
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Bin, DriveTo, Pick, Place, SceneObject
from motm_twin.model.scene_format import MOST_TASKS

LIMITS = SequenceParameters()
TASKS = (Pick(object="a"), Place(bin="left"), Pick(object="b"), Place(bin="right"))
CORNER = DriveTo(point=(1.0, 1.0))


def cube(name):
    return SceneObject(name=name, position=(0.0, 0.0, 0.5), side=0.04)


def box(name):
    return Bin(name=name, centre=(0.0, 0.0), side=0.3, floor_z=0.5, rim_z=0.6, wall=0.01)


KNOWN = KnownWorld(
    robot=RobotProfile(),
    start=(0.0, 0.0, 0.0),
    solids=(),
    objects=tuple(cube(name) for name in ("a", "b", "c", "cube_d")),
    object_sd=0.03,
    bins=(box("left"), box("right")),
    tasks=TASKS,
    bounds=(-2.0, -2.0, 2.0, 2.0),
)


def sequence(*outcomes):
    tasks = TaskSequence(KNOWN)
    for outcome in outcomes:
        tasks.apply(outcome, 1.0)
    return tasks


def edit(tasks, change, *, engaged=False):
    return tasks.edit(change, KNOWN, engaged=engaged)


def words(tasks):
    marks = {"done": "+", "active": ">", "waiting": "", "failed": "!"}
    return [marks[state.status] + titled(task) for task, state in zip(tasks.tasks, tasks.report(), strict=True)]


PAIR = (Pick(object="c"), Place(bin="left"))


def test_a_pair_is_added_at_the_end():
    tasks = sequence("picked")
    assert not edit(tasks, InsertTask(tasks=PAIR))
    assert words(tasks) == ["+pick a", ">place in left", "pick b", "place in right", "pick c", "place in left"]


def test_a_drive_before_the_active_task_becomes_the_active_one():
    tasks = sequence()
    assert edit(tasks, InsertTask(tasks=(CORNER,), index=0))
    assert words(tasks)[:2] == [">drive to (1.00, 1.00)", "pick a"]
    assert tasks.report()[1].attempts == 1


def test_a_drive_between_a_pick_and_its_place_carries_the_object_along():
    tasks = sequence("picked")
    edit(tasks, InsertTask(tasks=(CORNER,), index=1))
    assert words(tasks)[:3] == ["+pick a", ">drive to (1.00, 1.00)", "place in left"]


def test_what_the_arm_is_at_is_finished_before_an_inserted_task():
    tasks = sequence()
    assert not edit(tasks, InsertTask(tasks=(CORNER,), index=0), engaged=True)
    assert words(tasks)[:3] == [">pick a", "drive to (1.00, 1.00)", "place in left"]
    tasks = sequence()
    assert not edit(tasks, InsertTask(tasks=PAIR, index=0), engaged=True)
    assert words(tasks)[:4] == [">pick a", "place in left", "pick c", "place in left"]


def test_a_list_that_has_ended_goes_on_with_new_tasks():
    tasks = sequence("picked", "placed", "picked", "placed")
    assert tasks.done
    assert edit(tasks, InsertTask(tasks=PAIR))
    assert not tasks.done
    assert tasks.active == PAIR[0]


@pytest.mark.parametrize("engaged", [False, True])
def test_a_list_that_has_ended_takes_a_task_while_the_arm_still_rises(engaged):
    """It raised an IndexError: the arm counted as at work on a task after the last."""
    tasks = sequence("picked", "placed", "picked", "placed")
    assert edit(tasks, InsertTask(tasks=PAIR), engaged=engaged)
    assert tasks.active == PAIR[0]


def test_only_what_is_still_to_do_counts_towards_the_most_tasks():
    """Ended tasks counted, too: after sixty in its life, a robot took no more."""
    tasks = sequence("picked", "placed", "picked", "placed")
    edit(tasks, InsertTask(tasks=(CORNER,) * MOST_TASKS))
    with pytest.raises(ValueError, match="still to do"):
        edit(tasks, InsertTask(tasks=(CORNER,)))


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (InsertTask(tasks=()), "no task"),
        (InsertTask(tasks=(Pick(object="c"),)), "no place"),
        (InsertTask(tasks=(Place(bin="left"),)), "nothing held"),
        (InsertTask(tasks=PAIR, index=1), "held"),
        (InsertTask(tasks=PAIR, index=9), "index is 0 to 4"),
        (InsertTask(tasks=(Pick(object="cube_e"), Place(bin="left"))), "cube_d"),
        (InsertTask(tasks=(Pick(object="c"), Place(bin="rihgt"))), "right"),
        (InsertTask(tasks=(Pick(object="b"), Place(bin="left"))), "another task"),
        (InsertTask(tasks=(DriveTo(point=(9.0, 0.0)),)), "outside the map"),
        (InsertTask(tasks=(DriveTo(point=(math.nan, 0.0)),)), "finite"),
        (InsertTask(tasks=(DriveTo(point=(0.0, 0.0), tolerance=0.0),)), "tolerance"),
        (InsertTask(tasks=(CORNER,) * MOST_TASKS), str(MOST_TASKS)),
        (RemoveTask(index=-1), "no task -1"),
        (RemoveTask(index=4), "no task 4"),
        (MoveTask(index=0, to=7), "index is 0 to 4"),
        (MoveTask(index=2, to=1), "held"),
    ],
)
def test_a_change_that_the_robot_could_not_work_through_is_refused_and_changes_nothing(change, word):
    tasks = sequence()
    before = tasks.snapshot()
    with pytest.raises(ValueError, match=word):
        edit(tasks, change)
    assert tasks.snapshot() == before


@pytest.mark.parametrize("change", [InsertTask(tasks=PAIR, index=1), RemoveTask(index=0), MoveTask(index=0, to=4)])
def test_tasks_that_have_ended_stay(change):
    tasks = sequence("picked", "placed")
    with pytest.raises(ValueError, match="has ended"):
        edit(tasks, change)


def test_removing_either_half_of_a_pair_removes_both():
    for index in (2, 3):
        tasks = sequence()
        edit(tasks, RemoveTask(index=index))
        assert words(tasks) == [">pick a", "place in left"]


@pytest.mark.parametrize("index", [0, 2])
def test_removing_either_half_of_a_pair_removes_both_past_a_drive(index):
    tasks = sequence()
    edit(tasks, InsertTask(tasks=(CORNER,), index=1))
    edit(tasks, RemoveTask(index=index))
    assert words(tasks) == [">drive to (1.00, 1.00)", "pick b", "place in right"]


def test_after_a_pick_that_was_given_up_before_a_drive_the_list_can_be_changed():
    tasks = sequence()
    edit(tasks, InsertTask(tasks=(CORNER,), index=1))
    for _ in range(LIMITS.most_attempts - 1):
        tasks.apply("missed", 1.0)
    edit(tasks, InsertTask(tasks=PAIR, index=2))
    edit(tasks, RemoveTask(index=4))
    assert words(tasks) == ["!pick a", "!place in left", ">pick c", "place in left", "pick b", "place in right"]


def test_removing_the_active_task_goes_on_with_the_next():
    tasks = sequence()
    assert edit(tasks, RemoveTask(index=0))
    assert words(tasks) == [">pick b", "place in right"]


@pytest.mark.parametrize("change", [RemoveTask(index=1), MoveTask(index=0, to=4)])
def test_what_the_arm_is_at_is_neither_removed_nor_moved(change):
    tasks = sequence()
    with pytest.raises(ValueError, match="arm is at work"):
        edit(tasks, change, engaged=True)


def test_a_pair_is_moved_together_with_the_drive_between():
    tasks = sequence()
    edit(tasks, InsertTask(tasks=(CORNER,), index=1))
    edit(tasks, MoveTask(index=0, to=5))
    assert words(tasks) == [">pick b", "place in right", "pick a", "drive to (1.00, 1.00)", "place in left"]
    edit(tasks, MoveTask(index=4, to=0))
    assert words(tasks) == [">pick a", "drive to (1.00, 1.00)", "place in left", "pick b", "place in right"]


def test_a_move_to_where_it_is_changes_nothing():
    for to in (2, 3, 4):
        tasks = sequence()
        assert not edit(tasks, MoveTask(index=2, to=to))
        assert words(tasks) == [">pick a", "place in left", "pick b", "place in right"]


def test_an_object_without_a_place_waits_for_one():
    tasks = sequence("picked")
    edit(tasks, RemoveTask(index=1))
    assert words(tasks) == ["+pick a", ">pick b", "place in right"]
    assert tasks.active is None, "nothing is picked with a full gripper"
    assert tasks.following is None
    with pytest.raises(ValueError, match="a is held"):
        edit(tasks, InsertTask(tasks=PAIR))
    edit(tasks, InsertTask(tasks=(CORNER,), index=1))
    assert tasks.active == CORNER
    edit(tasks, InsertTask(tasks=(Place(bin="right"),), index=1))
    assert tasks.active == Place(bin="right")
    tasks.apply("placed", 2.0)
    assert tasks.active == CORNER


def test_an_object_may_be_picked_again_after_its_first_pair_has_ended():
    tasks = sequence("picked", "placed")
    edit(tasks, InsertTask(tasks=(Pick(object="a"), Place(bin="right"))))
    for outcome in ("picked", "placed", "picked"):
        tasks.apply(outcome, 3.0)
    assert tasks.held == "a"
    tasks.apply("lost", 4.0)
    assert tasks.index == 4, "it goes back to the newest pick of the object, not to the first"


def test_a_lost_object_without_a_place_is_forgotten():
    tasks = sequence("picked")
    edit(tasks, RemoveTask(index=1))
    assert tasks.apply("lost", 2.0)[0].kind == "lost"
    assert tasks.held == ""
    assert tasks.active == Pick(object="b")


def test_a_drive_to_a_point_that_stays_blocked_is_given_up():
    tasks = sequence()
    edit(tasks, InsertTask(tasks=(CORNER,), index=0))
    elsewhere = KNOWN_START
    tasks.watch(0.0, False, elsewhere, blocked="not free")
    assert not tasks.watch(LIMITS.closest_limit - 0.1, False, elsewhere, blocked="not free")
    events = tasks.watch(LIMITS.closest_limit + 0.1, False, elsewhere, blocked="not free")
    assert "not free" in events[0].text
    assert tasks.active == TASKS[0]


KNOWN_START = (0.0, 0.0, 0.0)
