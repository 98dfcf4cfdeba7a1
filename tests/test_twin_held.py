"""What the gripper holds goes into a bin before anything else is picked."""

import dataclasses

import msgspec
import pytest
from twin_steps import BIN, CUBE, FOUR, SCENE, SHORT, advance, advance_until, caused, holding, short

from motm_twin.control.parameters import Parameters
from motm_twin.control.sequence import SequenceParameters
from motm_twin.model.edits import InsertTask, MoveObject, PushRobot
from motm_twin.model.scene import Pick, Place
from motm_twin.planning.candidates import is_avoided
from motm_twin.twin import Twin

OTHER, SECOND = SCENE.tasks[3].bin, SCENE.tasks[2].object


@pytest.fixture(scope="module")
def given_up():
    """A twin whose first bin is narrower than the cube and was given up, its state then, the Ticks of both failures."""
    bins = tuple(msgspec.structs.replace(item, side=0.05) if item.name == BIN else item for item in SCENE.bins)
    hasty = Parameters(sequence=SequenceParameters(stall_limit=2.0))
    twin = Twin(msgspec.structs.replace(FOUR, bins=bins), numbers=hasty)
    missed, failed = (
        advance_until(twin, lambda tick, kind=kind: any(event.kind == kind for event in tick.events))
        for kind in ("missed", "failed")
    )
    return twin, twin.snapshot(), missed, failed


@pytest.fixture
def narrow(given_up):
    """Such a twin, on its way to the other bin."""
    twin, state, *_ = given_up
    twin.restore(state)
    return twin


def states(tick):
    return {body.name: body.state for body in tick.truth.objects}


def test_a_base_whose_arm_was_stuck_stands_elsewhere_for_the_next_try():
    """The arm began anew from where it had not got there, again and again, until the pick was given up."""
    twin = Twin(SHORT)
    rules = twin.loop.manipulator._usual
    hasty = msgspec.structs.replace(rules.parameters, patience=0.1)
    twin.loop.manipulator._usual = dataclasses.replace(rules, parameters=hasty)
    tick = advance_until(twin, lambda tick: any(step.outcome == "stuck" for step in tick.arm))
    twin.loop.manipulator._usual = rules
    was, target = tick.observation.pose[None], tick.tasks[0].target
    assert twin.advance().tasks[0].status == "active"
    tick = advance_until(twin, lambda tick: not is_avoided(tick.observation.pose, was))
    tick = advance_until(twin, lambda tick: any(step.outcome == "picked" for step in tick.arm))
    assert states(tick)[target] == "held"
    assert twin.loop._problem(tick.observation, tick.map).stuck_at.shape == (0, 3)  # a new target, a new try


def test_where_the_arm_was_stuck_says_nothing_about_the_task_after_one_that_was_put_off():
    """Both have the same number in the list, and the base kept away from a good place."""
    twin = Twin(FOUR, numbers=Parameters(sequence=SequenceParameters(other_order=0.1)))
    tick = twin.advance()
    twin.loop._state.stuck_at = ((tick.task_index, tick.observation.pose),)
    tick = advance_until(twin, lambda tick: any(event.kind == "postponed" for event in tick.events))
    assert tick.task_index == 0
    assert twin.loop._problem(tick.observation, tick.map).stuck_at.shape == (0, 3)


def test_a_cube_that_its_bin_does_not_take_goes_to_the_other_bin_before_the_next_pick(narrow, given_up):
    """The next pick stalled ("an object is already held") until it was given up, and its bin got the wrong cube."""
    *_, missed, tick = given_up
    assert "trying again" in missed.events[0].text
    assert (missed.tasks[missed.task_index].target, missed.tasks[missed.task_index].attempts) == (BIN, 2)
    assert tick.events[0].text.endswith(f"{CUBE} goes to {OTHER} instead")
    reasons = set()
    while not tick.done:
        tick = narrow.advance()
        reasons.add(tick.stop_reason)
        assert tick.time < 90.0, tick.stop_reason
    assert not any("held already" in reason for reason in reasons)
    tick = advance(narrow, 40)
    assert states(tick)[CUBE] == states(tick)[SECOND] == f"binned:{OTHER}"
    assert [task.status for task in tick.tasks] == ["done", "failed", "done", "done", "done"]
    assert not tick.success
    assert tick.truth.places == 1, "the referee goes by the list of the person"
    assert not caused(tick)


@pytest.mark.parametrize("disturbance", [MoveObject(name=CUBE, x=3.4, y=1.47), PushRobot(dx=-0.1, dy=0.1, turn=0.2)])
def test_a_disturbance_on_the_way_to_the_other_bin_does_not_change_where_the_cube_goes(narrow, disturbance):
    advance(narrow, 20)
    narrow.post(disturbance)
    advance_until(narrow, lambda tick: tick.tasks[2].target == OTHER and tick.tasks[2].status == "done", 1200)
    tick = advance(narrow, 40)
    assert states(tick)[CUBE] == f"binned:{OTHER}"
    assert [task.status for task in tick.tasks[:3]].count("failed") == 1


@pytest.mark.parametrize("phase", ["closing", "lift"])
def test_a_pick_whose_time_is_up_is_finished_when_the_fingers_have_the_cube(monkeypatch, phase):
    """The pick was given up, and the next one took the cube in the fingers for its own."""
    twin, _ = short(phase, FOUR)
    monkeypatch.setattr(twin.loop.sequence, "limits", SequenceParameters(stall_limit=0.0))
    twin.advance()
    monkeypatch.undo()
    tick = advance_until(twin, lambda tick: any(event.kind == "picked" for event in tick.events), 60)
    assert tick.events[0].text == f"picked {CUBE}"
    assert states(tick)[CUBE] == "held"
    assert not twin.loop.sequence.failures


def test_a_place_whose_time_is_up_is_finished_when_the_fingers_let_go(monkeypatch):
    twin, _ = short("release", FOUR)
    advance_until(twin, lambda tick: tick.arm[-1].actuation.gripper == "open")
    monkeypatch.setattr(twin.loop.sequence, "limits", SequenceParameters(stall_limit=0.0, place_attempts=1))
    twin.advance()
    monkeypatch.undo()
    tick = advance_until(twin, lambda tick: tick.truth.places == 1, 40)
    assert [task.status for task in tick.tasks[:2]] == ["done", "done"]


def test_what_is_held_cannot_be_put_into_the_list_to_be_picked_again():
    """It lay in its bin when its turn came, and the arm reached in after it."""
    twin = holding()
    with pytest.raises(ValueError, match=f"{CUBE} is in the gripper already"):
        twin.post(InsertTask(tasks=(Pick(object=CUBE), Place(bin=OTHER))))
