"""The recorder, fed by hand and as a process: whatever ends it, what it wrote can be read; the twin does not notice."""

import json
import os
import random
import resource
import signal
import threading
import time

import msgspec
import pytest
from fake_twin import FakeTwin, fake_scene, fake_server
from recordings import Recording
from running import Running
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Speed, Step
from motm_twin.bus.connection import free_port
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import SessionInfo
from motm_twin.bus.queries import LatestValues
from motm_twin.model.scene_file import load_scene
from motm_twin.record import channels as ch
from motm_twin.record import recorder as module
from motm_twin.record.channels import STATUS
from motm_twin.record.mcap_file import Health, McapFile, RecordingFailed, read
from motm_twin.record.recorder import Recorder
from motm_twin.record.recording import info, load_recording
from motm_twin.sessions.session import Session, SessionError


class Bus:
    """A session on which nobody else is."""

    def __init__(self):
        self.asked = []

    def declare_subscriber(self, key, handler):
        return self

    def undeclare(self):
        pass

    def get(self, key, handler, timeout):
        self.asked.append(key)
        self.answer(key)
        handler.drop()

    def answer(self, key):
        """Nobody answers."""


class Slow(Bus):
    """One whose answers end when the test says so."""

    handlers = ()

    def get(self, key, handler, timeout):
        self.handlers = (*self.handlers, handler)


def finish(recorder):
    """Record what waits, and no more."""
    stop = threading.Event()
    stop.set()
    recorder.run(stop)


def put(recorder, key, message, *, asked=True):
    recorder._waiting.put((key, msgspec.json.encode(message), None, asked))


class Part(msgspec.Struct):
    run: int
    began: float
    index: int


class Fed(Recorder):
    """A recorder whose stream only notes what it is given."""

    def __init__(self, path):
        self.bus, self.got = Bus(), []
        super().__init__(self.bus, "frankie", path)
        self.keys, stream = self._keys, self._stream
        stream.take = self._note
        stream.session = lambda payload, attachment: self.got.append((self.keys.session, attachment))
        self._part = msgspec.json.Decoder(Part)

    def _note(self, key, payload, attachment, *, asked):
        part = self._part.decode(payload)
        self._stream._follow(part)
        self.got.append((key, part.index))

    def feed(self, key, payload=b"{}", asked=False):
        self._waiting.put((key, payload, None, asked))

    def tick(self, run, index):
        self.feed(self.keys.tick, msgspec.json.encode(Part(run=run, began=float(run), index=index)))

    def sessions_asked(self):
        return self.bus.asked.count(self.keys.session)


@pytest.fixture
def fed(tmp_path):
    return Fed(tmp_path / "fed.mcap")


def test_the_session_is_asked_for_while_periods_come_without_a_pause(fed):
    done = threading.Event()

    def flood():
        index = 0
        while not done.is_set():
            fed.tick(1, index)
            index += 1
            time.sleep(0.001)

    feeder, stop = threading.Thread(target=flood), threading.Event()
    recording = threading.Thread(target=fed.run, args=(stop,))
    feeder.start()
    recording.start()
    deadline = time.monotonic() + 20.0
    while not fed.sessions_asked() and time.monotonic() < deadline:
        time.sleep(0.01)
    asked_at = len(fed.got)
    for event in (done, stop):
        event.set()
    for thread in (feeder, recording):
        thread.join(20.0)
    assert fed.sessions_asked() and asked_at < 0.5 * module.SAVE_INTERVAL / 0.001


def test_what_waits_at_the_end_is_written_also_after_a_lost_period(fed):
    for index in (0, 5, *range(6, 26)):  # after a gap: a session is wanted
        fed.tick(1, index)
    fed.bus.answer = lambda key: fed.feed(key, asked=True)
    finish(fed)
    assert [index for key, index in fed.got if key == fed.keys.tick] == [0, 5, *range(6, 26)]
    assert fed.got[-1][0] == fed.keys.session
    assert fed._waiting.empty()


def test_a_session_is_recorded_with_the_run_that_it_names_whatever_ticks_have_come(tmp_path):
    """The session of the next run may overtake its first tick, and that of the run before may come after it."""
    recorder = Recorder(Bus(), "frankie", tmp_path / "named.mcap")
    info = msgspec.json.encode(SessionInfo(run=2, began=7.5))
    session = msgspec.json.encode(Session(scene=load_scene("exp1", "trial1", 0)))
    recorder._waiting.put((recorder._keys.session, session, info, True))
    recorder._waiting.put((recorder._keys.session, session, None, True))  # of a server of another version
    finish(recorder)
    (entry,) = [entry for entry in read(tmp_path / "named.mcap") if entry.topic == ch.SESSION.topic]
    kept = msgspec.json.decode(entry.data, type=ch.RecordedSession)
    assert (kept.run, kept.began) == (2, 7.5)


