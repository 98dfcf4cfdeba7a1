"""A recording on the bus: it looks like a twin, goes where it is told, and refuses to be changed."""

import json
import threading
import time

import msgspec
import numpy as np
import pytest
from fake_twin import fake_server
from recordings import Recording
from waiting import asked, until

from motm_twin.bus.client import NoSession, TwinClient
from motm_twin.bus.commands import AddObstacle, Branch, Envelope, Load, Pause, Play, Reset, Speed, Step
from motm_twin.bus.connection import open_client
from motm_twin.bus.messages import EventsMessage
from motm_twin.client import connect
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene_file import load_scene
from motm_twin.record import channels as ch
from motm_twin.record.mcap_file import McapFile, read
from motm_twin.record.player import Frames, Playback, Player
from motm_twin.record.player_server import PlayerServer
from motm_twin.sessions.session import SessionError

LAST = 60


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A minute's twentieth of the stand-in, an obstacle in it."""
    folder = tmp_path_factory.mktemp("recordings")
    first, out = Load(scene="fake", method="staa"), folder / "x.mcap"
    with fake_server(first=first, playing=False, data=folder) as server, TwinClient(server.endpoint) as client:
        recorder = Recording(server.endpoint, out)
        assert recorder.event()["event"] == "recording"
        until(lambda: client.tick() and client.status(), "no tick")
        assert client.command(AddObstacle(name="crate", x=1.0, y=1.0)).ok
        assert client.command(Step(count=LAST - client.tick().index)).ok
        until(lambda: client.tick().index == LAST, "the steps were not made")
        assert recorder.end()[0] == 0
    return out


@pytest.fixture
def client(path):
    with (
        PlayerServer(path, twin="again", playback=Playback(playing=False)) as server,
        TwinClient(server.endpoint, "again", sender="tester") as connected,
    ):
        until(lambda: connected.tick() and connected.status() and connected.scene() and connected.grid(), "nothing")
        yield connected


def test_a_recording_looks_like_a_twin(client):
    status = client.status()
    assert (status.state, status.plant, status.scene, status.method) == ("paused", "recording", "fake", "staa")
    assert [choice.title for choice in status.methods] == ["STAA* without the paper's changes"]
    assert "x.mcap, 0.0 of 3.0 s" in status.plant_text
    assert (client.scene().name, client.tick().index, client.grid().info.run) == ("fake", 0, status.run)


def test_its_events_can_be_asked_for_and_are_numbered_as_they_are_told(path):
    with (
        PlayerServer(path, twin="again", playback=Playback(speed=8.0)) as server,
        open_client(server.endpoint) as plain,
    ):
        until(lambda: server.player.status().state == "done", "it never ended")
        first = _events(plain, "motm/again/event?from=0")
        assert [event.kind for event in first.events].count("edit") == 1, "the obstacle that was added"
        assert [event.seq for event in first.events] == list(range(1, first.newest + 1))
        assert {event.numbered_since for event in first.events} == {first.numbered_since}
        with TwinClient(server.endpoint, "again") as client:
            assert client.command(Play()).ok
        until(lambda: _events(plain, "motm/again/event?from=0").newest == 2 * first.newest, "not told again")
        later = _events(plain, f"motm/again/event?from={first.newest + 1}").events
        assert [event.kind for event in later] == [event.kind for event in first.events]
        assert min(event.run for event in later) > max(event.run for event in first.events)


def _events(session, selector):
    replies = [reply.ok for reply in asked(session, selector)]
    return msgspec.json.decode(replies[0].payload.to_bytes(), type=EventsMessage)


def test_it_plays_to_its_end_and_again_from_its_start(client):
    assert client.command(Speed(factor=8.0)).ok
    assert client.command(Play()).ok
    until(lambda: client.status().state == "done", "it never ended")
    assert client.tick().index == LAST
    assert [body.name for body in client.tick().obstacles] == ["crate"]
    run = client.tick().run
    assert client.command(Play()).ok
    until(lambda: client.tick().run > run, "it did not begin again")
    until(lambda: client.status().state == "done", "it never ended again")


def test_a_step_past_the_end_ends_it_and_no_step_before(client):
    """The recording stood at its end, and a program waited in vain for the rest of its steps."""
    assert client.command(Step(count=LAST)).ok
    until(lambda: client.tick().index == LAST and client.status().time == client.tick().time, "it stands elsewhere")
    assert client.status().state == "paused"
    assert client.command(Step(count=2)).ok
    until(lambda: client.status().state == "done", "it never ended")
    assert client.tick().index == LAST


