"""Every fault from the message to its effect, to the sentence that names it, and to its end."""

import json
import math

import msgspec
import numpy as np
import pytest

from motm_twin.bus.commands import CommandGate, Refused
from motm_twin.model import bounds
from motm_twin.model.edits import InjectFault, PushRobot
from motm_twin.model.faults import DELAY, JOINT, KINDS, SECONDS, table
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.finding import KINDS as FINDINGS
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.studies.disturbances import CAUSES, noticeable
from motm_twin.twin import Twin

LASTS = 2.0  # [s]


@pytest.fixture(scope="module")
def moments():
    """Snapshots of one trial at the moments at which each kind of fault matters."""
    scene = load_scene("exp1", "trial1")
    twin, found = Twin(msgspec.structs.replace(scene, detections="named")), {}  # objects that can be swapped
    wanted = {kind: noticeable(kind) for kind in KINDS}
    while len(found) < len(wanted):
        tick = twin.advance()
        for kind, now in wanted.items():
            if kind not in found and tick.time > 3.0 and now(tick):
                found[kind] = (tick.time, twin.snapshot())
        assert tick.time < 30.0
    return twin, found


def kinds(twin):
    return {one.kind for one in twin.loop.self_check.findings}


@pytest.mark.parametrize("kind", KINDS)
def test_a_fault_is_named_within_a_second_hits_nothing_and_is_forgotten_when_it_is_over(moments, kind):
    twin, found = moments
    began, snapshot = found[kind]
    twin.restore(snapshot)
    assert kinds(twin) == set()
    twin.post(InjectFault(fault=kind, seconds=LASTS))
    named, shown, events, tick = None, "", [], None
    while tick is None or tick.time <= began + LASTS + 5.0:
        tick = twin.advance()
        events += [event for event in tick.events if event.kind == "fault"]
        if named is None and kinds(twin) & set(CAUSES[kind]):
            named, shown = tick.time - began, tick.stop_reason
    assert named is not None and named <= 1.0 + 1e-6
    assert shown and events
    assert kinds(twin) & set(CAUSES[kind]) == set()
    assert [contact for contact in tick.truth.contacts if contact.caused_by_robot] == []
    assert tick.truth.plant_faults == ()


def test_every_cause_is_a_kind_of_finding_and_every_fault_has_one():
    assert set(CAUSES) == set(KINDS)
    assert {cause for causes in CAUSES.values() for cause in causes} <= set(FINDINGS)


def test_a_pushed_robot_says_so_and_goes_on():
    twin = Twin(load_scene("exp1", "trial1"))
    while twin.index < 40:
        twin.advance()
    twin.post(PushRobot(dx=-0.15, dy=-0.2, turn=0.2))
    ticks = [twin.advance() for _ in range(60)]
    assert any("pushed" in tick.stop_reason for tick in ticks[:20])
    assert all("pushed" not in tick.stop_reason for tick in ticks[40:])
    assert max(abs(tick.observation.twist[0]) for tick in ticks[40:]) > 0.3


def ends():
    """The number of each kind at both ends of its bound, and the duration at both of its own."""
    for kind in KINDS.values():
        for seconds in (SECONDS.low, SECONDS.high):
            yield kind.name, {"seconds": seconds}
        if kind.number:
            for value in (kind.low, kind.high):
                yield kind.name, {kind.number: int(value) if kind.number == "joint" else value}


def beyond():
    """What lies just beyond every bound."""
    for kind in KINDS.values():
        yield kind.name, {"seconds": SECONDS.low - 0.01}
        yield kind.name, {"seconds": SECONDS.high + 0.1}
        yield kind.name, {"delay": -0.01}
        yield kind.name, {"delay": DELAY.high + 0.1}
        yield kind.name, {"joint": 0}
        yield kind.name, {"joint": int(JOINT.high) + 1}
        if kind.number == "amount":
            yield kind.name, {"amount": kind.low - 0.01}
            yield kind.name, {"amount": kind.high + 0.01}
        else:
            yield kind.name, {"amount": 0.5}


def message(fault, fields, seq):
    command = {"type": "inject_fault", "fault": fault, **fields}
    return json.dumps({"sender": "test", "seq": seq, "expires": 10.0, "command": command}).encode()


def admitted(fault, fields):
    return CommandGate(lambda: 0.0).admit("inject_fault", message(fault, fields, 1)).command


@pytest.fixture(scope="module")
def plant():
    plant = SimulatedPlant(load_scene("exp1", "trial1"))
    plant.step(0.2)
    return plant, plant.snapshot()


