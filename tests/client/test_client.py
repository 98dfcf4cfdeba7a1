"""The client of other programs: typed commands, newest state, events that are not lost, a clean end."""

import asyncio
import collections
import inspect
import itertools
import re
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest
from fake_twin import FakeTwin, fake_server
from waiting import until, until_paused

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import EDITS, SERVER_COMMANDS, HandOver, Pause, TakeWheel, command_name
from motm_twin.bus.connection import free_port
from motm_twin.client import EventsLost, NoTwin, Refused, connect, connect_async, running_twins
from motm_twin.client.commanding import Commanding
from motm_twin.client.twin import EventReader
from motm_twin.methods import DEFAULT_METHOD

TEXT = Path(__file__).resolve().parents[2] / "docs" / "zenoh.md"
ANY = {str: "x", int: 1, float: 1.0}  # an argument of each type


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with fake_server(playing=False, twin="t1", data=tmp_path_factory.mktemp("data")) as running:
        until_paused(running)
        yield running


@pytest.fixture
def twin(server):
    with connect(server.endpoint) as handle:
        handle.load("fake")
        handle.pause()
        handle.speed(1.0)
        yield handle
        handle.hand_over()


def test_steps_and_loads_are_there_when_the_call_is_back(twin):
    assert twin.name == "t1"
    assert twin.step(3).ok
    assert twin.latest_tick().index == 3
    run = twin.latest_tick().run
    twin.seed(5)
    assert (twin.latest_tick().run, twin.latest_tick().index, twin.status().seed) == (run + 1, 0, 5)
    twin.reset()
    assert twin.latest_tick().run == run + 2


def test_a_run_whose_status_comes_late_is_not_taken_for_the_next(twin, monkeypatch):
    run = twin.latest_tick().run
    late = msgspec.structs.replace(twin.status(), run=run - 1)
    told = itertools.chain([late], iter(twin.client.status, None))
    monkeypatch.setattr(twin.client, "status", lambda: next(told))
    twin.reset()
    assert twin.latest_tick().run == run + 1


@contextmanager
def served(folder, playing=True, **about):
    """A twin that is made so; ``about`` may be changed for the next one."""

    def make(scene, *, method):
        return FakeTwin(scene, method=method, **about)

    with fake_server(make_twin=make, playing=playing, data=folder) as running, connect(running.endpoint) as handle:
        until(handle.latest_tick, "it does not begin")
        yield handle, about


@pytest.fixture
def failing(tmp_path):
    """A twin that has failed, and when the next one fails."""
    with served(tmp_path, fail_at=2) as (handle, about):
        until(lambda: handle.status().state == "error", "no error")
        yield handle, about


def test_steps_past_the_end_of_a_run_or_into_an_error_are_not_waited_for(tmp_path, monkeypatch):
    """Both ended only after a minute, with a timeout."""
    monkeypatch.setattr("motm_twin.client.twin.STEPPING", 20.0)
    with served(tmp_path, playing=False, periods=3) as (twin, _):
        assert twin.step(1000).ok
        assert (twin.status().state, twin.latest_tick().done) == ("done", True)
    with served(tmp_path, playing=False, fail_at=5) as (twin, _), pytest.raises(Refused, match="told to fail"):
        twin.step(1000)


def test_a_run_that_begins_after_an_error_is_not_refused_with_that_error(failing, monkeypatch):
    """Whoever left the error was told the old one, while the new run began."""
    twin, fails = failing
    fails["fail_at"] = None
    told = itertools.chain(3 * [twin.status()], iter(twin.client.status, None))
    monkeypatch.setattr(twin.client, "status", lambda: next(told))
    twin.load("other")
    assert (twin.latest_tick().index, twin.latest_tick().run, twin.scene().name) == (0, 2, "other")


def test_a_run_that_fails_as_the_last_one_did_is_refused_with_the_error(failing):
    twin, fails = failing
    fails["fail_at"] = 0
    for leave in (lambda: twin.load("fake"), twin.reset):
        with pytest.raises(Refused, match="told to fail"):
            leave()


def test_a_load_names_the_method(twin):
    twin.load("other", method="no_bezier")
    assert twin.status().method == "no_bezier"
    twin.load("fake")
    assert twin.status().method == DEFAULT_METHOD


class Sent(Commanding):
    """Gives back what each method sends."""

    def send(self, command, timeout=2.0):
        return command