def test_steps_and_leaps_keep_a_past_that_readers_can_look_back_at(client):
    seen = []
    client.on_tick(seen.append)
    assert client.command(Branch(index=30)).ok
    until(lambda: client.tick().index == 30, "it did not leap")
    assert len(seen) == 30  # all between as well
    run, began = client.tick().run, client.tick().began
    for command, index in ((Branch(index=10), 10), (Step(count=2), 12), (Reset(), 0)):
        assert client.command(command).ok
        until(lambda index=index: client.tick().index == index, f"{command} was not done")
        if index == 10:
            tick = client.tick()
            assert (tick.run, tick.began, tick.first, tick.past) == (run + 1, began, 10, run)


def test_a_program_that_leaps_ahead_in_a_recording_goes_on_when_it_is_there(path):
    """It waited two minutes for another run: a recording goes on in the one that is shown."""
    with PlayerServer(path, twin="again", playback=Playback(playing=False)) as server:
        with connect(server.endpoint, "again") as twin:
            until(lambda: twin.latest_tick() is not None, "nothing")
            for index in (30, 50, 10, 20):
                twin.branch(index)
                assert twin.latest_tick().index == index


def test_a_leap_into_another_run_of_the_file_begins_a_run_with_its_scene_and_map(path, tmp_path, monkeypatch):
    """Periods more than 30 s ahead were sent under the run, the scene and the map before the leap."""
    monkeypatch.setattr("motm_twin.record.player.FILLED", 5)
    grid = next(entry.data for entry in read(path) if entry.topic == ch.GRID.topic)
    scenes = [load_scene("exp1"), load_scene("exp2")]
    file = McapFile(tmp_path / "two.mcap")
    for run, scene in enumerate(scenes, 1):
        file.add(ch.SCENE, 1.0, msgspec.json.encode(ch.RecordedScene(scene=scene)))
        file.add(ch.GRID, 1.0, grid)
        for index in range(20):
            plan = {"expansions": 1, "cut_by_clock": False}
            tick = {"run": run, "index": index, "time": index * PERIOD, "began": 1000.0 * run, "plan": plan}
            file.add(ch.TICK, 1.0, json.dumps(tick).encode())
    file.close()
    sent = []
    ways = {"put": lambda *item: sent.append(item), "now": time.time, "changed": lambda: None}
    player = Player(Frames(tmp_path / "two.mcap"), name="x", twin="x", playback=Playback(playing=False), **ways)
    for number, scene, first in ((0, scenes[0], 0), (39, scenes[1], 14), (20, scenes[1], 0), (3, scenes[0], 3)):
        before, sent[:] = player.status().run, []
        player._seek(number)
        status = player.status()
        assert (status.run, status.scene, status.variant) == (before + 1, scene.name, scene.variant)
        ticks = [json.loads(payload) for topic, payload, _ in sent if topic == ch.TICK.topic]
        assert ticks[0]["index"] == first and {tick["run"] for tick in ticks} == {status.run}
        assert {json.loads(about)["run"] for topic, _, about in sent if topic == ch.GRID.topic} == {status.run}
        shown = [json.loads(payload)["name"] for topic, payload, _ in sent if topic == ch.SCENE.topic]
        assert shown == ([scene.name] if number != 20 else [])  # it is shown already


def test_while_it_plays_the_states_of_the_robot_come_one_after_the_other_as_they_were(path, tmp_path):
    sent, frames = [], Frames(with_more_states(path, tmp_path / "more.mcap"))
    ways = {"put": lambda topic, *_: sent.append(topic), "now": time.time, "changed": lambda: None}
    player = Player(frames, name="x", twin="x", playback=Playback(speed=0.125), **ways)
    robots = [[item for item in frame.sent() if item[0] == ch.ROBOT.topic] for frame in frames]
    number = next(number for number, found in enumerate(robots) if number and len(found) > 1)
    player._show(0)
    player._show(number - 1)
    sent.clear()
    player._show(number)
    times = [msgspec.json.decode(payload)["time"] for _, payload, _ in robots[number]]
    waiting = [due for due, _ in player._later]
    assert sent.count(ch.ROBOT.topic) >= 1 and waiting  # of the frame before, and the first of this one
    assert len(waiting) == len(times) - 1
    after = np.minimum(PERIOD, np.subtract(times, times[0]))  # none waits for longer than a period
    assert np.diff(waiting) == pytest.approx(np.diff(after[1:]) / 0.125)
    sent.clear()
    player._seek(number + 1)  # what waits is sent first
    assert sent[: len(waiting)] == [ch.ROBOT.topic] * len(waiting)