@pytest.mark.parametrize(("fault", "fields"), list(ends()))
def test_both_ends_of_every_bound_work_from_the_message_to_the_effect(plant, fault, fields):
    robot, start = plant
    robot.restore(start)
    robot.apply(admitted(fault, fields))
    one, kind = robot.snapshot().faults.on[fault], KINDS[fault]
    assert one.value == (fields[kind.number] if kind.number in fields else kind.usual)
    assert one.until - one.began == round(fields.get("seconds", 1.0) / 0.01)
    assert kind.phrase.format(one.value) in robot.truth().faults[0]
    robot.step(0.5)
    seen = robot.observe()
    assert math.isfinite(seen.time + float(seen.pose.sum() + seen.odometry.sum() + seen.twist.sum() + seen.q.sum()))
    assert robot.truth().plant_faults == ()


@pytest.mark.parametrize(("fault", "fields"), list(beyond()))
def test_what_the_gate_refuses_the_plant_refuses_with_the_same_sentence(plant, fault, fields):
    with pytest.raises(Refused) as refused:
        admitted(fault, fields)
    with pytest.raises(ValueError) as error:
        plant[0].apply(InjectFault(fault=fault, **fields))
    assert str(refused.value) == str(error.value)


def test_a_scene_can_say_what_fails_and_when(tmp_path):
    (tmp_path / "late.yaml").write_text(
        "format: motm-scene/1\nextends: exp1\nfaults:\n  inject:\n"
        "    - {at: 0.5, fault: lidar_blind, seconds: 0.3}\n    - {at: 0.6, fault: joint_stuck, joint: 2}\n"
    )
    plant = SimulatedPlant(load_scene(str(tmp_path / "late.yaml")))
    told = {}
    for k in range(200):
        plant.step(0.01)
        told[k + 1] = plant.truth().faults
    assert told[49] == () and told[50] == ("lidar blind for 0.3 s",)
    assert [text.split(" for ")[0] for text in told[70]] == ["joint 2 stuck", "lidar blind"]
    assert told[90] == ("joint 2 stuck for 0.7 s",) and told[170] == ()


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{at: 1, fault: lidar_frosen}", "lidar_frozen"),
        ("{at: 1, fault: wheel_slip, amount: 1.5}", "0.05 to 1"),
        ("{at: 1, fault: lidar_off, amount: 0.5}", "has none"),
        ("{at: 1, fault: lidar_off, seconds: 61}", "60"),
    ],
)
def test_a_fault_in_a_scene_that_cannot_be_is_refused_with_its_place(tmp_path, entry, said):
    (tmp_path / "bad.yaml").write_text(f"format: motm-scene/1\nextends: exp1\nfaults:\n  inject:\n    - {entry}\n")
    with pytest.raises(ValueError, match=said) as error:
        load_scene(str(tmp_path / "bad.yaml"))
    assert "inject" in str(error.value)


def test_a_few_bad_beams_are_left_out_and_do_not_stop_the_robot():
    twin = Twin(load_scene("exp1", "trial1"))
    twin.post(InjectFault(fault="lidar_nan", seconds=10.0, amount=0.0))
    ticks = [twin.advance() for _ in range(80)]
    assert max(abs(float(tick.observation.twist[0])) for tick in ticks) > 0.4
    assert not any("scan" in tick.stop_reason or "lidar" in tick.stop_reason for tick in ticks)
    assert int(np.isnan(twin.plant.observe().scan.ranges).sum()) == 1


def test_many_bad_beams_are_the_reason_that_is_told():
    twin = Twin(load_scene("exp1", "trial1"))
    twin.post(InjectFault(fault="lidar_nan", seconds=10.0, amount=0.5))
    ticks = [twin.advance() for _ in range(20)]
    assert "ranges are nan or negative" in ticks[-1].stop_reason


def test_the_documents_and_the_page_list_every_fault():
    from pathlib import Path

    from motm_twin.ui.panel.disturb import FAULTS

    text = (Path(__file__).parents[1] / "docs" / "zenoh.md").read_text(encoding="utf-8")
    assert table() in text
    assert {edit.fault for edit in FAULTS.values()} == set(KINDS)
    for edit in FAULTS.values():
        assert bounds.problem(edit) == ""


def test_the_hand_stays_over_the_object_while_the_fingers_are_stuck_and_the_base_brakes(moments):
    twin, found = moments
    _, snapshot = found["gripper_stuck"]
    twin.restore(snapshot)
    twin.post(InjectFault(fault="gripper_stuck", seconds=LASTS))
    ticks = [twin.advance() for _ in range(40)]
    stuck = [tick for tick in ticks if "fingers should close" in tick.stop_reason]
    assert stuck and abs(float(stuck[0].observation.twist[0])) > 0.1
    assert max(step.error for tick in stuck for step in tick.arm if step.phase == "closing") < 0.01
