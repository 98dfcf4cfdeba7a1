"""The server over Zenoh, with a stand-in for the twin: what is published, what is refused, how it starts and ends."""

import json
import socket
import threading
import time

import msgspec
import pytest
import zenoh
from fake_twin import FakeLibrary, FakeTwin, fake_server
from waiting import until, until_paused

from motm_twin.bus.client import NoSession, TwinClient
from motm_twin.bus.commands import AddObstacle, HandOver, Inspect, Load, MoveBody, Pause, Play, Speed, Step
from motm_twin.bus.connection import PortTaken, direct, free_port, open_client, require_free_port
from motm_twin.bus.library import TwinSetup
from motm_twin.bus.server import TwinServer
from motm_twin.sessions.session import Session

FAKE = Load(scene="fake")


@pytest.fixture
def server():
    with fake_server(playing=False) as running:
        until_paused(running)
        yield running


def refused(client, name, payload):
    (answer,) = client.query(name, payload)
    answer = json.loads(answer)
    assert answer["ok"] is False
    return answer["reason"]


def command_bytes(client, command, seq, **changes):
    fields = {"sender": "raw", "seq": seq, "expires": client.status().server_time + 5.0, "command": command}
    return json.dumps(fields | changes).encode()


def test_a_late_joiner_has_tick_grid_scene_and_status_at_once(client):
    until(client.grid, "no grid")
    scene, grid = until(client.scene, "no scene"), client.grid()
    assert scene.name == "fake"
    assert grid.cells.shape == (grid.info.height, grid.info.width)
    assert grid.cells.max() == 255
    table_post = (3.6 - grid.info.origin[0]) / grid.info.resolution, (1.77 - grid.info.origin[1]) / grid.info.resolution
    assert grid.cells[int(table_post[1]), int(table_post[0])] == 255
    assert client.tick().index == 0
    assert client.alive


def test_infinite_costs_travel_as_null(client):
    placement = client.tick().placement
    assert len(placement.poses) == 72
    for cost, reason in zip(placement.cost, placement.rejected, strict=True):
        assert (cost is None) == bool(reason)


def test_commands_act_and_tell_after_which_period(client):
    answer = client.command(Step(count=2))
    assert (answer.ok, answer.index) == (True, 0)
    until(lambda: client.tick().index == 2, "the steps were not seen")
    assert client.command(AddObstacle(name="crate", x=1.0, y=1.0)).ok
    assert client.command(MoveBody(name="crate", x=1.5, y=1.0)).ok
    client.command(Step())
    until(lambda: client.tick().index == 3, "the step was not seen")
    assert client.tick().obstacles[0].position[:2] == [1.5, 1.0]


def test_refused_commands_over_zenoh_have_no_effect(client):
    before = client.tick()
    play = {"type": "play"}
    assert "malformed" in refused(client, "play", b"{")
    assert "malformed" in refused(client, "play", b"")
    assert "oversized" in refused(client, "play", b" " * 70_000)
    assert "stale" in refused(client, "play", command_bytes(client, play, 1, expires=client.status().server_time - 0.1))
    assert "unknown command" in refused(client, "fly", command_bytes(client, play, 1))
    assert "unknown command" in refused(client, "play/now", command_bytes(client, play, 1))
    used = command_bytes(client, {"type": "pause"}, 9)
    assert json.loads(client.query("pause", used)[0])["ok"]
    assert "replayed" in refused(client, "pause", used)
    assert "raw is driving" in client.command(Pause()).reason
    assert json.loads(client.query("hand_over", command_bytes(client, {"type": "hand_over"}, 10))[0])["ok"]
    assert "there is no 'ghost'" in client.command(MoveBody(name="ghost", x=0.0, y=0.0)).reason
    assert client.status().state == "paused"
    assert client.tick().index == before.index


def test_a_put_on_a_command_key_is_not_a_command(server, client):
    with open_client(server.endpoint) as session:
        session.put(server.keys.command("play"), command_bytes(client, {"type": "play"}, 1))
        session.get(server.keys.status)
    assert client.command(Pause()).ok
    assert client.tick().index == 0


def test_ticks_come_in_order_and_a_slow_reader_gets_the_newest(server, client):
    received = []
    with open_client(server.endpoint) as session:
        session.declare_subscriber(server.keys.tick, lambda sample: received.append(sample.payload.to_bytes()))
        client.command(Play())
        until(lambda: len(received) >= 30, "ticks do not come")
        client.command(Pause())
    indices = [json.loads(payload)["index"] for payload in received]
    assert indices == list(range(indices[0], indices[0] + len(indices)))
    newest = server.loop.status().time
    until(lambda: client.tick().time == newest, "the client is behind")