def test_the_text_lists_the_method_of_every_command_and_every_method():
    table = TEXT.read_text(encoding="utf-8").split("<!-- fields of methods -->")[1].split("<!-- end -->")[0]
    rows = dict(re.findall(r"^\| `(\w+)` \| (.+) \|$", table, re.M))
    assert set(rows) == {kind.__struct_config__.tag for kind in (*SERVER_COMMANDS, *EDITS)}
    listed = set()
    for command, calls in rows.items():
        for name in re.findall(r"`(\w+)\(", calls):
            method = getattr(Sent(), name)
            needed = [each for each in inspect.signature(method).parameters.values() if each.default is each.empty]
            given = [ANY[each.annotation] for each in needed if each.kind is not each.VAR_POSITIONAL]
            assert command_name(method(*given)) == command
            listed.add(name)
    assert listed == {name for name in vars(Commanding) if not name.startswith("_")} - {"send"}


def test_a_refusal_is_an_exception_with_the_reason_of_the_server(twin):
    with pytest.raises(Refused, match="there is no 'ghost'"):
        twin.move("ghost", 0.0, 0.0)
    with pytest.raises(Refused, match="allowed is 0"):
        twin.speed(100.0)
    with pytest.raises(Refused, match="nowhere"):
        twin.load("nowhere")


def test_programs_and_the_page_exclude_each_other(server, twin):
    """A page speaks through one client for several visitors, each with its own sender."""
    twin.take_wheel()
    with TwinClient(server.endpoint, "t1", sender="page") as page:
        assert "is driving" in page.command(Pause(), sender="page.1", name="Ann").reason
        twin.hand_over()
        assert page.command(TakeWheel(), sender="page.1", name="Ann").ok
        with pytest.raises(Refused, match="Ann is driving"):
            twin.play()
        assert page.command(HandOver(), sender="page.1", name="Ann").ok
    assert twin.pause().ok


def test_a_slow_reader_gets_the_newest_tick(twin):
    twin.speed(8.0)
    twin.play()
    indices = []
    for tick in twin.ticks(timeout=10.0):
        indices.append(tick.index)
        time.sleep(0.05)
        behind = twin.latest_tick().index - tick.index
        assert behind >= 0
        if len(indices) >= 10 and indices[-1] - indices[0] > 2 * len(indices):
            break
        assert len(indices) < 200, "it was served what it had missed"
    twin.pause()
    assert indices == sorted(set(indices))


def test_waiting_ends_with_the_tick_or_with_an_error(twin):
    twin.play()
    assert twin.wait_until(lambda tick: tick.index >= 4, timeout=10.0).index >= 4
    with pytest.raises(TimeoutError, match="the last tick is of"):
        twin.wait_until(lambda tick: False, timeout=0.2)


def test_robot_scan_metrics_grid_and_scene_are_read(twin):
    twin.step(2)
    assert twin.scene().name == "fake"
    assert twin.grid().cells.ndim == 2
    assert len(until(twin.robot, "no robot").q) == 7
    until(twin.metrics, "no metrics")
    assert twin.scan() is None  # this twin has no lidar
    assert next(twin.robots(timeout=5.0)).time >= 0.0


def test_events_come_all_and_in_order_also_past_those_that_were_dropped(twin):
    reader = EventReader(twin.client, None)
    for i in range(25):
        twin.add_obstacle(f"box{i}", 0.1 * i, 0.0)
        twin.step()
        if i == 10:
            reader._live.clear()  # as if the network had lost them
    events = []

    def all_came():
        events.extend(reader.take())
        return any(event.other == "box24" for event in events)

    until(all_came, "events do not come")
    numbers = [event.seq for event in events]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    edits = [event.other for event in events if event.kind == "edit"]
    assert edits == [f"box{i}" for i in range(25)]
    reader._live.clear()
    twin.add_obstacle("late", 0.0, 1.0)
    twin.step()
    until(lambda: reader._live, "no event")
    reader._live.clear()  # the newest one is lost: nothing comes after it
    until(lambda: [event.other for event in reader.look()] == ["late"], "a lost event is not found")


def test_the_history_is_read_from_a_number_on(twin):
    twin.add_obstacle("crate", 0.0, 0.0)
    twin.step()
    until(lambda: twin.client.events(0).events[-1].other == "crate", "no event")
    first = next(event for event in twin.events(since=0))
    assert first.seq == twin.client.events(0).oldest
    newest = twin.client.events(0).newest
    assert next(event for event in twin.events(since=newest)).seq == newest


def test_a_reader_that_was_slower_than_the_history_is_told(twin, server):
    reader = EventReader(twin.client, None)
    log = server._publisher.event_log
    for i in range(1200):
        log.add(run=0, index=0, time=0.0, kind="edit", text=f"n {i}")
    until(lambda: reader._live, "events do not come")
    reader.close()
    reader._live.clear()  # a reader that did nothing for all that time
    got, lost = [], []
    for _ in range(2):
        try:
            got += reader.look()
        except EventsLost as error:
            lost.append((error.first, error.last))
    numbers = [event.seq for event in got]
    assert numbers == list(range(numbers[0], numbers[0] + 1000))
    assert lost
    assert lost[0][1] + 1 == numbers[0]


