"""At a router, with the files of docs/scale.md: clients, two twins asked with wildcards, and members of a server."""

import json
import re
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from pathlib import Path

import msgspec
import pytest
import zenoh
from fake_twin import fake_server
from waiting import until

from motm_twin.bus import connection
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import COMMAND_NAMES, Load, Step
from motm_twin.bus.messages import StatusMessage
from motm_twin.bus.schemas import names

DOCS = Path(__file__).resolve().parents[2] / "docs" / "scale.md"


@pytest.fixture
def routers(tmp_path):
    """Two linked routers, opened with the file that the text shows; where each listens."""
    (shown,) = re.findall(r"```json5\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    sessions, endpoints = [], []
    for number in range(2):
        endpoint = f"tcp/127.0.0.1:{connection.free_port()}"
        link = f'connect: {{ endpoints: ["{endpoints[-1]}"] }},' if endpoints else ""
        file = tmp_path / f"router-{number}.json5"
        file.write_text(
            shown.replace("tcp/0.0.0.0:7450", endpoint).replace('mode: "router",', f'mode: "router", {link}')
        )
        sessions.append(zenoh.open(zenoh.Config.from_file(str(file))))
        endpoints.append(endpoint)
    yield endpoints
    for session in reversed(sessions):
        session.close()


def test_twins_at_one_router_are_read_and_commanded_through_it_and_through_another(routers, tmp_path, monkeypatch):
    site, viewer = tmp_path / "site.json5", tmp_path / "viewer.json5"
    shipped = connection.SHIPPED.read_text(encoding="utf-8")
    site.write_text(shipped.replace("connect: { endpoints: [] }", f'connect: {{ endpoints: ["{routers[0]}"] }}'))
    viewer.write_text(shipped.replace('mode: "peer"', 'mode: "client"'))
    monkeypatch.setenv(connection.VARIABLE, str(site))
    made = [fake_server(playing=False, twin=name) for name in ("anna", "bert")]
    monkeypatch.setenv(connection.VARIABLE, str(viewer))
    with made[0] as anna, made[1]:
        for endpoint in routers:
            for name in ("anna", "bert"):
                with TwinClient(endpoint, name) as client:
                    until(lambda client=client: client.tick() and client.status() and client.scene(), f"no {name}")
                    assert client.status().twin == name
                    index = client.tick().index
                    answer = client.command(Step(), sender="visitor")
                    assert answer.ok, answer.reason
                    until(lambda client=client, index=index: client.tick().index == index + 1, f"{name} does not step")
        monkeypatch.delenv(connection.VARIABLE)
        with TwinClient(anna.endpoint, "anna") as near:
            until(near.tick, "its own port does not answer")


LATE = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", "'router'")
config.insert_json5("listen/endpoints", f"['{sys.argv[1]}']")
config.insert_json5("scouting/multicast/enabled", "false")
print("ready", flush=True)
time.sleep(0.5)
with zenoh.open(config):
    sys.stdin.read()
"""


def test_a_client_waits_a_moment_for_a_router_that_is_just_starting(tmp_path, monkeypatch):
    viewer, endpoint = tmp_path / "viewer.json5", f"tcp/127.0.0.1:{connection.free_port()}"
    viewer.write_text(connection.SHIPPED.read_text(encoding="utf-8").replace('mode: "peer"', 'mode: "client"'))
    monkeypatch.setenv(connection.VARIABLE, str(viewer))
    command = [sys.executable, "-c", LATE, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as router:
        assert router.stdout and router.stdout.readline() == "ready\n"
        with connection.open_client(endpoint) as session:
            assert session.info.routers_zid()
        router.communicate("")


TWINS = ("anna", "bert")
VARIANTS = {"anna": "a", "bert": "b"}
VALUES = ("tick", "status", "scene", "event", "session", "schema/tick")
TIMEOUT = 10.0  # [s]


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    """Of the router."""
    port = connection.free_port()
    router = zenoh.open(
        connection.session_config(listen=[f"tcp/{connection.LOOPBACK}:{port}"], connect=[], mode="router")
    )
    yield f"tcp/{connection.LOOPBACK}:{port}"
    router.close()


@pytest.fixture(scope="module")
def at_router(endpoint, tmp_path_factory):
    """Opens what is to meet at the router."""
    site = tmp_path_factory.mktemp("site") / "site.json5"
    shipped = connection.SHIPPED.read_text(encoding="utf-8")
    site.write_text(shipped.replace("connect: { endpoints: [] }", f'connect: {{ endpoints: ["{endpoint}"] }}'))

    def opened(make):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(connection.VARIABLE, str(site))
            return make()

    return opened


@pytest.fixture(scope="module")
def twins(at_router):
    with ExitStack() as stack:
        for name in TWINS:
            first = Load(scene="fake", variant=VARIANTS[name])
            made = at_router(lambda name=name, first=first: fake_server(first=first, playing=True, twin=name))
            stack.enter_context(made)
        yield


@pytest.fixture(scope="module")
def session(endpoint, twins):
    with connection.open_member(endpoint, wait=TIMEOUT) as plain:
        for key in (*VALUES, *(f"cmd/{name}" for name in COMMAND_NAMES)):  # it hears of one after the other
            until(lambda key=key: len(answers(plain, f"motm/*/{key}")) == len(TWINS), f"the twins do not meet: {key}")
        yield plain


def answers(session, selector, payload=None):
    """Payload by key; what comes twice on one key fails."""
    found = [reply.ok for reply in session.get(selector, payload=payload, timeout=TIMEOUT) if reply.ok is not None]
    by_key = {str(sample.key_expr): sample.payload.to_bytes() for sample in found}
    assert len(by_key) == len(found)
    return by_key


def status(session, name):
    (payload,) = answers(session, f"motm/{name}/status").values()
    return msgspec.json.decode(payload, type=StatusMessage)


def test_every_value_is_answered_by_each_twin_on_its_own_key(session):
    for key in VALUES:
        assert set(answers(session, f"motm/*/{key}")) == {f"motm/{name}/{key}" for name in TWINS}, key
    found = {f"motm/{name}/schema/{schema}" for name in TWINS for schema in names()}
    assert found <= set(answers(session, "motm/*/schema/**"))


def test_the_session_on_a_key_is_that_of_its_twin(session):
    found = answers(session, "motm/*/session")
    assert {name: json.loads(found[f"motm/{name}/session"])["scene"]["variant"] for name in TWINS} == VARIANTS


@pytest.mark.parametrize("selector", ["motm/*/cmd/pause", "motm/*/*/pause", "motm/*/cmd/p$*e"])
def test_a_command_to_all_twins_is_refused_by_each_on_its_own_key_and_does_nothing(session, selector):
    expires = status(session, "anna").server_time + TIMEOUT
    envelope = {"sender": "raw", "seq": time.time_ns(), "expires": expires, "command": {"type": "pause"}}
    found = answers(session, selector, json.dumps(envelope).encode())
    assert set(found) == {f"motm/{name}/cmd/pause" for name in TWINS}
    for key, payload in found.items():
        answer = json.loads(payload)
        assert not answer["ok"]
        assert answer["reason"] == f"a command is for one twin: send it to {key}, without a wildcard"
    assert {(status(session, name).state, status(session, name).driver) for name in TWINS} == {("playing", "")}


def test_a_wildcard_for_one_command_of_one_twin_is_refused_for_each_command_that_it_may_mean(session):
    found = answers(session, "motm/anna/cmd/*", b"")
    assert set(found) == {f"motm/anna/cmd/{name}" for name in COMMAND_NAMES}
    assert not any(json.loads(payload)["ok"] for payload in found.values())


def test_whoever_asks_for_everything_hears_from_each_twin_on_keys_without_a_wildcard(session):
    found = answers(session, "motm/**")
    assert {key.split("/")[1] for key in found} == set(TWINS)
    assert not [key for key in found if "*" in key]


def test_a_member_gives_up_with_a_sentence_when_nobody_answers():
    with pytest.raises(TimeoutError, match="nobody answers at tcp"):
        connection.open_member(f"tcp/{connection.LOOPBACK}:{connection.free_port()}", wait=0.0)


def test_a_member_does_not_wait_at_an_endpoint_that_is_none():
    with pytest.raises(connection.ConfigError, match="endpoint 'foo' is none of Zenoh: write it as tcp/"):
        connection.open_member("foo")


def test_a_member_that_waits_is_stopped():
    stop = threading.Event()
    with ThreadPoolExecutor() as pool:
        waiting = pool.submit(connection.open_member, f"tcp/{connection.LOOPBACK}:{connection.free_port()}", stop=stop)
        stop.set()
        with pytest.raises(TimeoutError, match="nobody answers at tcp"):
            waiting.result(20.0)


def test_members_see_each_other_through_a_server_that_comes_late_and_is_started_again():
    port, got = connection.free_port(), []
    with ThreadPoolExecutor() as pool:
        joining = [pool.submit(connection.open_member, f"tcp/{connection.LOOPBACK}:{port}") for _ in range(2)]
        server = connection.open_server(port)
        giver, taker = (member.result(20.0) for member in joining)
    with (
        giver,
        taker,
        taker.declare_subscriber("t/value", lambda sample: got.append(sample.payload.to_string())),
        giver.declare_queryable("t/question", lambda query: query.reply("t/question", "answer")),
        giver.liveliness().declare_token("t/alive"),
        giver.declare_publisher("t/value") as publisher,
    ):

        def arrived(life):
            publisher.put(life)
            return life in got

        def answered():
            return [r.ok.payload.to_string() for r in taker.get("t/question", timeout=1.0) if r.ok] == ["answer"]

        for life in ("first", "second"):
            until(lambda life=life: arrived(life))
            until(answered)
            until(lambda: any(True for _ in taker.liveliness().get("t/*", timeout=1.0)))
            if life == "first":
                server.close()
                server = connection.open_server(port)
    server.close()