def with_more_states(path, target):
    """A copy with three states of the robot for each period: how many were sent depends on how busy the machine was."""
    entries = list(read(path))
    robot = json.loads(next(entry.data for entry in entries if entry.topic == ch.ROBOT.topic))
    file = McapFile(target)
    for entry in (entry for entry in entries if entry.topic != ch.ROBOT.topic):
        file.add(ch.CHANNELS[entry.topic], entry.log_time / 1e9, entry.data)
        if entry.topic == ch.TICK.topic:
            for k in range(3):
                robot["time"] = json.loads(entry.data)["time"] + 0.02 * k
                file.add(ch.ROBOT, entry.log_time / 1e9 + 1e-6 * (k + 1), json.dumps(robot).encode())
    file.close()
    return target


@pytest.mark.parametrize(
    ("topic", "message"),
    [
        (ch.SCAN.topic, [1, 2]),
        (ch.METRICS.topic, 7),
        (ch.ROBOT.topic, {"time": "soon"}),
        (ch.EVENT.topic, {"kind": "picked"}),
        (ch.SCENE.topic, {"scene": {"name": "of another version"}}),
    ],
)
def test_a_message_that_cannot_be_played_is_refused_as_the_file_is_read(path, topic, message, tmp_path):
    """It ended the thread of the player when its turn came: the twin stayed "playing" for ever, without a word."""
    file = McapFile(tmp_path / "bad.mcap")
    for entry in read(path):
        file.add(ch.CHANNELS[entry.topic], entry.log_time / 1e9, entry.data)
    file.add(ch.CHANNELS[topic], entry.log_time / 1e9, json.dumps(message).encode())
    file.close()
    with pytest.raises(SessionError, match=f"a message in it is broken or of another version .{topic}.: "):
        Frames(tmp_path / "bad.mcap")


def test_an_error_while_it_plays_is_the_state_and_a_reset_plays_on(path):
    """The thread of the player ended, and the state stayed as it was."""
    broken = [False]

    def put(*_):
        if broken[0]:
            raise RuntimeError("the disk is gone")

    ways = {"put": put, "now": time.time, "changed": lambda: None}
    player = Player(Frames(path), name="x", twin="x", playback=Playback(playing=False), **ways)
    thread = threading.Thread(target=player.run)
    thread.start()
    answers = []

    def told(command, state, text):
        envelope = Envelope(sender="me", seq=1, expires=time.time() + 5.0, command=command)
        player.request(envelope, lambda reason, _: answers.append(reason))
        until(lambda: player.status().state == state and text in player.status().text, f"not {state}")

    broken[0] = True
    told(Step(), "error", "RuntimeError: the disk is gone")
    broken[0] = False
    told(Reset(), "paused", "a recording: x, 0.0 of")
    player.stop()
    thread.join()
    assert answers == ["", ""]


def test_what_would_change_it_is_refused_with_a_reason(client):
    for command in (AddObstacle(name="box", x=1.0, y=1.0), Load(scene="other")):
        answer = client.command(command)
        assert not answer.ok and answer.reason.startswith("this is a recording")
    assert "0 to 60" in client.command(Branch(index=61)).reason
    with pytest.raises(NoSession, match="this is a recording"):
        client.session()
    assert client.command(Pause()).ok


def test_asked_with_a_wildcard_it_answers_on_its_own_key_and_obeys_nobody(path):
    with PlayerServer(path, twin="again") as server, open_client(server.endpoint) as plain:
        until(lambda: list(plain.get("motm/*/tick")), "nothing was played")
        for selector in ("motm/*/cmd/pause", "motm/*/status", "motm/*/event", "motm/*/schema/tick"):
            (reply,) = asked(plain, selector)
            assert str(reply.ok.key_expr) == selector.replace("*", "again")
            if "cmd" in selector:
                assert "without a wildcard" in json.loads(reply.ok.payload.to_bytes())["reason"]
        (reply,) = asked(plain, "motm/*/session")
        assert reply.err.payload.to_string().startswith("this is a recording")


def test_a_loop_begins_again_by_itself(path):
    with (
        PlayerServer(path, twin="loop", playback=Playback(speed=8.0, loop=True)) as server,
        TwinClient(server.endpoint, "loop") as client,
    ):
        until(lambda: client.tick() and client.tick().run >= 2, "it did not begin again")


def test_a_file_without_a_period_is_refused(path, tmp_path):
    (tmp_path / "x.mcap").write_bytes(path.read_bytes()[:100])
    with pytest.raises(SessionError, match="holds no period"):
        Frames(tmp_path / "x.mcap")
