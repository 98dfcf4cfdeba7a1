"""The loop with the real twin: edits of both kinds, going back, explanations, sessions."""

import itertools
import time

import msgspec
import pytest
from running import Running
from waiting import until

from motm_twin.bus import commands
from motm_twin.bus.library import FileLibrary
from motm_twin.control.tick import SETTLE_PERIODS
from motm_twin.control.tuning import parameter
from motm_twin.model.scene import DriveTo, Pick, Place
from motm_twin.planning.types import SearchBudget
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import Session
from motm_twin.twin import Twin

BODIES = ("objects", "agents", "obstacles", "furniture", "removed")


def real(scene="exp2", **options):
    return Running(Twin, library=FileLibrary(scene), first=scene, **options)


class ShortLibrary(FileLibrary):
    """Experiment 1 with one task: it is done soon."""

    def load(self, scene, variant, seed):
        loaded = super().load(scene, variant, seed)
        x, y, _ = loaded.start
        return msgspec.structs.replace(loaded, tasks=(DriveTo(point=(x + 0.1, y), tolerance=0.3),))


def done(running, command):
    assert running.ask(command) == ""


def named(bodies):
    return {body.name: body for body in bodies}


def session(running):
    got = []
    running.loop.session(lambda *answer: got.append(answer))
    until(lambda: got, "no session")
    payload, _, problem = got[0]
    assert problem == ""
    return msgspec.json.decode(payload, type=Session)


@pytest.fixture
def running():
    with real() as loop:
        yield loop


def test_what_a_paused_twin_previews_is_what_the_next_period_shows(running):
    done(running, commands.AddObstacle(name="crate", x=1.0, y=-0.5, size=(0.3, 0.3, 0.4)))
    assert running.last.preview
    assert named(running.last.obstacles)["crate"].position[:2] == [1.0, -0.5]
    agent, cube = running.last.agents[0].name, running.last.objects[0]
    x, y, z = cube.position
    done(running, commands.MoveBody(name=agent, x=-0.5, y=0.5))
    done(running, commands.MoveBody(name="table", x=3.4, y=1.9, heading=0.1))
    rode = named(running.last.objects)[cube.name].position
    assert rode[:2] != [x, y]
    assert rode[2] == pytest.approx(z)
    done(running, commands.MoveObject(name=cube.name, x=0.5, y=-0.8))
    assert named(running.last.objects)[cube.name].position[2] < z - 0.5
    done(running, commands.FreezeBody(name=running.last.agents[1].name))
    done(running, commands.RemoveBody(name=running.last.agents[2].name))
    assert running.last.removed == ["temi_3"]
    assert running.last.index == 0
    previewed = {field: getattr(running.last, field) for field in BODIES}
    running.step()
    assert not running.last.preview
    for field in ("objects", "obstacles", "furniture", "removed"):
        assert getattr(running.last, field) == previewed[field], field
    done(running, commands.RemoveBody(name="crate"))
    assert "crate" not in named(running.last.obstacles)


def test_edits_of_both_kinds_are_taken_logged_and_rerun(running):
    names = [agent.name for agent in running.last.agents]
    tasks = len(running.last.tasks)
    done(running, commands.SetParameter(name="xi", value=0.7))
    assert "xi" in running.ask(commands.SetParameter(name="xii", value=0.7))
    done(running, commands.SendAgent(name=names[0], x=0.5, y=-0.5))
    done(running, commands.MoveBody(name=names[1], x=-0.5, y=0.8))
    done(running, commands.ReleaseBody(name=names[1], velocity=(0.5, 0.0)))
    done(running, commands.PushRobot(dx=0.05, dy=0.0, turn=0.1))
    done(running, commands.InjectFault(fault="lidar_off", seconds=0.5))
    done(running, commands.RemoveTask(index=tasks - 1))
    done(running, commands.MoveTask(index=2, to=0))
    done(running, commands.Announce(name="table"))
    running.step(3)
    status = running.loop.status()
    assert status.parameters == {"xi": 0.7}
    assert status.recorded == 9
    assert running.last.faults
    assert len(running.last.tasks) == tasks - 2
    kept = session(running)
    assert (kept.periods, len(kept.edits)) == (4, 9)
    again = rerun(kept)
    assert again.ok
    assert again.state_hash == kept.state_hash


