import json
import math
import string

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.bus import commands
from motm_twin.perf.fuzz import EXAMPLES


class Clock:
    now = 1000.0

    def __call__(self):
        return self.now


def envelope(command, *, sender="test", seq=1, expires=1001.0, **extra):
    return json.dumps({"sender": sender, "seq": seq, "expires": expires, "command": command, **extra}).encode()


def refusal(gate, name, payload):
    with pytest.raises(commands.Refused) as caught:
        gate.admit(name, payload)
    return str(caught.value)


def test_a_good_command_passes_with_its_types():
    gate = commands.CommandGate(Clock())
    admitted = gate.admit("speed", envelope({"type": "speed", "factor": 2}))
    assert admitted.command == commands.Speed(factor=2.0)
    moved = gate.admit("move_body", envelope({"type": "move_body", "name": "t", "x": 1, "y": 2}, seq=2))
    assert moved.command == commands.MoveBody(name="t", x=1.0, y=2.0)


CRATE = {"name": "a", "x": 0, "y": 0}


@pytest.mark.parametrize(
    ("name", "payload", "word"),
    [
        ("speed", b"", "malformed"),
        ("speed", b"{", "malformed"),
        ("speed", b"\xff\xfe", "malformed"),
        ("speed", b"null", "malformed"),
        ("speed", b"[" * 5000, "malformed"),
        ("speed", {}, "factor"),
        ("speed", {"factor": "2"}, "malformed"),
        ("speed", {"factor": float("nan")}, "malformed"),
        ("speed", {"factor": 1e308}, "speed"),
        ("speed", {"factor": 0}, "speed"),
        ("speed", {"factor": 2, "extra": 1}, "extra"),
        ("speed", envelope({"type": "speed", "factor": 2}, extra=1), "extra"),
        ("speed", envelope({"type": "play"}), "was sent to the key of"),
        ("speed", envelope({"type": "explode"}), "malformed"),
        ("step", {"count": 0}, "steps"),
        ("step", {"count": 1.5}, "malformed"),
        ("load", {"scene": "exp1", "seed": -1}, "seed"),
        ("move_body", {"name": "t", "x": 1e9, "y": 0}, "allowed is -100 to 100 m"),
        ("add_obstacle", {"name": "", "x": 0, "y": 0}, "name"),
        ("add_obstacle", CRATE | {"shape": "sun"}, "shape"),
        ("add_obstacle", CRATE | {"size": [0, 1, 1]}, "size"),
        ("add_obstacle", CRATE | {"size": [1, 1]}, "malformed"),
        ("add_obstacle", CRATE | {"shape": "cylinder", "size": [0.3, 0.6, 0.5]}, "the first two differ"),
        ("add_obstacle", CRATE | {"x": 101.0}, "x 101 m: allowed is -100 to 100 m"),
        ("seed", {"seed": 2**31}, "seed 2147483648: allowed is 0 to 2147483647"),
        ("remove_body", {"name": "a\u0007b"}, "printable"),
        ("freeze_body", {"name": "a" * 65}, "64"),
        ("release_body", {"name": "t", "velocity": [8, 8]}, "thrown body 11.31 m/s: at most 10 m/s"),
        ("set_behaviour", {"name": "t", "behaviour": "rude"}, "there are: yield, blind"),
        ("send_agent", {"name": "t", "x": 0, "y": -1e4}, "allowed is -100 to 100 m"),
        ("move_object", {"name": "t", "x": 1e4, "y": 0}, "allowed is -100 to 100 m"),
        ("push_robot", {"dx": 4, "dy": 4}, "push"),
        ("push_robot", {"dx": 0, "dy": 0, "turn": 7}, "turn"),
        ("inject_fault", {"fault": "fire"}, "lidar_off"),
        ("inject_fault", {"fault": "lidar_off", "seconds": 0}, "fault of 0 s"),
        ("inject_fault", {"fault": "lidar_off", "seconds": 61}, "0.05 to 60 s"),
        ("inject_fault", {"fault": "camera_delay", "delay": -1}, "delay"),
        ("insert_task", {"tasks": []}, "0 tasks"),
        ("insert_task", {"tasks": [{"type": "pick", "object": ""}]}, "object"),
        ("insert_task", {"tasks": [{"type": "dance"}]}, "malformed"),
        ("insert_task", {"tasks": [{"type": "place", "bin": "b"}] * 61}, "61 tasks"),
        ("insert_task", {"tasks": [{"type": "drive_to", "point": [0, 0], "tolerance": 0}]}, "tolerance"),
        ("insert_task", {"tasks": [], "index": -1}, "0 tasks"),
        ("remove_task", {"index": -1}, "index -1"),
        ("move_task", {"index": 0, "to": -1}, "to -1"),
        ("set_parameter", {"name": "xi", "value": 1e7}, "value"),
        ("set_parameter", {"name": "xi", "value": "a" * 65}, "value"),
        ("set_parameter", {"name": "xi", "value": [1]}, "malformed"),
        ("branch", {"index": -1}, "index"),
        ("branch", {"index": 2**70}, "index"),
        ("branch", {"index": 10**400}, "index out of range"),
        ("branch", envelope({"type": "branch", "index": 0}).replace(b"0}", b"9" * 5000 + b"}"), ""),
        ("play", envelope({"type": "play"}, seq=2**63), "seq"),
        ("play", envelope({"type": "play"}, seq=-1), "seq"),
        ("inspect", {"candidate": -2}, "candidate"),
        ("hand_over", {"to": "x" * 65}, "receiver"),
        ("hand_over", {"to": "x", "name": "y" * 41}, "name"),
        ("load", {"scene": ""}, "scene"),
        ("load", {"scene": "exp1", "variant": "\n"}, "variant"),
        ("play", envelope({"type": "play"}, sender=""), "sender"),
        ("play", envelope({"type": "play"}, sender="a\nb"), "sender"),
        ("play", envelope({"type": "play"}, name="a" * 41), "name of a person"),
        ("play", envelope({"type": "play"}, name="\u202e"), "name of a person"),
        ("play", envelope({"type": "play"}, expires=999.0), "stale"),
        ("play", envelope({"type": "play"}, expires=2000.0), "at most"),
        ("explode", envelope({"type": "play"}), "unknown command"),
        ("play", b" " * (commands.MAX_COMMAND_BYTES + 1), "oversized"),
    ],
)
def test_a_bad_command_is_refused_with_its_reason(name, payload, word):
    payload = envelope({"type": name, **payload}) if isinstance(payload, dict) else payload
    assert word in refusal(commands.CommandGate(Clock()), name, payload)


