"""A twin server under bad treatment, in small numbers: `motm-twin bench soak` does the same by the thousand."""

import itertools
import signal
from pathlib import Path

import msgspec
import pytest
from waiting import until

from motm_twin.bus.commands import Speed, Step
from motm_twin.bus.connection import open_client, open_member
from motm_twin.perf import bus, soak
from motm_twin.perf.processes import Worker, act, restart
from motm_twin.perf.report import Report

pytestmark = pytest.mark.timeout(600)


@pytest.fixture(scope="module")
def twin(tmp_path_factory):
    with bus.measured("exp1", tmp_path_factory.mktemp("data")) as running:
        until(running.client.scene, "no scene")
        yield running


@pytest.fixture
def worker():
    with Worker(soak.WORKER) as process:
        yield process


def where(twin):
    return {"endpoint": twin.endpoint, "twin": twin.client.keys.twin}


def threads(twin):
    return len(list(Path(f"/proc/{twin.server.pid}/task").iterdir()))


def test_malformed_messages_on_every_key_change_nothing_and_every_command_is_answered(twin):
    attacked = soak.attack_paused(twin, 700)  # compares the hash of the whole state, the edits and the status
    assert attacked.accepted == []
    assert attacked.unanswered == []
    assert sum(attacked.sent.values()) == 700
    assert len(attacked.sent) == 14, "a sort of message is missing"
    index = twin.client.tick().index
    act(twin.client, Step())
    until(lambda: twin.client.tick().index == index + 1, "the twin does not step any more")


def test_a_running_twin_goes_on_under_malformed_messages(twin, worker):
    restart(twin.client, playing=True)
    attacked = worker.ask("attack", **where(twin), clock=twin.clock, count=300, rate=1000.0, seed=7)
    assert attacked["counts"] == {"accepted": 0, "unanswered": 0}
    index = twin.client.tick().index
    until(lambda: twin.client.tick().index > index + 5, "the twin stands")
    assert soak.state(twin.client)["edits"] == ()
    assert twin.client.status().state == "playing"


@pytest.mark.parametrize("opened", [lambda endpoint: open_member(endpoint, wait=10.0), open_client])
def test_nobody_else_is_heard_on_the_keys_of_the_twin_and_nobody_else_answers(twin, opened):
    restart(twin.client, playing=False)
    keys, heard, asked = twin.client.keys, [], []
    with open_member(twin.endpoint, wait=10.0) as reader, opened(twin.endpoint) as liar:
        listening = reader.declare_subscriber("motm/**", lambda sample: heard.append((str(sample.key_expr), sample)))
        answering = liar.declare_queryable(keys.commands, asked.append)
        alive = liar.liveliness().declare_token(keys.alive)

        def passed_on(key):
            liar.put(key, b"nothing")
            return any(heard_key == key for heard_key, _ in heard)

        until(lambda: passed_on("motm/other/tick"), "nothing is passed on")
        for key, payload in itertools.product(keys.own, (b"", b"\xff\x00", b"[" * 5000, b'{"version": 1}')):
            if "*" not in key:
                liar.put(key, payload, attachment=b"null")
        until(lambda: passed_on("motm/other/grid"), "nothing is passed on any more")
        index = twin.client.tick().index
        act(twin.client, Step())
        until(lambda: twin.client.tick().index == index + 1, "the twin does not step")
        own = [sample for key, sample in heard if key.startswith(f"motm/{keys.twin}/")]
        assert all(len(sample.payload) > 50 and sample.payload.to_bytes()[:1] != b"[" for sample in own)
        for declared in (listening, answering, alive):
            declared.undeclare()
    assert asked == []
    assert twin.client.malformed == 0
    assert twin.client.alive


def test_clients_that_leave_or_are_killed_leave_no_thread(twin, worker):
    restart(twin.client, playing=True)
    assert worker.ask("visit", **where(twin), count=8, parallel=4)["knew nothing"] == 0
    before = threads(twin)  # with those that Zenoh ends after some idle seconds
    assert worker.ask("visit", **where(twin), count=12, parallel=4) == {"left": 12, "knew nothing": 0}
    assert worker.ask("stay", **where(twin), count=5) == 5
    worker.process.kill()
    until(lambda: threads(twin) <= before, f"there were {before} threads, now {threads(twin)}", 40.0)


def test_readers_that_never_read_keep_nothing_from_the_others(twin):
    heard = []
    leave = twin.client.on_tick(lambda payload: heard.append(msgspec.json.decode(payload)["index"]))
    keys = [twin.client.keys.tick, twin.client.keys.robot, twin.client.keys.grid, twin.client.keys.event]
    with Worker(bus.READER) as stopped, Worker(bus.READER) as full:
        stopped.ask("follow", endpoint=twin.endpoint, keys=keys, sessions=2)
        full.ask("jam", endpoint=twin.endpoint, keys=keys, sessions=2)
        stopped.process.send_signal(signal.SIGSTOP)
        restart(twin.client, playing=True)
        act(twin.client, Speed(factor=8.0))
        until(lambda: bus.jams(twin.port) > 0, "nobody is behind", 60.0)
        first = len(heard)
        until(lambda: len(heard) > first + 60, "ticks stopped")
        stopped.process.send_signal(signal.SIGCONT)
    leave()
    restart(twin.client, playing=False)
    later = heard[first : first + 60]
    assert [after - before for before, after in itertools.pairwise(later)] == [1] * 59


def test_every_accepted_command_is_in_a_tick(twin):
    report = Report()
    bus.effect(twin, report, 1.0)
    found = report.details["command_to_effect_ms"]
    assert found["never seen"]["count"] == 0.0
    assert found["answer to its tick"]["count"] > 0.0


def test_a_start_and_a_stop_leave_nothing_behind(tmp_path):
    assert soak.starts(1, tmp_path, print)["starts"] == 1.0