def test_an_iterator_gives_what_came_before_lost_events_and_another_one_what_came_after(twin, server):
    """Events before the gap were lost without being named, as the iterator had ended with the error."""
    reader, log = EventReader(twin.client, None), server._publisher.event_log
    for number in range(1200):
        log.add(run=0, index=0, time=0.0, kind="edit", text=f"n {number}")
    until(lambda: reader._live, "events do not come")
    history = twin.client.events(0)
    first = msgspec.structs.replace(history.events[0], seq=reader._expected, text="first")
    reader._live = collections.deque([first, history.events[-1]])  # as if the network had lost the others
    events = iter(reader)
    assert next(events).text == "first"
    with pytest.raises(EventsLost) as lost:
        next(events)
    assert (lost.value.first, lost.value.last) == (first.seq + 1, history.oldest - 1)
    assert next(twin.events(lost.value.last + 1)).seq == lost.value.last + 1


def test_iterators_end_when_the_twin_is_closed(server):
    twin = connect(server.endpoint)
    ended = []

    def read(messages, name):
        for _ in messages:
            continue
        ended.append(name)

    threads = [
        threading.Thread(target=read, args=(twin.ticks(), "ticks")),
        threading.Thread(target=read, args=(twin.events(), "events")),
    ]
    for thread in threads:
        thread.start()
    twin.close()
    twin.close()
    for thread in threads:
        thread.join(10.0)
    assert sorted(ended) == ["events", "ticks"]


FORGETFUL = """
import sys
from motm_twin.client import connect
twin = connect(sys.argv[1])
events = twin.events(since=0)
print(twin.latest_tick().index, twin.robot() is not None, next(events).seq)
"""


def test_a_program_that_forgets_to_close_ends(server):
    done = subprocess.run(
        [sys.executable, "-c", FORGETFUL, server.endpoint], capture_output=True, text=True, timeout=60.0, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.split()[1] == "True"


def test_which_twins_there_are(server):
    (found,) = running_twins(server.endpoint)
    assert (found.twin, found.alive, found.state, found.scene) == ("t1", True, "paused", "fake a")
    with pytest.raises(NoTwin, match="give its endpoint"):
        connect(twin="nobody-is-called-so")
    with pytest.raises(NoTwin, match="is it running there"):
        connect(f"tcp/127.0.0.1:{free_port()}", "t1", timeout=0.3)


def test_asyncio_programs_command_read_and_hear(server):
    async def program():
        async with connect_async(server.endpoint, name="Ada") as twin:
            await twin.load("fake")
            await twin.step(2)
            assert twin.latest_tick().index == 2
            with pytest.raises(Refused, match="ghost"):
                await twin.move("ghost", 0.0, 0.0)
            heard = []

            async def hear():
                async for event in twin.events():
                    heard.append(event)

            listener = asyncio.create_task(hear())
            await asyncio.sleep(0)
            await twin.play()
            indices = []
            async for tick in twin.ticks():
                indices.append(tick.index)
                if len(indices) >= 5:
                    break
            assert indices == sorted(set(indices))
            assert (await twin.wait_until(lambda tick: tick.index > 10, timeout=10.0)).index > 10
            await twin.pause()
            await twin.add_obstacle("async", 0.0, 0.0)
            await twin.step()
            async with asyncio.timeout(10.0):
                while not any(event.other == "async" for event in heard):
                    await asyncio.sleep(0.01)
            assert await twin.robot() is not None
            await twin.hand_over()
        async with asyncio.timeout(10.0):
            await listener  # it ends because the twin was closed
        numbers = [event.seq for event in heard]
        assert all(after == before + 1 for before, after in itertools.pairwise(numbers))

    asyncio.run(program())


def test_a_reader_goes_on_after_the_server_was_started_again(tmp_path):
    port = free_port()

    def serving():
        return fake_server(port=port, data=tmp_path)

    with serving():
        twin = connect(f"tcp/127.0.0.1:{port}")
        reader = EventReader(twin.client, 0)
        first = until(reader.take, "no event")
    with serving(), twin:
        second = until(reader.look, "no event after the restart", 30.0)
        assert (first[0].seq, second[0].seq) == (1, 1)
        assert first[0].numbered_since != second[0].numbered_since
        tick = twin.latest_tick()
        assert twin.wait_until(lambda newest: newest.server_time > tick.server_time, timeout=20.0)