def test_going_back_forgets_what_came_after_and_lets_go_of_what_was_held(running):
    name = running.last.agents[0].name
    running.step(5)
    first = running.last.index
    running.step(3)
    done(running, commands.MoveBody(name=name, x=-0.5, y=0.5))
    running.step(4)
    assert named(running.last.agents)[name].state == "held"
    back_to = running.last.index
    done(running, commands.AddObstacle(name="late", x=0.5, y=-0.8, size=(0.3, 0.3, 0.4)))
    running.step(40)
    assert "not kept" in running.ask(commands.Branch(index=10_000))
    run = running.loop.status().run

    done(running, commands.Branch(index=back_to))
    status = running.loop.status()
    assert (status.run, status.state, running.last.run) == (run + 1, "paused", run + 1)
    assert running.last.index == back_to
    assert not running.last.obstacles
    assert named(running.last.agents)[name].state != "held"
    assert status.oldest == 0

    before = next(tick for tick in running.sink.ticks if tick.index == first)
    done(running, commands.Branch(index=first))
    assert (running.last.robot, running.last.agents) == (before.robot, before.agents)
    assert running.loop.status().recorded == 0
    assert (running.last.began, running.last.first) == (before.began, first)  # readers may keep what was before
    running.step(5)
    assert rerun(session(running)).ok


def test_a_branch_is_undone_and_the_run_goes_on_where_it_ended(running):
    assert "no branch to undo" in running.ask(commands.UndoBranch())
    done(running, commands.AddObstacle(name="early", x=0.5, y=-0.8, size=(0.3, 0.3, 0.4)))
    running.step(12)
    end, run = running.last.index, running.last.run
    done(running, commands.Branch(index=5))
    assert running.loop.status().aside == pytest.approx(0.05 * (end + 1))
    running.step(3)
    done(running, commands.UndoBranch())
    status, last = running.loop.status(), running.last
    assert (status.state, last.index, last.first, last.run, last.past) == ("paused", end + 1, end + 1, run + 2, run)
    assert status.aside == pytest.approx(0.05 * 9)
    assert [body.name for body in last.obstacles] == ["early"]
    assert rerun(session(running)).ok
    done(running, commands.Reset())
    assert running.loop.status().aside is None
    assert "no branch to undo" in running.ask(commands.UndoBranch())


def test_a_run_has_ended_when_the_work_was_done_also_after_a_branch_that_was_undone(running):
    running.step(3)
    assert running.last.ended is None
    for _ in range(sum(task.kind == "pick" for task in running.last.tasks)):
        done(running, commands.RemoveTask(index=0))
    running.step(4)
    ended = running.last.ended
    assert ended == pytest.approx(0.05 * 4) and running.last.time > ended
    done(running, commands.Branch(index=2))
    assert running.last.ended is None
    done(running, commands.UndoBranch())
    assert running.last.ended == ended


def test_readers_are_told_what_the_loop_goes_back_to(running):
    running.step(45)
    texts, tell = [], running.sink.status
    running.sink.status = lambda: (texts.append(running.loop.status().text), tell())
    done(running, commands.Branch(index=43))
    assert "going back to 2.1 s" in texts
    assert running.last.index == 43


def test_a_candidate_and_the_unmodified_path_are_explained_until_a_new_run(running):
    chosen = running.last.placement.chosen
    done(running, commands.Inspect(candidate=chosen, staa_path=True))
    assert not running.last.preview
    assert running.last.inspected.candidate == chosen
    assert running.last.inspected.path[-1] == pytest.approx(running.last.placement.poses[chosen][:2], abs=1e-3)
    assert len(running.last.plan.staa_path) >= 2
    running.step()
    assert running.last.inspected.candidate == chosen
    rejected = next(i for i, reason in enumerate(running.last.placement.rejected) if reason)
    done(running, commands.Inspect(candidate=rejected))
    assert (running.last.inspected, running.last.plan.staa_path) == (None, [])
    done(running, commands.Inspect(candidate=chosen))
    began = running.last.began
    done(running, commands.Reset())
    assert running.last.inspected is None
    assert running.last.began > began


