"""What programs read: the robot at 50 Hz, sweeps, events that nobody loses, metrics; each with its last value."""

import itertools
import json
import time

import msgspec
import pytest
import zenoh
from fake_twin import FakeTwin, fake_scene, fake_tick
from running import real_server
from waiting import asked, until, until_paused

from motm_twin.bus.commands import (
    AddObstacle,
    Branch,
    Drive,
    Load,
    MoveBody,
    Pause,
    Play,
    PushRobot,
    ReleaseBody,
    Reset,
    SetParameter,
    Speed,
    Step,
)
from motm_twin.bus.encode import tick_message
from motm_twin.bus.events import EventLog, EventWatch
from motm_twin.bus.messages import (
    ContactMessage,
    EventMessage,
    EventsMessage,
    MetricsMessage,
    NumberedEvent,
    RobotStateMessage,
    ScanMessage,
)
from motm_twin.bus.publisher import RobotStream


@pytest.fixture(scope="module")
def server():
    with real_server(playing=False) as running:
        until_paused(running)
        yield running


@pytest.fixture
def client(client):
    yield client
    done(client, Pause())


def done(client, *commands):
    for command in commands:
        answer = client.command(command)
        assert answer.ok, answer.reason


def get(session, key):
    """Payload of the only reply."""
    (reply,) = asked(session, key)
    if reply.err is not None:
        raise ValueError(reply.err.payload.to_string())
    return reply.ok.payload.to_bytes()


def events(session, server, since=0):
    return msgspec.json.decode(get(session, f"{server.keys.event}?from={since}"), type=EventsMessage)


def kinds(session, server, since):
    return [event.kind for event in events(session, server, since).events]


def newest(session, server):
    return events(session, server).newest


def test_every_key_answers_a_late_joiner_with_its_last_value_and_says_how_it_is_encoded(server, client, session):
    done(client, Step(count=2))
    until(lambda: json.loads(get(session, server.keys.tick))["index"] >= 2, "no steps")
    json_keys = ("tick", "robot", "scan", "event", "scene", "status", "metrics", "session", "cmd/pause", "event?from=0")
    for name in json_keys:
        (reply,) = asked(session, f"motm/{server.keys.twin}/{name}", b"")
        assert str(reply.ok.encoding) == "application/json", name
        assert isinstance(json.loads(reply.ok.payload.to_bytes()), dict), name
    (grid,) = asked(session, server.keys.grid)
    info = json.loads(grid.ok.attachment.to_bytes())
    assert (str(grid.ok.encoding), len(grid.ok.payload)) == ("zenoh/bytes", info["width"] * info["height"])
    assert {str(reply.ok.key_expr) for reply in session.get("motm/*/tick")} == {server.keys.tick}


def test_the_robot_comes_at_50_hz_of_simulated_time(server, client, session):
    done(client, Reset())
    until(lambda: client.tick().index == 0, "no reset")
    messages = []

    def on_robot(sample):
        messages.append(msgspec.json.decode(sample.payload.to_bytes(), type=RobotStateMessage))

    subscriber = session.declare_subscriber(server.keys.robot, zenoh.handlers.Callback(on_robot, indirect=False))
    for index in range(1, 9):
        done(client, Step())
        until(lambda index=index: any(message.time > 0.05 * index + 0.025 for message in messages), "no robot")
    subscriber.undeclare()
    times = [message.time for message in messages]
    while times[0] < 0.05:  # what the reset had left
        times.pop(0)
    assert {round(after - before, 6) for before, after in itertools.pairwise(times)} == {0.02}


