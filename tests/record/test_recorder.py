"""The recorder itself, fed by hand."""

import threading
import time

import msgspec
import pytest
from fake_twin import FakeTwin, fake_scene
from running import Running

from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import SessionInfo
from motm_twin.model.scene_file import load_scene
from motm_twin.record import channels as ch
from motm_twin.record import recorder as module
from motm_twin.record.mcap_file import read
from motm_twin.record.recorder import Recorder
from motm_twin.record.recording import info, load_recording
from motm_twin.sessions.session import Session


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


class Part(msgspec.Struct):
    run: int
    began: float
    index: int


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
    stop = threading.Event()
    stop.set()
    for index in (0, 5, *range(6, 26)):  # after a gap: a session is wanted
        fed.tick(1, index)
    fed.bus.answer = lambda key: fed.feed(key, asked=True)
    fed.run(stop)
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
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    (entry,) = [entry for entry in read(tmp_path / "named.mcap") if entry.topic == ch.SESSION.topic]
    kept = msgspec.json.decode(entry.data, type=ch.RecordedSession)
    assert (kept.run, kept.began) == (2, 7.5)


def test_it_listens_once_all_that_was_asked_first_is_answered(tmp_path):
    class Slow(Bus):
        handlers = ()

        def get(self, key, handler, timeout):
            self.handlers = (*self.handlers, handler)

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

    def put(key, message, *, asked=True):
        recorder._waiting.put((key, msgspec.json.encode(message), None, asked))

    put(keys.status, a_status(run=4))
    for run in (3, 4):
        put(keys.tick, tick_message(twin.advance(), run, 7.5))
    put(keys.tick, tick_message(twin.advance(), 3, 7.5), asked=False)  # what comes by itself is of now
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    ticks = [msgspec.json.decode(entry.data) for entry in read(tmp_path / "late.mcap") if entry.topic == ch.TICK.topic]
    assert [(tick["run"], tick["index"]) for tick in ticks] == [(4, 1), (3, 2)]


@pytest.mark.parametrize("ended", [False, True])
def test_a_tick_that_comes_by_itself_first_is_written_after_the_status_and_scene_that_were_asked_for(tmp_path, ended):
    """``ended``: the recording ends before all is answered."""

    class Slow(Bus):
        handlers = ()

        def get(self, key, handler, timeout):
            self.handlers = (*self.handlers, handler)

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
        recorder._waiting.put((key, msgspec.json.encode(message), None, asked))
    for handler in bus.handlers[ended:]:
        handler.drop()
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    (run,) = load_recording(tmp_path / "first.mcap").runs
    assert run.scene is not None
    assert (run.scene.name, run.method, run.indices) == (scene.name, "staa", [tick.index])


def test_a_recording_of_a_run_that_has_ended_lasts_as_long_as_it_was_recorded(tmp_path):
    """The last period is of long before: it is in the file, and that time is not."""
    twin, recorder = FakeTwin(fake_scene()), Recorder(Bus(), "frankie", tmp_path / "ended.mcap")
    keys, began, status = recorder._keys, 7475.5, a_status(run=1)
    last = tick_message(twin.advance(), 1, began - 465.5)
    for seconds in range(11):
        payload = msgspec.json.encode(msgspec.structs.replace(status, server_time=began + seconds))
        recorder._waiting.put((keys.status, payload, None, seconds == 0))
        if seconds == 0:
            recorder._waiting.put((keys.tick, msgspec.json.encode(last), None, True))
    stop = threading.Event()
    stop.set()
    recorder.run(stop)
    found = info(tmp_path / "ended.mcap")
    assert (found.seconds, [run.periods for run in found.runs]) == (10.0, [1])
    rates = {channel.topic: channel.rate for channel in found.channels}
    assert (rates[ch.STATUS.topic], rates[ch.TICK.topic]) == (1.1, 0.1)
    tick = next(entry for entry in read(tmp_path / "ended.mcap") if entry.topic == ch.TICK.topic)
    assert msgspec.json.decode(tick.data)["server_time"] == last.server_time


def a_status(run):
    with Running() as running:
        return msgspec.structs.replace(running.loop.status(), run=run)
