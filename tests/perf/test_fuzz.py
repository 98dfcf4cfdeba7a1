"""Malformed messages on the keys of a robot, in small numbers: `motm-twin bench soak` does it by the thousand."""

import json
from types import SimpleNamespace

from motm_twin.bus.keys import PlantKeys
from motm_twin.external.messages import NAMES, RefusedMessage, read
from motm_twin.perf.fuzz import RobotFuzzer, attack_robot

STATE = {"version": "motm.plant/1", "life": "own", "seq": 0, "stamp": 5.0, "pose": [0.0] * 3, "odometry": [0.0] * 3,
         "twist": [0.0] * 2, "q": [0.0] * 7, "dq": [0.0] * 7, "gripper_width": 0.08,
         "gripper_moving": False}  # fmt: skip


def sample(key, payload):
    """What a subscriber gets."""
    return SimpleNamespace(key_expr=key, payload=SimpleNamespace(to_bytes=lambda: payload))


def test_no_message_of_the_fuzzer_is_a_right_one_of_the_robot_itself():
    fuzzer, names = RobotFuzzer(1), {getattr(PlantKeys(), name): name for name in NAMES}
    fuzzer.heard(sample(PlantKeys().state, json.dumps(STATE).encode()))
    others = 0
    for key, payload in fuzzer.messages(3000, PlantKeys()):
        try:
            others += read(names.get(key, "state"), payload).life.startswith("other ")
        except RefusedMessage:
            continue
        assert json.loads(payload)["life"].startswith("other ")
    assert others > 100


def test_the_fuzzer_takes_none_of_its_own_messages_for_one_of_the_robot():
    fuzzer, key = RobotFuzzer(2), PlantKeys().state
    fuzzer.heard(sample(key, json.dumps(STATE).encode()))
    for of, payload in list(fuzzer.messages(3000, PlantKeys())):
        fuzzer.heard(sample(of, payload))
    assert fuzzer._heard == {key: STATE}


def test_a_run_with_malformed_messages_on_the_robots_keys_is_the_same_bit_for_bit():
    found = attack_robot(1500)
    assert (found["sent"], found["differing"]) == (1500.0, 0.0)
    assert found["unreadable"] > 300
