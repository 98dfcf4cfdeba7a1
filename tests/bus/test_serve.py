"""`motm-twin serve` as a user starts it: the real twin, a plain Zenoh subscriber, ports, signals, deaths."""

import errno
import itertools
import json
import os
import signal
import socket
import subprocess
import sys
import threading
from contextlib import ExitStack, contextmanager
from pathlib import Path

import msgspec
import pytest
import zenoh
from waiting import asked, until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Pause
from motm_twin.bus.connection import free_port, require_free_port
from motm_twin.bus.private_folder import all_running, client_file
from motm_twin.processes import setter
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import Session

READY = 240.0  # [s] the first start compiles, on a machine that may be busy


@contextmanager
def serving(*options, zenoh_port=None):
    zenoh_port = zenoh_port or free_port()
    command = [sys.executable, "-m", "motm_twin", "serve", "exp1", "--zenoh-port", str(zenoh_port), *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        try:
            yield process, zenoh_port
        finally:
            process.terminate()


def children(process):
    return [int(pid) for pid in Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()]


def alive(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.timeout(600)
def test_a_plain_zenoh_subscriber_sees_the_robot_drive_its_session_reruns_and_the_end_is_clean():
    with serving("--headless", "--variant", "trial2", "--twin", "mine") as (process, port):
        until(client_file(port).exists, "no file for other programs", READY)
        config = zenoh.Config.from_file(str(client_file(port)))
        config.insert_json5("connect/timeout_ms", "60000")
        ticks, grids = [], []
        with zenoh.open(config) as session:
            tick_subscriber = session.declare_subscriber(
                "motm/mine/tick", lambda sample: ticks.append(json.loads(sample.payload.to_string()))
            )
            grid_subscriber = session.declare_subscriber(
                "motm/mine/grid",
                lambda sample: grids.append((sample.payload.to_bytes(), json.loads(sample.attachment.to_string()))),
            )
            with TwinClient(f"tcp/127.0.0.1:{port}", "mine") as client:
                until(client.tick, "no tick", READY)
                assert client.command(AddObstacle(name="crate", x=1.0, y=-0.6, size=(0.3, 0.3, 0.5))).ok
                until(lambda: client.tick().obstacles and client.tick().index > 40, "it stands, or no crate")
                run = msgspec.json.decode(client.session(), type=Session)
            until(lambda: len(ticks) > 40, "no ticks", READY)
            until(lambda: grids, "no grid", READY)
            tick_subscriber.undeclare()
            grid_subscriber.undeclare()
            (scene,) = [json.loads(reply.ok.payload.to_string()) for reply in asked(session, "motm/mine/scene")]
        assert [tick["version"] for tick in ticks[:2]] == ["motm.tick/1"] * 2
        times = [tick["time"] for tick in ticks]
        assert all(after - before == pytest.approx(0.05) for before, after in itertools.pairwise(times))
        assert ticks[-1]["robot"]["pose"][:2] != ticks[0]["robot"]["pose"][:2]
        assert len(ticks[-1]["robot"]["q"]) == 7
        assert len(ticks[-1]["arm"]) >= 5
        assert {cost is None for cost in ticks[-1]["placement"]["cost"]} <= {True, False}
        payload, info = grids[-1]
        assert len(payload) == info["width"] * info["height"]
        assert (scene["name"], scene["variant"]) == ("exp1", "trial2")
        assert any(item.pid == process.pid and item.twin == "mine" for item in all_running())

        pids = children(process)
        process.send_signal(signal.SIGINT)
        assert process.wait(2.5) == 0
        assert not any(alive(pid) for pid in pids)
        assert not any(item.pid == process.pid for item in all_running())
        with socket.socket() as probe:
            assert probe.connect_ex(("127.0.0.1", port)) == errno.ECONNREFUSED
        require_free_port("127.0.0.1", port, "")  # what the next server asks; connections that ended do not count
    assert [entry.edit.name for entry in run.edits] == ["crate"]
    assert rerun(run).ok


@pytest.mark.timeout(600)
def test_a_killed_server_is_started_again_its_clients_find_it_and_it_ends_at_once_while_they_read():
    options = ("--headless", "--method", "no_bezier", "--expansions-only")
    with serving(*options) as (process, port), ExitStack() as stack:
        client, *others = (stack.enter_context(TwinClient(f"tcp/127.0.0.1:{port}")) for _ in range(5))
        until(client.tick, "no tick", READY)
        until(lambda: client.tick().index > 20, "it stands")
        assert client.command(AddObstacle(name="crate", x=2.0, y=-0.6), sender="page.1", name="Ann").ok
        heard = []
        client.on_tick(lambda payload: heard.append(json.loads(payload)["index"]))
        until(lambda: heard, "no tick is heard")
        (server,) = children(process)
        os.kill(server, signal.SIGKILL)
        until(lambda: children(process) not in ([], [server]), "no new server")
        until(lambda: not client.alive, "the client does not notice")
        until(lambda: client.alive and client.tick().index < 20, "the new server was not found", READY)
        until(lambda: client.tick().index > 20, "the new one stands")
        again = heard.index(min(heard))
        assert again > 0
        assert heard[again + 1 :] == list(range(heard[again] + 1, heard[again] + len(heard) - again))
        assert (client.status().driver, client.status().method) == ("", "no_bezier")
        assert client.command(Pause(), sender="page.1", name="Ann").ok
        until(lambda: client.status().state == "paused", "it does not pause")
        until(lambda: all(other.tick() for other in others), "not all are told")
        pids = children(process)
        process.send_signal(signal.SIGTERM)
        assert process.wait(2.5) == 0
        assert not any(alive(pid) for pid in pids)


@pytest.mark.timeout(600)
def test_no_child_survives_when_serve_itself_is_killed():
    page = free_port()
    with serving("--port", str(page)) as (process, _):
        until(lambda: len(children(process)) == 2, "no children")
        pids = children(process)
        process.kill()
        process.wait()
        until(lambda: not any(alive(pid) for pid in pids), "children are left")


@pytest.mark.timeout(60)
def test_a_signal_that_comes_while_its_event_is_waited_for_does_not_hang_the_program():
    before = signal.getsignal(signal.SIGALRM)
    try:
        for _ in range(50):
            stop = threading.Event()
            signal.signal(signal.SIGALRM, setter(stop))
            signal.setitimer(signal.ITIMER_REAL, 1e-4, 1e-4)  # into every step of the wait
            while not stop.wait(1e-5):
                continue
            signal.setitimer(signal.ITIMER_REAL, 0.0)
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
