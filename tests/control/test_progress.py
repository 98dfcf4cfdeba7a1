"""Nothing waits or circles for ever: the progress clock, what is tried when it runs, and how it ends."""

import math

import numpy as np
import pytest

from motm_twin.control.parameters import Parameters
from motm_twin.control.progress import Progress, ProgressParameters, ProgressState
from motm_twin.control.sequence import SequenceParameters, TaskSequence
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import AddObstacle, InsertTask, RemoveTask
from motm_twin.model.known import known_world
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import DriveTo
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import BasePlan, Placement
from motm_twin.twin import Twin

PERIOD = 0.05
HERE = np.zeros(3)
TRIES, LIMITS = ProgressParameters(), SequenceParameters()


def standing(cost, goal=(2.0, 0.0, 0.0)):
    """Placement and plan of a base that needs so long [s] to its place."""
    goal, costs = np.array(goal), np.array([cost])
    placement = Placement(
        mode="drive", radius=0.0, poses=goal[None], cost_current=costs, cost_next=costs, cost=costs, rejected=("",),
        chosen=0, goal=goal, goal_has_heading=False, why=Reason(kind=Kind.DRIVE), next_goal=None,
    )  # fmt: skip
    nowhere = np.zeros((0, 2))
    plan = BasePlan(
        acceleration=np.zeros(2), status="braking", global_path=nowhere, next_path=nowhere,
        intermediate_goal=goal, local_poses=np.zeros((1, 5)), local_times=np.zeros(1), bezier=nowhere, expansions=1,
        cut_by_clock=False, t_h=math.inf, k=1.0, time_to_range=math.inf,
    )  # fmt: skip
    return placement, plan


@pytest.fixture
def clock():
    return Progress(ProgressState(), PERIOD)


def run(clock, start, seconds, way_at, goal_at=lambda time: (2.0, 0.0, 0.0), at=HERE):
    """Periods from a time on; time [s] without progress at their end."""
    for k in range(round(seconds / PERIOD)):
        time = start + k * PERIOD
        stalled = clock.watch(time, 0, at, *standing(way_at(time), goal_at(time)), counts=True)
    return stalled


def test_a_base_that_gets_nearer_is_left_alone(clock):
    assert run(clock, 0.0, 40.0, lambda time: 50.0 - time) < 0.5
    recovery = clock.recovery(40.0)
    assert recovery.tightness == 0.0
    assert not recovery.back_off


def test_without_progress_it_backs_off_then_needs_less_room_then_goes_elsewhere(clock):
    run(clock, 0.0, TRIES.back_off + 0.2, lambda time: 5.0)
    assert clock.recovery(TRIES.back_off + 0.2).back_off
    run(clock, TRIES.back_off + 0.2, TRIES.tight - TRIES.back_off, lambda time: 5.0)
    assert 0.0 < clock.recovery(TRIES.tight + 0.2).tightness < 1.0
    assert clock.recovery(TRIES.tightest + 0.2).tightness == 1.0
    run(clock, TRIES.tight + 0.2, TRIES.elsewhere - TRIES.tight + 1.0, lambda time: 5.0)
    assert clock.recovery(TRIES.elsewhere + 1.0).avoid.tolist() == [[2.0, 0.0, 0.0]]


def test_a_base_that_stands_although_there_is_a_way_backs_off_one_way_after_the_other_and_once_more(clock):
    run(clock, 0.0, TRIES.back_off + 0.1, lambda time: 5.0)
    assert clock.recovery(TRIES.back_off + 0.1).attempt == 1
    run(clock, TRIES.back_off + 0.1, 1.0, lambda time: 5.0)
    assert clock.recovery(TRIES.back_off + 1.1).attempt == 3
    run(clock, TRIES.back_off + 1.1, 0.8, lambda time: 5.0, at=np.array([-0.1, 0.0, 0.0]))
    assert clock.recovery(TRIES.back_off + 1.9).attempt == 4  # it moves, but has been there for half a second now
    run(clock, TRIES.look, TRIES.elsewhere - TRIES.look + 0.1, lambda time: 5.0)
    recovery = clock.recovery(TRIES.elsewhere + 0.1)
    assert recovery.back_off
    assert recovery.attempt == 1


def test_a_base_that_drives_about_tries_no_way_back(clock):
    for k in range(round(4.0 / PERIOD)):
        at = np.array([0.1 * k, 0.0, 0.0])
        clock.watch(k * PERIOD, 0, at, *standing(5.0, (2.0, 0.0, 0.0)), counts=True)
    assert clock.recovery(3.9).back_off
    assert clock.recovery(3.9).attempt == 0


def test_a_way_that_needs_little_room_is_kept_until_it_is_behind_the_base(clock):
    run(clock, 0.0, TRIES.tightest + 1.0, lambda time: 5.0)
    begin = TRIES.tightest + 1.0
    run(clock, begin, 1.0, lambda time: 4.5 - (time - begin))
    assert clock.recovery(begin + 1.0).tightness == 1.0
    run(clock, begin + 1.0, TRIES.tightest + 2.0, lambda time: 3.0)
    assert clock.recovery(begin + TRIES.tightest + 30.0).tightness == 1.0  # stands again
    assert Progress(ProgressState(), PERIOD).recovery(0.0).tightness == 0.0


def test_a_place_that_needs_little_room_is_kept_while_the_arm_works_there(clock):
    """The room came back when the arm began, the place was none any more, and so on every 6 s for ever."""
    run(clock, 0.0, TRIES.tight + 0.5, lambda time: 5.0)
    placement, plan = standing(5.0)
    for k in range(round(10.0 / PERIOD)):
        clock.watch(TRIES.tight + 0.5 + k * PERIOD, 0, HERE, placement, plan, counts=False)
        assert clock.recovery(TRIES.tight + 0.5 + k * PERIOD).tightness > 0.0