def test_no_sample_of_a_period_is_sent_before_its_time():
    sent = []
    stream = RobotStream(lambda sample, run: sent.append((time.monotonic(), sample.time, run)), lambda: 0.5)
    tick = fake_tick(FakeTwin(fake_scene()), ())
    samples = tuple(msgspec.structs.replace(tick.observation, time=0.05 + 0.01 * i) for i in range(5))
    began = time.monotonic()
    stream.follow(msgspec.structs.replace(tick, index=2, samples=samples), 7)
    until(lambda: len(sent) == 3, "the samples are not sent")
    stream.close()
    assert [run for _, _, run in sent] == [7] * 3
    for at, stamp, _ in sent:
        assert at - began >= (stamp - 0.05) / 0.5 - 1e-6  # half speed: twice as long


def test_the_frames_fit_the_pose_and_the_joints(server, client, session):
    robot = msgspec.json.decode(get(session, server.keys.robot), type=RobotStateMessage)
    for name, frame in robot.frames.items():
        assert sum(value**2 for value in frame[3:]) == pytest.approx(1.0, abs=1e-4), name
    assert {"base_link", "panda_link0", "panda_hand", "panda_tcp", "camera", "lidar"} <= set(robot.frames)
    assert robot.frames["base_link"][:2] == pytest.approx(robot.pose[:2], abs=1e-4)
    hand, tcp = robot.frames["panda_hand"], robot.frames["panda_tcp"]
    assert sum((a - b) ** 2 for a, b in zip(hand[:3], tcp[:3], strict=True)) ** 0.5 == pytest.approx(0.1034, abs=1e-3)
    assert len(robot.q) == len(robot.dq) == len(robot.joint_names) == 7


def test_each_sweep_is_sent_once(server, client, session):
    scans = []

    def on_scan(sample):
        scans.append(msgspec.json.decode(sample.payload.to_bytes(), type=ScanMessage))

    subscriber = session.declare_subscriber(server.keys.scan, on_scan)
    done(client, Step(count=10))
    until(lambda: len(scans) >= 9, "no sweeps")
    subscriber.undeclare()
    stamps = [scan.stamp for scan in scans]
    assert stamps == sorted(set(stamps))
    assert len(scans[0].ranges) == 721
    assert any(distance is not None for distance in scans[0].ranges)


def test_events_tell_of_edits_runs_and_stops_and_their_numbers_have_no_gaps(server, client, session):
    heard = []
    subscriber = session.declare_subscriber(
        server.keys.event, lambda s: heard.append(msgspec.json.decode(s.payload.to_bytes(), type=NumberedEvent))
    )
    before = newest(session, server)
    done(client, Reset())
    until(lambda: "reset" in kinds(session, server, before + 1), "no event of the reset")
    before = newest(session, server)
    done(client, AddObstacle(name="crate", x=0.5, y=-0.8), SetParameter(name="xi", value=0.7), Step(count=3))
    until(lambda: kinds(session, server, before + 1).count("edit") >= 2, "no events of edits")
    edit = events(session, server, before + 1).events[0]
    assert (edit.text, edit.other, edit.index) == ("add obstacle crate", "crate", 1)
    done(client, Branch(index=2))
    until(lambda: "branch" in kinds(session, server, before), "no event of the branch")
    done(client, Load(scene="exp1"))
    until(lambda: "loaded" in kinds(session, server, before), "no event of the load", 60.0)
    last = newest(session, server)
    until(lambda: heard and heard[-1].seq >= last, "events were not sent")
    subscriber.undeclare()
    numbers = [event.seq for event in heard]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    kept = events(session, server)
    assert [event.seq for event in kept.events] == list(range(kept.oldest, kept.newest + 1))
    assert kept.oldest == 1
    assert "reset" in [event.kind for event in kept.events]


def test_simulated_time_is_sent_in_microseconds():
    tick = msgspec.structs.replace(fake_tick(FakeTwin(fake_scene()), ()), time=1.9700000000000015)
    assert tick_message(tick, run=1, server_time=0.0).time == 1.97


def watched():
    """Events that are told, the watch that tells them, and a period."""
    told = []
    period = tick_message(fake_tick(FakeTwin(fake_scene()), ()), run=1, server_time=0.0)
    return told, EventWatch(EventLog(lambda: 0.0, told.append)), period


