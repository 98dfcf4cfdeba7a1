"""The groups that measure the bus: what is compared with which goal, and malformed messages that really are.

Those on the keys of a robot come in small numbers here: `motm-twin bench soak` does it by the thousand.
"""

import collections
import json
import time
from types import SimpleNamespace

import pytest
from rich.console import Console

from motm_twin.bus.commands import COMMAND_NAMES, CommandGate, Envelope, Refused
from motm_twin.bus.connection import PlantKeys
from motm_twin.cli import bench as command
from motm_twin.external.robot_link import NAMES, RefusedMessage, read
from motm_twin.perf import bus, soak
from motm_twin.perf.bus import _effects, _paired
from motm_twin.perf.fuzz import EXAMPLES, Fuzzer, RobotFuzzer, attack_robot
from motm_twin.perf.report import Limit, Report, conclude, measure, percentiles

LIMITS = {
    "a": Limit(name="a number", unit="ms", limit=2.0, decimals=1),
    "b": Limit(name="another", unit="", limit=0.0, decimals=0),
}
QUIET = Console(quiet=True)


def concluded(report, tmp_path):
    reached = conclude("some", "Some", LIMITS, report, tmp_path, QUIET)
    return reached, json.loads((tmp_path / "some.json").read_text())


def test_all_limits_kept_is_reached_and_one_exceeded_or_missing_or_nothing_measured_is_not(tmp_path):
    assert concluded(Report(values={"a": 2.0, "b": 0.0}), tmp_path)[0]
    assert not concluded(Report(values={"a": 2.1, "b": 0.0}), tmp_path)[0]
    reached, written = concluded(Report(values={"a": 1.0}), tmp_path)
    assert not reached
    assert not percentiles([])["p99"] <= 1e9
    assert percentiles([1.0, 3.0])["p50"] == 2.0
    assert written["goals"][1]["value"] is None
    assert written["machine"]


def test_what_is_skipped_is_said_and_not_judged(tmp_path):
    reached, written = concluded(Report(values={"a": 1.0}, skipped={"b": "there is none"}), tmp_path)
    assert reached
    assert written["skipped"] == {"b": "there is none"}
    assert [goal["name"] for goal in written["goals"]] == ["a number"]


def test_a_step_that_fails_does_not_hide_the_others():
    done, report = [], Report()

    def fail():
        raise RuntimeError("no twin")

    measure([("first", fail), ("second", lambda: done.append(1))], report, QUIET)
    assert done == [1]
    assert report.failures == ["first: no twin"]


def test_the_goals_are_those_of_the_project():
    assert {key: limit.limit for key, limit in bus.LIMITS.items()} == {
        "above_bare_ms": 2.0, "sink_ms": 1.0, "effect_ms": 55.0, "shown_ms": 55.0, "age_ms": 100.0, "recording": 5.0,
        "file_mb": 15.0,
    }  # fmt: skip
    assert (soak.CLIENTS, soak.MESSAGES, soak.STARTS, soak.KILLS) == (1000, 100_000, 200, 100)
    assert (soak.LIMITS["memory_mb"].limit, soak.LIMITS["threads"].limit) == (5.0, 0.0)


def test_recording_is_judged_over_the_same_periods_without_what_others_disturbed():
    off, on = [10.0] * 200, [10.4] * 200
    disturbed = [*off[:100], 500.0, *off[101:]]
    assert _paired({False: [off, disturbed], True: [on, on]}) == pytest.approx(1.04)
    assert _paired({False: [off, off], True: [disturbed, off]}) == pytest.approx(1.0)


def test_a_command_that_no_tick_contains_is_counted():
    assert _effects({1.0: (0.0, 0.01)}, [], 0.0)["never seen"] == {"count": 1.0}


def test_every_command_has_an_example_that_the_gate_takes():
    assert set(EXAMPLES) == set(COMMAND_NAMES)
    fuzzer, gate = Fuzzer("frankie", 1, time.time), CommandGate(time.time)
    for name in COMMAND_NAMES:
        assert isinstance(gate.admit(name, json.dumps(fuzzer.envelope(name)).encode()), Envelope)


def test_no_malformed_command_passes_the_gate_and_each_is_refused_with_a_reason():
    fuzzer, gate = Fuzzer("frankie", 3, time.time), CommandGate(time.time)
    found, taken = collections.Counter(), []
    for message in fuzzer.messages(6000):
        if message.kind != "command":
            continue
        try:
            envelope = gate.admit(message.key.rsplit("/cmd/", 1)[-1], message.payload)
        except Refused as refusal:
            assert len(str(refusal)) > 10
            found[message.how] += 1
        else:
            taken.append((message.how, envelope))
    assert taken == []
    assert len(found) == 11


def test_the_same_seed_makes_the_same_messages():
    first, again, other = (list(Fuzzer("frankie", seed, lambda: 100.0).messages(300)) for seed in (5, 5, 6))
    assert first == again
    assert first != other


STATE = {"version": "motm.plant/1", "life": "own", "seq": 0, "stamp": 5.0, "pose": [0.0] * 3, "odometry": [0.0] * 3,
         "twist": [0.0] * 2, "q": [0.0] * 7, "dq": [0.0] * 7, "gripper_width": 0.08,
         "gripper_moving": False}  # fmt: skip


def sample(key, payload):
    """The sample that a subscriber gets."""
    return SimpleNamespace(key_expr=key, payload=SimpleNamespace(to_bytes=lambda: payload))


def heard(seed):
    """A fuzzer that heard the state of the robot."""
    fuzzer = RobotFuzzer(seed)
    fuzzer.heard(sample(PlantKeys().state, json.dumps(STATE).encode()))
    return fuzzer


def test_no_message_of_the_fuzzer_is_a_right_one_of_the_robot_itself():
    others, names = 0, {getattr(PlantKeys(), name): name for name in NAMES}
    for key, payload in heard(1).messages(3000, PlantKeys()):
        try:
            others += read(names.get(key, "state"), payload).life.startswith("other ")
        except RefusedMessage:
            continue
        assert json.loads(payload)["life"].startswith("other ")
    assert others > 100


def test_the_fuzzer_takes_none_of_its_own_messages_for_one_of_the_robot():
    fuzzer = heard(2)
    for of, payload in list(fuzzer.messages(3000, PlantKeys())):
        fuzzer.heard(sample(of, payload))
    assert fuzzer._heard == {PlantKeys().state: STATE}


def test_a_run_with_malformed_messages_on_the_robots_keys_is_the_same_bit_for_bit():
    found = attack_robot(1500)
    assert (found["sent"], found["differing"]) == (1500.0, 0.0)
    assert found["unreadable"] > 300


@pytest.mark.parametrize("share", ["0", "-1", "1.5", "nan"])
def test_a_share_that_is_none_is_refused(share, capsys):
    assert command.main(["soak", "--share", share]) == 2
    assert "--share" in capsys.readouterr().err
