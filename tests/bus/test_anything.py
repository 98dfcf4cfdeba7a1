"""Whatever a driver does to the real twin, it goes on: every command is done or refused, and no period fails."""

import math

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from running import Running

from motm_twin.bus import commands
from motm_twin.bus.commands import Branch, Inspect, Refused, Reset, UndoBranch, check_command
from motm_twin.bus.library import FileLibrary
from motm_twin.control.tuning import PARAMETERS
from motm_twin.model.faults import NAMES as FAULTS
from motm_twin.model.scene import BEHAVIOURS, DriveTo, Pick, Place
from motm_twin.model.scene_file import load_scene
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