def test_an_explanation_that_fails_does_not_stop_the_robot(capsys):
    class Mute(Twin):
        def staa_path(self):
            raise RuntimeError("no words")

    with Running(Mute, library=FileLibrary("exp1"), first="exp1") as running:
        done(running, commands.Inspect(staa_path=True))
        running.step(2)
        assert running.loop.status().state == "paused"
    assert "no words" in capsys.readouterr().err


def test_a_task_that_is_added_after_the_end_brings_the_run_back():
    with Running(Twin, library=ShortLibrary("exp1"), first="exp1") as running:
        running.ask(commands.Play())
        until(lambda: running.loop.status().state == "done", "it never ends", 60.0)
        ended_at = running.last.index
        assert ended_at >= SETTLE_PERIODS - 1
        cube = running.last.objects[0].name
        bin_name = running.sink.scenes[0].bins[0].name
        done(running, commands.InsertTask(tasks=(Pick(object=cube), Place(bin=bin_name))))
        assert running.loop.status().state == "playing"
        until(lambda: running.last.index > ended_at + SETTLE_PERIODS + 5, "it does not go on", 60.0)
        assert [task.status for task in running.last.tasks] == ["done", "active", "waiting"]


def test_a_robot_that_is_done_can_be_driven_by_hand_and_is_done_again():
    with Running(Twin, library=ShortLibrary("exp1"), first="exp1") as running:
        running.ask(commands.Play())
        until(lambda: running.loop.status().state == "done", "it never ends", 60.0)
        done(running, commands.Drive(v=-0.2))
        assert running.loop.status().state == "playing"
        until(lambda: any("by hand" in tick.plan.status for tick in running.sink.ticks), "nobody drives it", 60.0)
        until(lambda: running.loop.status().state == "done", "it never ends again", 60.0)
        assert rerun(session(running)).ok


def test_a_scene_can_be_loaded_while_somebody_drives(running):
    running.ask(commands.Play())
    done(running, commands.MoveBody(name=running.last.agents[0].name, x=0.0, y=0.8))
    done(running, commands.Load(scene="exp1"))
    status = running.loop.status()
    assert (status.scene, status.state, status.driver_name) == ("exp1", "playing", "Ann")
    until(lambda: running.last.index > 3, "it does not play")
    runs = [tick.run for tick in running.sink.ticks]
    assert all(after >= before for before, after in itertools.pairwise(runs))


def test_a_standing_twin_shows_the_tasks_and_parameters_that_wait_as_they_will_be(running):
    before = running.last.tasks
    done(running, commands.InsertTask(tasks=(DriveTo(point=(0.5, 0.0)),), index=0))
    done(running, commands.RemoveTask(index=len(before) - 1))
    done(running, commands.SetParameter(name="next_weight", value=1.5))
    shown = running.last
    assert shown.preview
    assert len(shown.tasks) == len(before) - 1
    assert running.loop.status().parameters == {"next_weight": 1.5}
    running.step()
    assert [(t.kind, t.target) for t in running.last.tasks] == [(t.kind, t.target) for t in shown.tasks]
    assert running.loop.status().parameters == {"next_weight": 1.5}
    done(running, commands.SetParameter(name="next_weight", value=parameter("next_weight").default))
    assert running.loop.status().parameters == {}


def test_single_steps_do_not_depend_on_how_fast_the_machine_is():
    def hurried(scene, method):
        return Twin(scene, method=method, budget=SearchBudget(seconds=1e-9), clock=time.perf_counter)

    def cuts():
        return running.twins[-1].cuts

    with Running(hurried, library=FileLibrary("exp1"), first="exp1") as running:
        running.step(15)
        assert cuts() == []
        done(running, commands.Play())
        until(cuts, "the clock cuts no search while time runs")
