"""Members: sessions that see each other through the server, whether it is there already or not."""

import threading
from collections.abc import Iterator

import pytest
import zenoh
from meeting import until

from motm_twin.bus.connection import LOOPBACK, ConfigError, free_port, open_member, open_server


@pytest.fixture
def port() -> Iterator[int]:
    """A free port."""
    yield free_port()


def test_a_member_gives_up_with_a_sentence_when_nobody_answers(port: int) -> None:
    with pytest.raises(TimeoutError, match="nobody answers at tcp"):
        open_member(f"tcp/{LOOPBACK}:{port}", wait=0.0)


def test_a_member_does_not_wait_at_an_endpoint_that_is_none() -> None:
    with pytest.raises(ConfigError, match="endpoint 'foo' is none of Zenoh: write it as tcp/"):
        open_member("foo")


def test_a_member_that_waits_is_stopped(port: int) -> None:
    stop = threading.Event()
    ended = threading.Event()

    def wait() -> None:
        with pytest.raises(TimeoutError):
            open_member(f"tcp/{LOOPBACK}:{port}", stop=stop)
        ended.set()

    thread = threading.Thread(target=wait)
    thread.start()
    stop.set()
    thread.join(20.0)
    assert ended.is_set()


def test_members_see_each_other_through_a_server_that_comes_late_and_is_started_again(port: int) -> None:
    members: dict[str, zenoh.Session] = {}

    def join(name: str) -> None:
        members[name] = open_member(f"tcp/{LOOPBACK}:{port}")

    threads = [threading.Thread(target=join, args=(name,)) for name in ("giver", "taker")]
    for thread in threads:
        thread.start()
    server = open_server(port)
    for thread in threads:
        thread.join(20.0)
    giver, taker = members["giver"], members["taker"]
    got: list[str] = []
    subscriber = taker.declare_subscriber("t/value", lambda sample: got.append(sample.payload.to_string()))
    queryable = giver.declare_queryable("t/question", lambda query: query.reply("t/question", "answer"))
    token = giver.liveliness().declare_token("t/alive")
    publisher = giver.declare_publisher("t/value")
    try:
        for life in ("first", "second"):

            def arrived(life: str = life) -> bool:
                publisher.put(life)
                return life in got

            def answered() -> bool:
                return [r.ok.payload.to_string() for r in taker.get("t/question", timeout=1.0) if r.ok] == ["answer"]

            until(arrived)
            until(answered)
            until(lambda: any(True for _ in taker.liveliness().get("t/*", timeout=1.0)))
            if life == "first":
                server.close()
                server = open_server(port)
    finally:
        for declared in (subscriber, queryable, token, publisher):
            declared.undeclare()
        giver.close()
        taker.close()
        server.close()