def test_it_listens_once_all_that_was_asked_first_is_answered(tmp_path):
    bus = Slow()
    recorder = Recorder(bus, "frankie", tmp_path / "slow.mcap")
    *most, last = bus.handlers
    for handler in most:
        handler.drop()
    assert not recorder.listens(0.01)
    last.drop()
    assert recorder.listens(0.01)


def test_a_last_value_of_a_run_before_the_one_of_the_status_is_not_recorded(tmp_path):
    """Of a robot in another program that has not begun its run yet there is only the last period of the run before."""
    twin, recorder = FakeTwin(fake_scene()), Recorder(Bus(), "frankie", tmp_path / "late.mcap")
    keys = recorder._keys
    put(recorder, keys.status, a_status(run=4))
    for run in (3, 4):
        put(recorder, keys.tick, tick_message(twin.advance(), run, 7.5))
    put(recorder, keys.tick, tick_message(twin.advance(), 3, 7.5), asked=False)  # what comes by itself is of now
    finish(recorder)
    ticks = [msgspec.json.decode(entry.data) for entry in read(tmp_path / "late.mcap") if entry.topic == ch.TICK.topic]
    assert [(tick["run"], tick["index"]) for tick in ticks] == [(4, 1), (3, 2)]


@pytest.mark.parametrize("ended", [False, True])
def test_a_tick_that_comes_by_itself_first_is_written_after_the_status_and_scene_that_were_asked_for(tmp_path, ended):
    """``ended``: the recording ends before all is answered."""
    bus, twin = Slow(), FakeTwin(fake_scene())
    recorder = Recorder(bus, "frankie", tmp_path / "first.mcap")
    keys, status = recorder._keys, msgspec.structs.replace(a_status(run=2), method="staa")
    tick, other = (tick_message(twin.advance(), 2, 7.5) for _ in range(2))
    scene = load_scene("exp1", "trial1", 0)
    for key, message, asked in (
        (keys.tick, tick, False),
        (keys.status, status, False),
        (keys.status, status, True),
        (keys.scene, scene, True),
        (keys.tick, other, True),  # dropped: it is not newer than the one that came
    ):
        put(recorder, key, message, asked=asked)
    for handler in bus.handlers[ended:]:
        handler.drop()
    finish(recorder)
    (run,) = load_recording(tmp_path / "first.mcap").runs
    assert run.scene is not None
    assert (run.scene.name, run.method, run.indices) == (scene.name, "staa", [tick.index])


def test_a_recording_of_a_run_that_has_ended_lasts_as_long_as_it_was_recorded(tmp_path):
    """The last period is of long before: it is in the file, and that time is not."""
    twin, recorder = FakeTwin(fake_scene()), Recorder(Bus(), "frankie", tmp_path / "ended.mcap")
    keys, began, status = recorder._keys, 7475.5, a_status(run=1)
    last = tick_message(twin.advance(), 1, began - 465.5)
    for seconds in range(11):
        told = msgspec.structs.replace(status, server_time=began + seconds)
        put(recorder, keys.status, told, asked=seconds == 0)
        if seconds == 0:
            put(recorder, keys.tick, last)
    finish(recorder)
    found = info(tmp_path / "ended.mcap")
    assert (found.seconds, [run.periods for run in found.runs]) == (10.0, [1])
    rates = {channel.topic: channel.rate for channel in found.channels}
    assert (rates[ch.STATUS.topic], rates[ch.TICK.topic]) == (1.1, 0.1)
    tick = next(entry for entry in read(tmp_path / "ended.mcap") if entry.topic == ch.TICK.topic)
    assert msgspec.json.decode(tick.data)["server_time"] == last.server_time


def a_status(run):
    with Running() as running:
        return msgspec.structs.replace(running.loop.status(), run=run)


MOST_LOST = 1.0  # [s]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with fake_server(data=data) as running:
        until(lambda: running.loop.status().state == "playing", "the twin never started")
        yield running


@pytest.fixture
def client(server):
    with TwinClient(server.endpoint) as connected:
        until(connected.tick, "no tick")
        yield connected


def started(server, path, **options):
    recorder = Recording(server.endpoint, path, **options)
    assert recorder.event()["event"] == "recording"
    return recorder


def test_killed_at_any_moment_it_loses_less_than_a_second(server, client, tmp_path):
    dice, newest = random.Random(7), {}
    recorders = {tmp_path / f"{number}.mcap": started(server, tmp_path / f"{number}.mcap") for number in range(2)}
    time.sleep(1.0)
    for path, recorder in recorders.items():
        time.sleep(0.2 + 0.3 * dice.random())  # the moment is what is tested
        newest[path] = client.tick().server_time
        recorder.kill()
    for path in recorders:
        health = Health()
        times = [json.loads(entry.data)["server_time"] for entry in read(path, health) if entry.topic == "/motm/tick"]
        assert not health.complete
        assert newest[path] - times[-1] <= MOST_LOST


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_well(server, client, tmp_path, number):
    recorder = started(server, tmp_path / "x.mcap")
    index = client.tick().index
    until(lambda: client.tick().index > index + 20, "no ticks")
    recorder.process.send_signal(number)
    code, last = recorder.wait()
    assert (code, last["event"]) == (0, "recorded")
    found = info(tmp_path / "x.mcap")
    assert found.complete and found.runs[0].missing == 0