def test_a_tick_that_was_lost_on_the_way_is_fetched_while_the_twin_stands(server, client):
    client._declared.pop(0).undeclare()
    index = client.tick().index
    assert client.command(Step()).ok
    until(lambda: client.tick().index == index + 1, "it was not fetched")


def test_a_history_reader_gets_every_tick_and_grid_in_order_even_when_it_stalls(server, client):
    ticks, grids = [], []

    def on_tick(payload):
        if len(ticks) == 20:
            time.sleep(1.0)  # a reader that is busy with something else
        ticks.append(json.loads(payload)["index"])

    leave = client.on_tick(on_tick)
    client.on_grid(lambda payload, info: grids.append((len(payload), json.loads(info))))
    assert client.command(Speed(factor=8.0)).ok
    assert client.command(Play()).ok
    until(lambda: len(ticks) > 300 and grids, "ticks do not come")
    leave()
    seen = len(ticks)
    assert ticks == list(range(ticks[0], ticks[0] + seen))
    assert all(size == info["width"] * info["height"] for size, info in grids)
    assert client.command(Pause()).ok
    assert len(ticks) == seen


def test_a_listener_that_fails_disturbs_nobody(client, capsys):
    ticks = []
    client.on_tick(lambda payload: 1 / 0)
    client.on_tick(ticks.append)
    client.command(Step(count=3))
    until(lambda: len(ticks) == 3, "the other listener hears nothing")
    until(lambda: client.tick().index == 3, "the client reads nothing")
    assert "ZeroDivisionError" in capsys.readouterr().err


def test_one_client_speaks_for_several_persons(client):
    assert client.command(Pause(), sender="page.1", name="Ann").ok
    until(lambda: client.status().driver_name == "Ann", "nobody drives")
    assert client.status().driver == "page.1"
    assert client.status().driver_left > 0.0
    assert "Ann is driving" in client.command(Pause(), sender="page.2", name="<b>Bob</b>").reason
    assert client.command(HandOver(to="page.2", name="<b>Bob</b>"), sender="page.1", name="Ann").ok
    assert client.command(Pause(), sender="page.2", name="<b>Bob</b>").ok
    until(lambda: client.status().driver_name == "<b>Bob</b>", "the name was changed")