def test_a_base_that_circles_makes_no_progress(clock):
    """Another place, and the way to it became shorter: again and again for a minute."""

    def goal(time):
        return (2.0, 0.0, 0.0) if int(time / 4.0) % 2 else (0.0, 2.0, 0.0)

    stalled = run(clock, 0.0, 60.0, lambda time: 5.0 - time % 4.0, goal)
    assert stalled > 60.0 - 4.0 * (TRIES.relocations + 2)


def test_time_in_which_the_arm_works_does_not_count(clock):
    run(clock, 0.0, 10.0, lambda time: 5.0)
    placement, plan = standing(5.0)
    assert clock.watch(10.0, 0, HERE, placement, plan, counts=False) == 0.0
    assert run(clock, 10.05, 2.0, lambda time: 5.0) < 2.1


def test_a_task_without_progress_is_put_off_once_then_given_up():
    sequence = TaskSequence(known_world(load_scene("exp1", "trial1", 0)))
    first = sequence.report()[0].target
    pose = np.zeros(3)
    assert not sequence.hold_up(1.0, LIMITS.other_order - 1.0, None, pose)
    (event,) = sequence.hold_up(2.0, LIMITS.other_order + 0.1, Reason(kind=Kind.CLOSED_IN, subject=first), pose)
    assert event.kind == "postponed"
    assert "obstacles block every way" in event.text
    assert sequence.report()[0].target != first
    assert [task.target for task in sequence.report()].count(first) == 1
    assert sequence.report()[-2].target == first
    while sequence.report()[sequence.index].target != first:
        sequence.hold_up(3.0, LIMITS.other_order + 0.1, None, pose)
    assert not sequence.hold_up(4.0, LIMITS.no_progress - 1.0, None, pose)
    (event,) = sequence.hold_up(5.0, LIMITS.no_progress + 0.1, None, pose)
    assert event.kind == "failed"
    assert "no progress" in event.text


def test_a_task_that_a_person_puts_first_gets_the_whole_time(tmp_path):
    """The clock of the task before ran on: the new one was put off 50 ms after it had come into the list."""
    path = tmp_path / "walled_in.yaml"
    path.write_text(SCENE)
    hasty = Parameters(sequence=SequenceParameters(other_order=1.0))
    twin = Twin(load_scene(str(path), None, 0), numbers=hasty)
    twin.post(RemoveTask(index=1))
    for i, (x, y, size) in enumerate([(0.75, 0.0, (0.3, 2.0)), (-0.75, 0.0, (0.3, 2.0))]):
        twin.post(AddObstacle(name=f"side{i}", x=x, y=y, size=(*size, 0.8)))
    for i, y in enumerate((0.65, -0.65)):
        twin.post(AddObstacle(name=f"end{i}", x=0.0, y=y, size=(1.1, 0.3, 0.8)))
    for _ in range(40):
        twin.advance()
    twin.post(InsertTask(tasks=(DriveTo(point=(-1.5, 1.5)),), index=0))
    ticks = [twin.advance() for _ in range(30)]
    put_off = [event.time - ticks[0].time for tick in ticks for event in tick.events if event.kind == "postponed"]
    assert put_off == [pytest.approx(1.0, abs=0.1)]


SCENE = """
format: motm-scene/1
robot: frankie
tasks: [{drive_to: {x: 3.0, y: 0.0}}, {drive_to: {x: 0.0, y: 1.0}}]
time_limit: 40
"""


@pytest.mark.parametrize("shape", ["box", "person"])
def test_a_drive_to_a_place_that_is_taken_is_given_up_and_the_next_one_done(tmp_path, shape):
    """The base circled round whatever stood there for a minute, with 10 to 39 reversals."""
    path = tmp_path / "taken.yaml"
    path.write_text(SCENE)
    twin = Twin(load_scene(str(path), None, 0), method=find_method("fast"))
    reversals, sign, given_up = 0, 0, math.inf
    while True:
        tick = twin.advance()
        if tick.index == 20:
            twin.post(AddObstacle(name="in_the_way", shape=shape, x=3.0, y=0.0))
        v = tick.observation.twist[0]
        now = 0 if abs(v) < 0.03 else int(math.copysign(1, v))
        reversals += bool(now and sign and now != sign)
        sign = now or sign
        given_up = min([given_up, *(event.time for event in tick.events if event.kind == "failed")])
        if tick.done or tick.time > 40.0:
            break
    assert tick.done
    assert given_up < 20.0
    assert reversals <= 3
    assert not tick.truth.contacts
    assert [task.status for task in tick.tasks] == ["failed", "done"]


GAP = """
format: motm-scene/1
robot: frankie
tasks: [{drive_to: {x: 3.0, y: 0.3}}]
time_limit: 40
bounds: [-2, -3, 5, 3]
furniture:
  low: {shape: box, centre: [1.5, -1.66], size: [0.1, 2.68], z: [0.0, 1.0]}
  high: {shape: box, centre: [1.5, 1.64], size: [0.1, 2.72], z: [0.0, 1.0]}
"""


def test_a_gap_that_is_wider_than_the_footprint_by_a_hand_is_found_when_there_is_no_other_way(tmp_path):
    path = tmp_path / "gap.yaml"
    path.write_text(GAP)
    twin = Twin(load_scene(str(path), None, 0), method=find_method("fast"))
    while True:
        tick = twin.advance()
        if tick.done or tick.time > 40.0:
            break
    assert tick.success
    assert not tick.truth.contacts
