"""A twin under bad treatment, in small numbers: whatever is sent to it and whatever a driver does, it goes on.

`motm-twin bench soak` does the same by the thousand.
"""

import itertools
import math
import signal
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from running import Running
from waiting import until

from motm_twin.bus import commands
from motm_twin.bus.commands import Branch, Inspect, Refused, Reset, Speed, Step, UndoBranch, check_command
from motm_twin.bus.connection import open_client, open_member
from motm_twin.bus.library import FileLibrary
from motm_twin.control.tuning import PARAMETERS
from motm_twin.model.faults import NAMES as FAULTS
from motm_twin.model.scene import BEHAVIOURS, DriveTo, Pick, Place
from motm_twin.model.scene_file import load_scene
from motm_twin.perf import bus, soak
from motm_twin.perf.processes import Worker, act, restart
from motm_twin.perf.report import Report
from motm_twin.twin import Twin

SCENE = load_scene("exp2")
NAMES = st.sampled_from(
    [
        "crate",
        "person 1",
        "table",
        "cabinet",
        *(item.name for item in (*SCENE.agents, *SCENE.objects[:2], *SCENE.bins, *SCENE.solids[:2])),
    ]
)
X, Y = st.floats(-2.0, 8.0), st.floats(-3.0, 5.0)
INDEX = st.integers(0, 14)
TURN = st.none() | st.floats(-math.pi, math.pi)
TASKS = st.lists(
    st.one_of(
        st.builds(Pick, object=st.sampled_from([item.name for item in SCENE.objects])),
        st.builds(Place, bin=st.sampled_from([item.name for item in SCENE.bins])),
        st.builds(DriveTo, point=st.tuples(X, Y), heading=TURN),
    ),
    min_size=1,
    max_size=3,
).map(tuple)


@st.composite
def parameter_changes(draw):
    parameter = draw(st.sampled_from(PARAMETERS))
    if parameter.kind == "number":
        value = draw(st.floats(parameter.low, parameter.high))
    else:
        value = draw(st.booleans() if parameter.kind == "switch" else st.sampled_from(parameter.choices))
    return commands.SetParameter(name=parameter.name, value=draw(st.sampled_from([None, value])))


ANYTHING = st.one_of(
    st.builds(
        commands.AddObstacle,
        name=NAMES,
        shape=st.sampled_from(["box", "cylinder", "temi", "person"]),
        x=X,
        y=Y,
        size=st.tuples(*[st.floats(0.05, 2.0)] * 3),
    ),
    st.builds(commands.MoveBody, name=NAMES, x=X, y=Y, heading=TURN, held=st.booleans()),
    st.builds(commands.ReleaseBody, name=NAMES, velocity=st.tuples(st.floats(-3.0, 3.0), st.floats(-3.0, 3.0))),
    st.builds(commands.FreezeBody, name=NAMES, frozen=st.booleans()),
    st.builds(commands.SetBehaviour, name=NAMES, behaviour=st.sampled_from(BEHAVIOURS)),
    st.builds(commands.SendAgent, name=NAMES, x=X, y=Y),
    st.builds(commands.RemoveBody, name=NAMES),
    st.builds(commands.MoveObject, name=NAMES, x=X, y=Y),
    st.builds(commands.PushRobot, dx=st.floats(-1.0, 1.0), dy=st.floats(-1.0, 1.0), turn=st.floats(-3.0, 3.0)),
    st.builds(commands.InjectFault, fault=st.sampled_from(FAULTS), seconds=st.floats(0.01, 2.0)),
    st.builds(commands.InsertTask, tasks=TASKS, index=st.none() | INDEX),
    st.builds(commands.RemoveTask, index=INDEX),
    st.builds(commands.MoveTask, index=INDEX, to=INDEX),
    parameter_changes(),
    st.builds(commands.Announce, name=NAMES),
    st.builds(commands.Drive, v=st.floats(-1.0, 1.0), w=st.floats(-3.0, 3.0)),
    st.builds(Inspect, candidate=st.integers(-1, 80), staa_path=st.booleans()),
    st.builds(Branch, index=st.integers(0, 60)),
    st.just(UndoBranch()),
)


@pytest.fixture(scope="module")
def running():
    with Running(Twin, library=FileLibrary("exp2"), first="exp2") as loop:
        yield loop


@settings(max_examples=20, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(ANYTHING, min_size=1, max_size=8))
def test_a_driver_can_do_anything_and_the_twin_goes_on(running, history):
    assert running.ask(Reset()) == ""
    for command in history:
        try:
            check_command(command)
        except Refused:
            continue
        answer = running.ask(command)
        assert "Error: " not in answer, (command, answer)
        assert running.loop.status().state == "paused", (command, running.loop.status().text)
        running.step(2)
        assert running.loop.status().state == "paused", (command, running.loop.status().text)


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
