import json
import string

import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.bus.commands import MAX_COMMAND_BYTES, MoveBody, Speed
from motm_twin.bus.gate import MAX_SENDERS, CommandGate, Refused


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


def envelope(command, *, sender="test", seq=1, expires=1001.0, **extra):
    return json.dumps({"sender": sender, "seq": seq, "expires": expires, "command": command, **extra}).encode()


def refusal(gate, name, payload):
    with pytest.raises(Refused) as caught:
        gate.admit(name, payload)
    return str(caught.value)


def test_a_good_command_passes_with_its_types():
    gate = CommandGate(Clock())
    admitted = gate.admit("speed", envelope({"type": "speed", "factor": 2}))
    assert admitted.command == Speed(factor=2.0)
    moved = gate.admit("move_body", envelope({"type": "move_body", "name": "t", "x": 1, "y": 2}, seq=2))
    assert moved.command == MoveBody(name="t", x=1.0, y=2.0)


@pytest.mark.parametrize(
    ("name", "payload", "word"),
    [
        ("speed", b"", "malformed"),
        ("speed", b"{", "malformed"),
        ("speed", b"\xff\xfe", "malformed"),
        ("speed", b"null", "malformed"),
        ("speed", b"[" * 5000, "malformed"),
        ("speed", envelope({"type": "speed"}), "factor"),
        ("speed", envelope({"type": "speed", "factor": "2"}), "malformed"),
        ("speed", envelope({"type": "speed", "factor": float("nan")}), "malformed"),
        ("speed", envelope({"type": "speed", "factor": 1e308}), "speed"),
        ("speed", envelope({"type": "speed", "factor": 0}), "speed"),
        ("speed", envelope({"type": "speed", "factor": 2, "extra": 1}), "extra"),
        ("speed", envelope({"type": "speed", "factor": 2}, extra=1), "extra"),
        ("speed", envelope({"type": "play"}), "was sent to the key of"),
        ("speed", envelope({"type": "explode"}), "malformed"),
        ("step", envelope({"type": "step", "count": 0}), "steps"),
        ("step", envelope({"type": "step", "count": 1.5}), "malformed"),
        ("load", envelope({"type": "load", "scene": "exp1", "seed": -1}), "seed"),
        ("move_body", envelope({"type": "move_body", "name": "t", "x": 1e9, "y": 0}), "not within"),
        ("add_obstacle", envelope({"type": "add_obstacle", "name": "", "x": 0, "y": 0}), "name"),
        ("add_obstacle", envelope({"type": "add_obstacle", "name": "a", "x": 0, "y": 0, "shape": "sun"}), "shape"),
        ("add_obstacle", envelope({"type": "add_obstacle", "name": "a", "x": 0, "y": 0, "size": [0, 1, 1]}), "size"),
        ("play", envelope({"type": "play"}, sender=""), "sender"),
        ("play", envelope({"type": "play"}, expires=999.0), "stale"),
        ("play", envelope({"type": "play"}, expires=2000.0), "at most"),
        ("explode", envelope({"type": "play"}), "unknown command"),
        ("play", b" " * (MAX_COMMAND_BYTES + 1), "oversized"),
    ],
)
def test_a_bad_command_is_refused_with_its_reason(name, payload, word):
    assert word in refusal(CommandGate(Clock()), name, payload)


def test_a_replayed_command_is_refused_and_others_of_the_sender_pass():
    gate = CommandGate(Clock())
    gate.admit("play", envelope({"type": "play"}, seq=5))
    assert "replayed" in refusal(gate, "play", envelope({"type": "play"}, seq=5))
    assert "replayed" in refusal(gate, "play", envelope({"type": "play"}, seq=4))
    gate.admit("play", envelope({"type": "play"}, seq=6))
    gate.admit("play", envelope({"type": "play"}, seq=1, sender="another"))


def test_a_refused_command_does_not_use_up_its_number():
    gate = CommandGate(Clock())
    refusal(gate, "speed", envelope({"type": "speed", "factor": 99}, seq=7))
    gate.admit("play", envelope({"type": "play"}, seq=7))


def test_senders_are_bounded_and_silent_ones_forgotten():
    clock = Clock()
    gate = CommandGate(clock)
    for number in range(MAX_SENDERS):
        gate.admit("play", envelope({"type": "play"}, sender=f"s{number}"))
    assert "senders" in refusal(gate, "play", envelope({"type": "play"}, sender="one more"))
    clock.now += 120.0
    gate.admit("play", envelope({"type": "play"}, sender="one more", expires=clock.now + 1.0))


@given(st.binary(max_size=200))
def test_no_bytes_pass_or_crash_the_gate(payload):
    with pytest.raises(Refused):
        CommandGate(Clock()).admit("play", payload)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(string.printable, max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
        max_leaves=8,
    )
)
def test_no_other_json_passes_or_crashes_the_gate(value):
    with pytest.raises(Refused):
        CommandGate(Clock()).admit("load", envelope(value))