@pytest.mark.parametrize("name", ["../mine", "/tmp/mine", ".hidden", "", "a" * 65, "a b", "a\x00", "..", "mïne"])
def test_files_have_plain_names(name):
    gate = commands.CommandGate(Clock())
    assert "file name" in refusal(gate, "save", envelope({"type": "save", "name": name}))
    if name:
        assert "file name" in refusal(gate, "record", envelope({"type": "record", "action": "start", "name": name}))


def test_a_replayed_command_is_refused_and_others_of_the_sender_pass():
    gate = commands.CommandGate(Clock())
    gate.admit("play", envelope({"type": "play"}, seq=5))
    assert "replayed" in refusal(gate, "play", envelope({"type": "play"}, seq=5))
    assert "replayed" in refusal(gate, "play", envelope({"type": "play"}, seq=4))
    gate.admit("play", envelope({"type": "play"}, seq=6))
    gate.admit("play", envelope({"type": "play"}, seq=1, sender="another"))


@pytest.mark.parametrize("jump", [100, 10**6, 2**62])
def test_a_number_that_jumps_keeps_the_others_of_its_sender_in(jump):
    """It may be a forgery: the sender whose name it has goes on, and neither it nor the forgery comes twice."""
    gate = commands.CommandGate(Clock())
    gate.admit("play", envelope({"type": "play"}, seq=5))
    gate.admit("play", envelope({"type": "play"}, seq=5 + jump))
    gate.admit("play", envelope({"type": "play"}, seq=6))
    for seq in (5, 6, 5 + jump):
        assert "replayed" in refusal(gate, "play", envelope({"type": "play"}, seq=seq))


