import threading

import pytest
from fake_twin import FakeTwin
from running import Running
from waiting import until

from motm_twin.bus import queries as module
from motm_twin.bus.commands import Step
from motm_twin.bus.connection import free_port, open_client, open_server
from motm_twin.bus.queries import DeferredQueryable, Idle

FOR_EVER = 1e6  # [s]


@pytest.fixture
def pair():
    port = free_port()
    with open_server(port) as server, open_client(f"tcp/127.0.0.1:{port}") as client:
        yield server, client


def echo(query):
    with query:
        query.reply(query.key_expr, b"yes")


def ask(client, key):
    """Ask in another thread; gives the thread and the list that the answers come into."""
    answers = []

    def wait():
        answers.extend(reply.ok.payload.to_bytes() for reply in client.get(key, timeout=20.0))

    thread = threading.Thread(target=wait, daemon=True)
    thread.start()
    return thread, answers


def linked(client, *keys):
    until(lambda: all(list(client.get(key, timeout=1.0)) for key in keys), "no link")


def test_queries_wait_until_it_is_quiet_and_then_all_are_answered(pair, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", FOR_EVER)
    server, client = pair
    idle = Idle()
    waiting = DeferredQueryable(server, ["test/waiting"], echo, idle)
    prompt = DeferredQueryable(server, ["test/prompt"], echo, Idle())
    linked(client, "test/waiting", "test/prompt")
    with idle.suspended():
        asked = [ask(client, "test/waiting") for _ in range(module.TOGETHER + 5)]
        until(lambda: len(list(client.get("test/prompt"))) == 1, "the other key is not answered")  # sent after those
        assert all(thread.is_alive() and not answers for thread, answers in asked)
    for thread, answers in asked:
        thread.join(20.0)
        assert answers == [b"yes"]
    for queryable in (waiting, prompt):
        queryable.undeclare()


def test_nobody_waits_for_ever_where_it_is_never_quiet(pair):
    server, client = pair
    idle = Idle()
    queryable = DeferredQueryable(server, ["test/never"], echo, idle)
    linked(client, "test/never")
    with idle.suspended():
        thread, answers = ask(client, "test/never")
        thread.join(20.0)
        assert answers == [b"yes"]
    queryable.undeclare()


def test_an_error_in_one_answer_does_not_end_the_answers_and_undeclare_does(pair, capfd):
    server, client = pair

    def answer(query):
        if "bad" in query.parameters:
            raise ValueError("this one is bad")
        echo(query)

    queryable = DeferredQueryable(server, ["test/errors"], answer, Idle())
    linked(client, "test/errors")
    assert list(client.get("test/errors?bad=1", timeout=5.0)) == []
    assert "this one is bad" in capfd.readouterr().err
    assert len(list(client.get("test/errors", timeout=5.0))) == 1
    queryable.undeclare()
    assert not any("test/errors" in thread.name for thread in threading.enumerate())
    assert list(client.get("test/errors", timeout=5.0)) == []


def test_what_was_asked_before_undeclare_is_answered(pair, monkeypatch):
    monkeypatch.setattr(module, "PATIENCE", FOR_EVER)
    server, client = pair
    idle, taken = Idle(), threading.Event()
    wait = idle.wait

    def told(timeout):
        taken.set()
        wait(timeout)

    queryable = DeferredQueryable(server, ["test/last"], echo, idle)
    linked(client, "test/last")
    idle.wait = told
    with idle.suspended():
        thread, answers = ask(client, "test/last")
        assert taken.wait(20.0)
        ending = threading.Thread(target=queryable.undeclare)
        ending.start()
    ending.join(20.0)
    thread.join(20.0)
    assert answers == [b"yes"]


def test_nobody_waits_for_a_robot_in_another_program():
    class Elsewhere:
        mirror = shared = False

        def ready(self):
            return True

        def text(self):
            return "a robot"

    class Outside(FakeTwin):
        external = Elsewhere()

        def advance(self, budget=None):
            seen.append(running.loop.idle.is_set())
            return super().advance(budget)

    seen = []
    running = Running(Outside, playing=True)
    with running:
        until(lambda: len(seen) > 3, "it does not run")
    assert all(seen[1:]), "the first one is before the robot is known"


def test_it_is_quiet_except_while_a_period_is_computed():
    seen = []

    class Watched(FakeTwin):
        def advance(self, budget=None):
            seen.append(running.loop.idle.is_set())
            if self.index == 3:
                raise RuntimeError("suspended")
            return super().advance(budget)

    running = Running(Watched)
    with running:
        running.step(2)
        assert running.loop.idle.is_set()
        assert seen == [False] * len(seen) and len(seen) >= 3
        running.ask(Step(count=2))
        until(lambda: running.loop.status().state == "error", "no error")
        assert running.loop.idle.is_set()