def test_a_body_that_is_dragged_is_one_event():
    told, watch, period = watched()

    def at(index, *edits):
        watch.tick(msgspec.structs.replace(period, index=index, time=0.05 * index, edits=list(edits), events=[]))
        return [event.text for event in told if event.kind == "edit"]

    held = [MoveBody(name="cart", x=0.1 * i, y=0.0) for i in range(4)]
    assert at(0, held[0], held[1]) == ["move body cart"]
    assert at(1, held[2]) == ["move body cart"]
    assert at(2, msgspec.structs.replace(held[3], held=False)) == ["move body cart"] * 2
    assert at(40, held[0]) == ["move body cart"] * 3  # another drag
    assert at(41, ReleaseBody(name="cart"), held[0])[3:] == ["release body cart", "move body cart"]


def test_times_of_events_rise_with_their_numbers_however_late_a_contact_is_told():
    told, watch, period = watched()
    touched = ContactMessage(
        time=1.07, body="base", other="box", depth=0.0, caused_by_robot=True, closing_speed=0.1, other_speed=0.0,
        duration=0.0,
    )  # fmt: skip
    score = msgspec.structs.replace(period.score, contacts=[touched])
    late = [EventMessage(time=1.12, kind="picked", text="picked"), EventMessage(time=1.11, kind="go on", text="goes")]
    watch.tick(msgspec.structs.replace(period, index=22, time=1.1, events=late))
    watch.tick(msgspec.structs.replace(period, index=23, time=1.15, events=[], score=score))
    assert [event.seq for event in told] == list(range(1, len(told) + 1))
    assert "contact" in [event.kind for event in told]
    times = [event.time for event in told]
    assert times == sorted(times)


def test_driving_by_hand_is_one_event_however_many_twists_come(server, client, session):
    before = newest(session, server)
    done(client, Reset(), Step())
    until(lambda: "reset" in kinds(session, server, before + 1) and client.tick().index == 1, "no reset")
    before = newest(session, server)
    for i in range(8):
        done(client, Drive(v=-0.1, w=0.01 * i), Step())
        until(lambda i=i: client.tick().index == 2 + i, "a step was not made")  # else later ones miss their twist
    until(lambda: "edit" in kinds(session, server, before + 1), "driving is not told")
    told = [event for event in events(session, server, before + 1).events if event.kind in ("edit", "stop", "go")]
    assert [event.kind for event in told] == ["edit", "stop"]
    assert told[1].text == "driven by hand"


def test_a_stop_begins_and_ends_with_events(server, client, session):
    done(client, Reset())
    before = newest(session, server)
    done(client, Speed(factor=8.0), Play())
    until(lambda: "go" in kinds(session, server, before + 1) or client.tick().index > 60, "time stands", 60.0)
    done(client, Pause(), PushRobot(dx=0.01, dy=0.0), Speed(factor=1.0))
    reasons = [event for event in events(session, server, before + 1).events if event.kind in ("stop", "go")]
    for one, other in itertools.pairwise(reasons):
        assert (one.kind, other.kind) != ("go", "go")
    assert all(event.text for event in reasons)


def test_a_selector_that_is_none_is_refused_with_a_reason(server, client, session):
    with pytest.raises(ValueError, match="give the number of an event"):
        get(session, f"{server.keys.event}?from=yesterday")
    assert events(session, server, 10**9).events == []


def test_metrics_tell_of_periods_tasks_and_memory(server, client, session):
    done(client, Play())
    until(lambda: client.tick().index > 5, "time stands")
    metrics = msgspec.json.decode(get(session, server.keys.metrics), type=MetricsMessage)
    assert 0.0 < metrics.period_ms["p50"] <= metrics.period_ms["p99"] <= metrics.period_ms["max"]
    assert metrics.tasks_total == 12
    assert metrics.memory_mb > 10.0