def test_the_numbers_of_one_sender_that_are_remembered_are_bounded():
    clock = Clock()
    gate = commands.CommandGate(clock)
    for seq in range(commands.MAX_SEEN):
        gate.admit("play", envelope({"type": "play"}, seq=seq))
    assert f"more than {commands.MAX_SEEN} commands" in refusal(
        gate, "play", envelope({"type": "play"}, seq=commands.MAX_SEEN)
    )
    clock.now += 2.0
    gate.admit("play", envelope({"type": "play"}, seq=commands.MAX_SEEN, expires=clock.now + 1.0))


def test_a_refused_command_does_not_use_up_its_number():
    gate = commands.CommandGate(Clock())
    refusal(gate, "speed", envelope({"type": "speed", "factor": 99}, seq=7))
    gate.admit("play", envelope({"type": "play"}, seq=7))


def test_senders_are_bounded_and_silent_ones_forgotten():
    clock = Clock()
    gate = commands.CommandGate(clock)
    for number in range(commands.MAX_SENDERS):
        gate.admit("play", envelope({"type": "play"}, sender=f"s{number}"))
    assert "senders" in refusal(gate, "play", envelope({"type": "play"}, sender="one more"))
    clock.now += 120.0
    gate.admit("play", envelope({"type": "play"}, sender="one more", expires=clock.now + 1.0))


@given(st.binary(max_size=200))
def test_no_bytes_pass_or_crash_the_gate(payload):
    with pytest.raises(commands.Refused):
        commands.CommandGate(Clock()).admit("play", payload)


@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(string.printable, max_size=8),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3),
        max_leaves=8,
    )
)
def test_no_other_json_passes_or_crashes_the_gate(value):
    with pytest.raises(commands.Refused):
        commands.CommandGate(Clock()).admit("load", envelope(value))


def test_every_command_has_its_key_and_passes():
    assert len(set(commands.COMMAND_NAMES)) == len(commands.SERVER_COMMANDS) + len(commands.EDITS)
    gate = commands.CommandGate(Clock())
    for seq, name in enumerate(commands.COMMAND_NAMES, 1):
        admitted = gate.admit(name, envelope({"type": name, **EXAMPLES[name]}, seq=seq, name="Ann"))
        assert commands.command_name(admitted.command) == name


WILD = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**66), 2**66),
    st.floats(),
    st.sampled_from([0, 1, -1, 0.5, 1e308, "box", "temi", "lidar_off", "", "a", "a\0", "x" * 100]),
    st.text(max_size=6),
    st.lists(st.floats() | st.just(1.0), max_size=4),
    st.lists(st.sampled_from([{"type": "pick", "object": "c"}, {"type": "place", "bin": "\n"}, {}]), max_size=70),
)


@pytest.mark.parametrize(
    "kind", [*commands.SERVER_COMMANDS, *commands.EDITS], ids=lambda kind: kind.__struct_config__.tag
)
@settings(max_examples=25, deadline=None)
@given(data=st.data())
def test_a_wild_command_of_any_kind_is_refused_or_within_all_ranges(kind, data):
    name = kind.__struct_config__.tag
    fields = {field: data.draw(WILD, label=field) for field in kind.__struct_fields__ if data.draw(st.booleans())}
    try:
        admitted = commands.CommandGate(Clock()).admit(name, envelope({"type": name, **fields}))
    except commands.Refused as refusal:
        assert str(refusal)
        return
    assert isinstance(admitted, commands.Envelope)
    for value in leaves(msgspec.to_builtins(admitted.command)):
        if isinstance(value, str):
            assert len(value) <= 64
            assert value.isprintable()
        elif isinstance(value, float | int):
            assert math.isfinite(value)
            assert abs(value) <= 2**31


def leaves(value):
    """All numbers and texts inside."""
    if isinstance(value, dict):
        value = list(value.values())
    if isinstance(value, list | tuple):
        return [leaf for inner in value for leaf in leaves(inner)]
    return [value]
