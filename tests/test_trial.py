"""The public face: one call runs a trial, and its result says, shows and plots what came of it; verdicts of trials."""

from types import SimpleNamespace

import msgspec
import pytest

import motm_twin
from motm_twin.bus.encode import tick_message
from motm_twin.bus.events import EventLog, EventWatch
from motm_twin.bus.messages import CutInMessage
from motm_twin.control.tick import TaskState
from motm_twin.gym.env import RewardWeights, Score, reward, score_of
from motm_twin.model.names import MethodError, SceneError
from motm_twin.model.plant import Contact, Truth
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.trial import failure, run_scene
from motm_twin.twin import Twin


@pytest.fixture(scope="module")
def scene():
    return msgspec.structs.replace(motm_twin.load_scene("exp1", "trial1"), time_limit=2.0)


@pytest.fixture(scope="module")
def result(scene):
    return motm_twin.run(scene)


def test_the_face_offers_what_it_promises_and_nothing_else_by_accident():
    assert set(motm_twin.__all__) <= set(dir(motm_twin))
    assert all(getattr(motm_twin, name) is not None for name in motm_twin.__all__)
    with pytest.raises(AttributeError, match="it offers Result, Scene, Twin"):
        _ = motm_twin.nothing


def test_methods_are_listed_and_found_by_name():
    assert {"motm", "fast", "paper_literal"} <= set(motm_twin.methods.names())
    assert motm_twin.methods.find("fast").name == "fast"
    with pytest.raises(MethodError, match="motm"):
        motm_twin.methods.find("motn")


def test_a_result_is_the_report_that_the_command_line_prints(result, scene):
    report = run_scene(scene)
    assert result.state_hash == report["state_hash"]
    assert result.time_s == report["time_s"] == pytest.approx(2.0)
    assert not result.success and "time limit 2 s" in result.reason
    assert result.placed == (0, 6) and result.contacts == []


def test_the_track_has_one_row_per_period(result):
    track = result.track
    assert len(track.time) == 41  # the first at 0 s
    assert track.pose.shape == (41, 3) and track.twist.shape == (41, 2) and track.joints.shape == (41, 7)
    assert track.twist[-1, 0] > 0.1  # it drives


def test_a_result_shows_itself_in_a_shell_and_in_a_notebook(result):
    assert "exp1/trial1" in repr(result) and "0 of 6 placed" in repr(result)
    assert "<table>" in result._repr_html_() and "cube_" in result._repr_html_()


def test_a_result_is_plotted_and_saved(result, tmp_path):
    figure = result.plot(tmp_path / "speed.png")
    assert len(figure.axes) == 2
    assert (tmp_path / "speed.png").stat().st_size > 5000


def test_wrong_names_say_what_there_is(scene):
    with pytest.raises(SceneError, match="exp1"):
        motm_twin.run("exp_1")
    with pytest.raises(ValueError, match="load_scene"):
        motm_twin.run(scene, seed=3)
    with pytest.raises(ValueError, match="next_weight"):
        motm_twin.run(scene, parameters={"next_wait": 0.0})


def contact(*, caused):
    return Contact(time=1.0, body="base", other="temi", depth=0.01, closing_speed=0.1, other_speed=0.0,
                   caused_by_robot=caused, duration=0.1, bodies=("base",))  # fmt: skip


@pytest.fixture(scope="module")
def truth() -> Truth:
    return SimulatedPlant(load_scene("exp1", "trial1")).truth()


def test_only_contacts_that_the_robot_caused_cost_a_reward_and_both_numbers_are_known(truth):
    tick = SimpleNamespace(tasks=())
    before = score_of(Score(), tick, truth, 0.0)
    touched = msgspec.structs.replace(truth, contacts=(contact(caused=True), contact(caused=False)))
    after = score_of(before, tick, touched, 0.0)
    assert (after.contacts, after.caused) == (2, 1)
    assert reward(RewardWeights(), before, after) == RewardWeights().contact


def test_what_was_dropped_and_not_put_right_is_known_by_its_name(truth):
    dropped = msgspec.structs.replace(truth, dropped=("cube3",))
    assert score_of(Score(), SimpleNamespace(tasks=()), dropped, 0.0).dropped == {"cube3"}
    tick = SimpleNamespace(done=True, truth=dropped, tasks=())
    assert failure(SimpleNamespace(), tick, False, 0, ()) == "dropped, and not picked up and placed again: cube3"


def test_an_object_in_another_bin_than_the_robot_believes_is_named(truth):
    """Of two look-alikes each was put where the other belongs: which ones was not said."""
    a, b = (one.name for one in truth.objects[:2])
    states = dict(zip((a, b), ("binned:drop2", "binned:drop1"), strict=True))
    objects = tuple(msgspec.structs.replace(one, state=states.get(one.name, one.state)) for one in truth.objects)
    done = [("pick", a), ("place", "drop1"), ("pick", b), ("place", "drop1")]
    tasks = tuple(TaskState(kind=kind, target=target, status="done", attempts=1) for kind, target in done)
    tick = SimpleNamespace(done=True, truth=msgspec.structs.replace(truth, objects=objects, places=1), tasks=tasks)
    said = failure(SimpleNamespace(), tick, False, 0, ())
    assert said.endswith(f"believes to have placed: {a} is not in drop1")


def test_a_cut_in_is_told_once(truth):
    told = []
    watch = EventWatch(EventLog(lambda: 0.0, told.append))
    period = tick_message(Twin(load_scene("exp1", "trial1")).advance(), run=1, server_time=0.0)
    cuts = [CutInMessage(time=0.04, agent=name, gap=0.31, stopping_way=0.56, speed=0.4) for name in ("temi1", "temi2")]

    def at(index, *cut_ins):
        score = msgspec.structs.replace(period.score, cut_ins=list(cut_ins))
        watch.tick(msgspec.structs.replace(period, index=index, time=0.05 * index, events=[], score=score))
        return [(event.other, event.text) for event in told if event.kind == "cut_in"]

    assert at(0) == []
    both = [(name, f"cut in on {name}, 0.31 m before it") for name in ("temi1", "temi2")]
    assert at(1, *cuts) == both
    assert at(2, *cuts) == both
