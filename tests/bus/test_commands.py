"""The gate of commands; the lease of the wheel; a run waits for its audience, and the next seed starts by itself."""

import json
import math
import string
import time

import msgspec
import pytest
from fake_twin import FakeTwin
from hypothesis import given, settings
from hypothesis import strategies as st
from running import Running
from waiting import until

from motm_twin.bus import commands, loop
from motm_twin.bus.commands import SILENCE, Audience, Drive, Lease, Pause, Play, Refused, Reset, TakeWheel
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


SENDERS = ("ann", "bob", "cid")


def test_who_acts_first_drives_and_others_are_told_who():
    lease = Lease()
    lease.require("ann", 0.0)
    lease.give("ann", "Ann <3", 0.0)
    with pytest.raises(
        Refused, match=r"Ann <3 is driving: it can hand over to you, or you wait for 10 s of silence \(7 s left\)"
    ):
        lease.require("bob", 3.0)
    lease.require("ann", 9.0)
    assert lease.left(10.0) == SILENCE - 1.0


def test_silence_frees_the_wheel_and_no_earlier():
    lease = Lease()
    lease.give("ann", "", 0.0)
    assert lease.name == "ann"
    lease.expire(SILENCE - 0.001)
    assert lease.driver == "ann"
    lease.expire(SILENCE)
    assert (lease.driver, lease.name, lease.left(SILENCE)) == ("", "", 0.0)


def test_a_wheel_that_is_handed_over_belongs_to_the_other_for_the_full_time():
    lease = Lease()
    lease.give("ann", "Ann", 0.0)
    lease.give("bob", "Bob", 5.0)
    assert (lease.driver, lease.name, lease.left(5.0)) == ("bob", "Bob", SILENCE)
    with pytest.raises(Refused):
        lease.require("ann", 6.0)
    lease.give("", "", 7.0)
    assert (lease.driver, lease.left(7.0)) == ("", 0.0)


steps = st.lists(
    st.tuples(
        st.floats(0.0, 1.5 * SILENCE),
        st.sampled_from(SENDERS),
        st.sampled_from(["act", "fail", "pass", "free"]),
        st.sampled_from(SENDERS),
    ),
    max_size=40,
)


@given(steps)
def test_only_one_drives_and_nobody_loses_the_wheel_without_silence(history):
    lease, now, driver, heard = Lease(), 0.0, "", 0.0
    for wait, sender, kind, to in history:
        now += wait
        if driver and now >= heard + SILENCE:
            driver = ""
        lease.expire(now)
        assert lease.driver == driver
        allowed = driver in ("", sender)
        try:
            lease.require(sender, now)
        except Refused:
            assert not allowed
            continue
        assert allowed
        if kind == "act":
            lease.give(sender, sender.title(), now)
        elif kind in ("pass", "free"):
            lease.give(to if kind == "pass" else "", to.title(), now)
        driver, heard = {"act": sender, "pass": to, "free": "", "fail": driver}[kind], now
        assert lease.driver == driver
        assert lease.left(now) == (pytest.approx(SILENCE) if driver else 0.0)


@given(st.text(max_size=80), st.text(min_size=1, max_size=64))
def test_names_are_kept_raw_and_bounded(name, sender):
    lease = Lease()
    lease.give(sender, name, 0.0)
    assert 1 <= len(lease.name) <= 40 or not sender.strip()
    assert lease.name in (name.strip()[:40], sender[:40])


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(loop, "AGAIN", 0.05)


@pytest.fixture
def running():
    """A run that waits for its first page."""
    with Running(playing=True, hold=True) as loop:
        yield loop


def short(scene, *, method=None):
    return FakeTwin(scene, method=method, periods=3)


def state(running):
    return running.loop.status().state


def test_a_run_waits_at_its_start_until_a_page_shows_it_and_says_so(running):
    assert state(running) == "paused" and "first page" in running.loop.status().text
    assert [tick.index for tick in running.sink.ticks] == [0]
    assert running.loop.status().pages == 0
    assert running.ask(Audience(pages=0)) == "" and state(running) == "paused"
    assert running.ask(Audience(pages=1)) == "" and state(running) == "playing"
    assert running.loop.status().driver == ""


def test_a_run_that_waits_for_a_page_starts_when_somebody_drives_without_one(running):
    command = Drive(v=0.1, w=0.0)
    assert running.loop.status().held
    assert running.ask(command) == "" and state(running) == "playing"
    assert not running.loop.status().held
    running.ask(Pause())
    running.ask(command)
    assert state(running) == "paused", "a pause by a person is ended by nobody else"


def test_a_pause_by_a_person_is_not_ended_by_a_visitor(running):
    running.ask(Audience(pages=1))
    running.ask(Pause())
    running.ask(Audience(pages=2))
    assert state(running) == "paused"


def test_play_needs_no_page_and_a_reset_after_it_neither(running):
    running.ask(Play())
    assert state(running) == "playing"
    running.ask(Reset())
    until(lambda: state(running) == "playing", "it waits for a page again")


def test_a_page_is_told_by_somebody_who_does_not_drive(running):
    assert running.ask(TakeWheel()) == ""
    assert running.ask(Audience(pages=1), sender="bob", name="Bob") == ""
    assert state(running) == "playing"


def test_the_next_seed_starts_when_nobody_drives_and_waits_for_a_page():
    with Running(make_twin=short, playing=True, hold=True, again=True) as running:
        running.ask(Audience(pages=1))
        until(lambda: len(running.twins) >= 3, "no further run begins")
        assert [twin.scene.seed for twin in running.twins[:3]] == [0, 1, 2]
        running.ask(Audience(pages=0))
        until(lambda: "first page" in running.loop.status().text, "it goes on with nobody there")


@pytest.mark.parametrize("again", [False, True])
def test_a_driver_keeps_what_has_ended(again):
    with Running(make_twin=short, playing=False, again=again) as running:
        running.ask(Play())  # now there is a driver
        until(lambda: state(running) == "done", "it does not end")
        later = time.monotonic() + 4.0 * loop.AGAIN
        until(lambda: time.monotonic() > later, "no time passes")
        assert len(running.twins) == 1


def test_a_twin_that_waits_for_nobody_does_not_ask():
    with Running(playing=False) as running:
        assert running.loop.status().pages == -1