def test_a_full_disk_ends_the_recording_and_nothing_else(server, client, tmp_path):
    limit = 400_000

    def no_more():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    recorder = started(server, tmp_path / "x.mcap", preexec_fn=no_more)
    assert client.command(Speed(factor=8.0)).ok
    code, last = recorder.wait()
    assert client.command(Speed(factor=1.0)).ok
    assert (code, last["event"]) == (1, "failed")
    assert "File too large" in last["text"]
    index = client.tick().index
    until(lambda: client.tick().index > index + 5, "the robot stands")
    health = Health()
    assert list(read(tmp_path / "x.mcap", health)) and health.complete
    assert last["bytes"] == health.whole == health.size <= limit  # nothing half is left


def test_a_disk_that_is_full_from_the_start_is_said_and_nothing_is_left(server, tmp_path):
    def nothing():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4, 4))

    code, last = Recording(server.endpoint, tmp_path / "x.mcap", preexec_fn=nothing).wait()
    assert (code, last["event"]) == (2, "refused")
    assert last["text"].endswith("x.mcap: cannot be written: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_before_anything_is_whole_leaves_nothing(tmp_path):
    def full(_):
        raise OSError(28, "No space left on device")

    file = McapFile(tmp_path / "x.mcap")
    file.add(STATUS, 1.0, b"{}")
    file._raw.write = full
    with pytest.raises(RecordingFailed, match="No space left on device"):
        file.save()
    file.close()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_refused_before_it_begins(server, tmp_path):
    (tmp_path / "there.mcap").write_bytes(b"mine")
    (tmp_path / "closed").mkdir(mode=0o500)
    places = {"there.mcap": "exists already", "none/x.mcap": "No such file", "there.mcap/x.mcap": "Not a directory"}
    if os.geteuid() != 0:
        places["closed/x.mcap"] = "Permission denied"
    for place, words in places.items():
        with pytest.raises(SessionError, match=words):
            McapFile(tmp_path / place)
    code, last = Recording(server.endpoint, tmp_path / "there.mcap").wait()
    assert (code, last["event"]) == (2, "refused")
    assert "exists already" in last["text"]
    assert (tmp_path / "there.mcap").read_bytes() == b"mine"


def test_nobody_to_record_is_bad_input(tmp_path):
    code, last = Recording(f"tcp/127.0.0.1:{free_port()}", tmp_path / "x.mcap", "--wait", "0.2").wait()
    assert (code, last["event"]) == (2, "refused")
    assert not (tmp_path / "x.mcap").exists()


def test_a_server_that_answers_slowly_is_recorded_from_the_start(tmp_path, monkeypatch):
    """On a busy machine what is asked at first is answered after the run has begun, or ended."""
    answer = LatestValues._answer

    def slowly(*arguments):
        time.sleep(0.1)
        answer(*arguments)

    monkeypatch.setattr(LatestValues, "_answer", slowly)
    with fake_server(playing=False, data=tmp_path) as server, TwinClient(server.endpoint) as client:
        until(lambda: client.tick() and client.status(), "no tick")
        recorder = started(server, tmp_path / "slow.mcap")
        assert client.command(Step(count=20)).ok
        until(lambda: client.tick().index == 20, "the steps were not made")
        recorder.end()
    entries = list(read(tmp_path / "slow.mcap"))
    assert [json.loads(entry.data)["index"] for entry in entries if entry.topic == "/motm/tick"] == list(range(21))
    assert {"/motm/scene", "/motm/grid"} <= {entry.topic for entry in entries}


def test_all_of_a_closed_file_is_on_the_disk(tmp_path, monkeypatch):
    """Of what was written while the disk was at work nothing was forced onto it: its index and its end."""
    begun, go, sizes = threading.Event(), threading.Event(), []

    def slow(descriptor):
        sizes.append(os.fstat(descriptor).st_size)
        begun.set()
        assert go.wait(10.0)

    monkeypatch.setattr("motm_twin.record.mcap_file.os.fdatasync", slow)
    file = McapFile(tmp_path / "x.mcap")
    file.add(STATUS, 1.0, b"{}")
    file.save()
    assert begun.wait(10.0)
    closing = threading.Thread(target=file.close)
    closing.start()
    until(lambda: file._raw._closing)
    go.set()
    closing.join()
    assert sizes[0] < sizes[-1] == (tmp_path / "x.mcap").stat().st_size