def test_many_threads_of_one_sender_are_not_taken_for_replays(client):
    reasons = []

    def send():
        for _ in range(20):
            reasons.append(client.command(Inspect(), timeout=10.0).reason)

    threads = [threading.Thread(target=send) for _ in range(5)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert reasons == [""] * 100


def test_a_client_that_starts_again_under_its_name_is_heard(server, client):
    for _ in range(2):
        with TwinClient(server.endpoint, sender="same") as again:
            assert again.command(Pause()).ok


def test_the_session_of_the_run_can_be_asked_for(server, client):
    assert client.command(Step(count=2)).ok
    until(lambda: client.tick().index == 2, "the steps were not seen")
    session = msgspec.json.decode(client.session(), type=Session)
    assert (session.periods, session.scene.name) == (3, "fake")


def test_a_session_that_there_is_not_is_said_so():
    with fake_server(port=(port := free_port()), first=Load(scene="nothing")) as server:
        until(lambda: server.loop.status().state == "error", "no error")
        with TwinClient(server.endpoint) as client, pytest.raises(NoSession, match="no period was computed yet"):
            client.session()
    with TwinClient(f"tcp/127.0.0.1:{port}") as client, pytest.raises(NoSession, match="does not answer"):
        client.session(timeout=0.3)


def test_the_heartbeat_sees_a_changed_scene_file():
    class Edited(FakeLibrary):
        def changed(self):
            return self.loads == [("fake", None, None)]

        def load(self, scene, variant, seed):
            return msgspec.structs.replace(super().load(scene, variant, seed), title=f"edited {len(self.loads)} times")

    with TwinServer(TwinSetup(library=Edited(), make_twin=FakeTwin, first=Load(scene="fake"), playing=False)) as server:
        until(lambda: server.loop.status().text == "scene file changed: loaded again", "it is not loaded again")
        with TwinClient(server.endpoint) as client:
            until(lambda: client.scene() and client.scene().title == "edited 2 times", "the scene is not sent")


def test_while_a_scene_loads_the_newest_tick_is_of_the_one_before_and_said_to_be():
    go_on = threading.Event()

    class Slow(FakeTwin):
        def __init__(self, scene, **choices):
            assert scene.name == "fake" or go_on.wait(30.0)
            super().__init__(scene, **choices)

    with TwinServer(TwinSetup(library=FakeLibrary(), make_twin=Slow, first=FAKE, playing=False)) as server:
        with TwinClient(server.endpoint) as client:
            before = until(client.tick, "no tick")
            assert client.of_scene(before)
            loading = threading.Thread(target=client.command, args=(Load(scene="other"),), kwargs={"timeout": 30.0})
            loading.start()
            until(lambda: client.scene() and client.scene().name == "other", "the scene is not sent")
            assert client.tick().run == before.run
            assert not client.of_scene(client.tick())
            go_on.set()
            until(lambda: client.of_scene(client.tick()), "no tick of the other scene")
            loading.join()


def test_a_free_port_is_none_that_an_outgoing_connection_may_get():
    with socket.create_server(("127.0.0.1", 0)) as outgoing:
        assert all(free_port() < min(32_768, outgoing.getsockname()[1]) for _ in range(20))


@pytest.mark.parametrize(("host", "version"), [("192.0.2.1", 4), ("no.such.host.invalid", 4), ("2001:db8::1", 6)])
def test_an_address_of_another_machine_is_said_to_be_that_and_not_a_port_that_is_taken(host, version):
    for listen in (lambda: free_port(host), lambda: require_free_port(host, 8099, "choose another one")):
        with pytest.raises(ValueError, match=f"{host} is no IPv{version} address of this machine: give one of its own"):
            listen()


@pytest.mark.parametrize("port", [-1, 65_536, 99_999])
def test_a_port_out_of_range_is_refused_with_the_range(port):
    with pytest.raises(ValueError, match=f"port {port}: use 1 to 65535"):
        require_free_port("127.0.0.1", port, "choose another one")


def test_a_taken_port_is_an_error_and_not_another_port():
    with fake_server() as server:
        with pytest.raises(PortTaken, match=str(server.port)):
            fake_server(port=server.port)


def test_a_client_can_close_while_it_notices_the_twin(server, monkeypatch):
    client = TwinClient(server.endpoint)
    until(client.tick, "no tick")
    start = threading.Thread.start

    def close_first(thread):
        client.close()
        start(thread)

    noticed = []

    def notices(sample):
        try:
            noticed.append(client._on_alive(sample))
        except RuntimeError as error:
            noticed.append(error)

    monkeypatch.setattr(threading.Thread, "start", close_first)
    with open_client(server.endpoint) as session:
        session.liveliness().declare_subscriber(server.keys.alive, direct(notices), history=True)
        until(lambda: noticed, "the twin was not noticed")
    assert noticed == [None]


def test_the_port_is_free_and_no_thread_is_left_after_closing():
    port, before = free_port(), {thread.name for thread in threading.enumerate()}
    for _ in range(5):
        with fake_server(port=port):
            pass
    until(lambda: {t.name for t in threading.enumerate()} <= before, "threads are left")


def test_the_server_listens_on_loopback_only():
    with fake_server() as server, pytest.raises(zenoh.ZError):
        config = zenoh.Config()
        config.insert_json5("mode", '"client"')
        config.insert_json5("scouting/multicast/enabled", "false")
        config.insert_json5("connect/endpoints", json.dumps([f"tcp/{_own_address()}:{server.port}"]))
        zenoh.open(config)


def _own_address():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
        except OSError:
            pytest.skip("this machine has only loopback")
        address = probe.getsockname()[0]
    if address.startswith("127."):
        pytest.skip("this machine has only loopback")
    return address


def test_closing_takes_less_than_two_seconds_even_in_a_long_period():
    slow, over = threading.Event(), threading.Event()

    class Slow(FakeTwin):
        def advance(self, budget=None):
            if self.index > 1:
                slow.set()
                over.wait(20.0)
            return super().advance()

    server = TwinServer(TwinSetup(library=FakeLibrary(), make_twin=Slow, first=Load(scene="fake")))
    server.start()
    until(slow.is_set, "the twin never started")
    began = time.monotonic()
    assert server.close() is False
    assert time.monotonic() - began < 3.0
    over.set()
