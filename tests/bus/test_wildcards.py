"""Two twins at one router, asked with wildcards: each answers, on its own keys, and none obeys."""

import json
import time
from contextlib import ExitStack

import msgspec
import pytest
import zenoh
from fake_twin import fake_server
from waiting import until

from motm_twin.bus.commands import COMMAND_NAMES, Load
from motm_twin.bus.connection import LOOPBACK, SHIPPED, VARIABLE, free_port, open_member, session_config
from motm_twin.bus.messages import StatusMessage
from motm_twin.bus.schemas import names

TWINS = ("anna", "bert")
VARIANTS = {"anna": "a", "bert": "b"}
VALUES = ("tick", "status", "scene", "event", "session", "schema/tick")
TIMEOUT = 10.0  # [s]


@pytest.fixture(scope="module")
def endpoint(tmp_path_factory):
    """Of the router."""
    port = free_port()
    router = zenoh.open(session_config(listen=[f"tcp/{LOOPBACK}:{port}"], connect=[], mode="router"))
    yield f"tcp/{LOOPBACK}:{port}"
    router.close()


@pytest.fixture(scope="module")
def at_router(endpoint, tmp_path_factory):
    """Opens what is to meet at the router."""
    site = tmp_path_factory.mktemp("site") / "site.json5"
    shipped = SHIPPED.read_text(encoding="utf-8")
    site.write_text(shipped.replace("connect: { endpoints: [] }", f'connect: {{ endpoints: ["{endpoint}"] }}'))

    def opened(make):
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(VARIABLE, str(site))
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
    with open_member(endpoint, wait=TIMEOUT) as plain:
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
