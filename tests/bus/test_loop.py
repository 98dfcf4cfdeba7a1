import threading

import pytest
from fake_twin import FakeLibrary, FakeTwin
from waiting import until

from motm_twin.bus.commands import (
    AddObstacle,
    Load,
    MoveBody,
    Pause,
    Play,
    ReleaseBody,
    RemoveBody,
    Reset,
    Speed,
    Step,
)
from motm_twin.bus.loop import SETTLE_PERIODS, TwinLoop


class Sink:
    """Collects what the loop says."""

    def __init__(self):
        self.ticks, self.scenes, self.states = [], [], 0

    def tick(self, message, tick, last):
        self.ticks.append(message)

    def scene(self, scene):
        self.scenes.append(scene)

    def status(self):
        self.states += 1


class Running:
    """A loop in its thread, with commands that wait for their answers."""

    def __init__(self, make_twin=FakeTwin, playing=False, first="fake"):
        self.sink, self.library = Sink(), FakeLibrary()
        self.twins = []

        def make(scene):
            self.twins.append(make_twin(scene))
            return self.twins[-1]

        self.loop = TwinLoop(
            twin_name="t",
            library=self.library,
            make_twin=make,
            sink=self.sink,
            first=Load(scene=first),
            playing=playing,
        )
        self.thread = threading.Thread(target=self.loop.run)

    def __enter__(self):
        self.thread.start()
        until(lambda: self.loop.status().state != "loading", "the loop never left loading")
        return self

    def __exit__(self, *_):
        self.loop.stop()
        self.thread.join(10.0)
        assert not self.thread.is_alive()

    def ask(self, command):
        answers, answered = [], threading.Event()

        def reply(reason, index):
            answers.append((reason, index))
            answered.set()

        self.loop.request(command, reply)
        assert answered.wait(10.0)
        return answers[0][0]

    @property
    def last(self):
        return self.sink.ticks[-1]


def test_a_paused_twin_stands_and_steps_exactly_as_often_as_told():
    with Running() as running:
        assert (running.loop.status().state, running.last.index) == ("paused", 1)
        assert running.ask(Step(count=7)) == ""
        assert running.last.index == 8
        assert running.ask(Step()) == ""
        assert running.last.index == 9


def test_play_pause_and_reset():
    with Running() as running:
        assert running.ask(Play()) == ""
        until(lambda: running.last.index > 3, "time does not run")
        assert running.ask(Pause()) == ""
        stands_at = running.last.index
        assert running.ask(Step()) == ""
        assert running.last.index == stands_at + 1
        run = running.loop.status().run
        assert running.ask(Reset()) == ""
        assert (running.last.index, running.loop.status().run) == (1, run + 1)
        assert running.loop.status().state == "paused"


def test_an_edit_acts_in_the_next_period_and_is_previewed_while_paused():
    with Running() as running:
        assert running.ask(AddObstacle(name="crate", x=1.0, y=2.0)) == ""
        assert running.last.preview
        assert [(body.name, body.position[:2]) for body in running.last.obstacles] == [("crate", [1.0, 2.0])]
        assert running.ask(MoveBody(name="crate", x=3.0, y=2.0)) == ""
        assert running.ask(MoveBody(name="temi1", x=-1.0, y=0.5)) == ""
        assert running.last.index == 1
        running.ask(Step())
        assert not running.last.preview
        assert running.last.obstacles[0].position[:2] == [3.0, 2.0]
        assert running.last.agents[0].position[:2] == [-1.0, 0.5]
        assert running.ask(RemoveBody(name="crate")) == ""
        running.ask(Step())
        assert running.last.obstacles == []


def test_edits_of_unknown_or_taken_names_are_refused_with_the_names_there_are():
    with Running() as running:
        assert "temi1" in running.ask(MoveBody(name="temi7", x=0.0, y=0.0))
        assert "no 'cube1'" in running.ask(RemoveBody(name="cube1"))
        assert "in use" in running.ask(AddObstacle(name="temi1", x=0.0, y=0.0))
        assert "in use" in running.ask(AddObstacle(name="desk", x=0.0, y=0.0))
        assert running.ask(AddObstacle(name="x", x=0.0, y=0.0)) == ""
        assert "in use" in running.ask(AddObstacle(name="x", x=0.0, y=0.0))
        assert "outside the world" in running.ask(AddObstacle(name="y", x=95.0, y=0.0))
        assert [body.name for body in running.last.obstacles] == ["x"]


def test_an_error_in_a_period_stops_time_and_is_told_and_reset_recovers(capsys):
    with Running(lambda scene: FakeTwin(scene, fail_at=5), playing=True) as running:
        until(lambda: running.loop.status().state == "error", "the error is not told")
        assert running.loop.status().text == "RuntimeError: the fake twin was told to fail"
        assert "stopped with an error" in running.ask(Play())
        running.twins[-1].fail_at = None
        assert running.ask(Reset()) == ""
        assert running.loop.status().state == "paused"
    assert "told to fail" in capsys.readouterr().err


def test_a_run_ends_after_settling_and_play_starts_it_again():
    with Running(lambda scene: FakeTwin(scene, periods=3)) as running:
        running.ask(Step(count=3 + SETTLE_PERIODS))
        assert running.loop.status().state == "done"
        assert "ended" in running.ask(Step())
        assert running.ask(Play()) == ""
        assert (running.loop.status().run, running.last.run) == (2, 2)
        assert running.loop.status().state == "playing"


def test_another_scene_can_be_loaded_and_a_wrong_one_changes_nothing():
    with Running() as running:
        assert "did you mean fake" in running.ask(Load(scene="fakke"))
        assert (running.loop.status().scene, running.loop.status().run) == ("fake", 1)
        assert running.ask(Load(scene="other", variant="c", seed=4)) == ""
        status = running.loop.status()
        assert (status.scene, status.variant, status.seed, status.run) == ("other", "c", 4, 2)
        assert [scene.name for scene in running.sink.scenes] == ["fake", "other"]


def test_a_first_scene_that_fails_is_told_and_another_can_be_loaded():
    with Running(first="nothing") as running:
        assert running.loop.status().state == "error"
        assert "did you mean" in running.loop.status().text
        assert "no scene" in running.ask(Play())
        assert running.ask(Load(scene="fake")) == ""
        assert running.loop.status().state == "playing"


def test_a_held_body_is_let_go_when_its_holder_falls_silent(monkeypatch):
    monkeypatch.setattr("motm_twin.bus.holds.SILENCE", 0.0)
    released = []

    class Watching(FakeTwin):
        def post(self, edit):
            if isinstance(edit, ReleaseBody):
                released.append(edit.name)
            super().post(edit)

    with Running(Watching) as running:
        assert running.ask(MoveBody(name="temi1", x=0.0, y=0.0)) == ""
        until(lambda: released == ["temi1"], "nobody let go")


@pytest.mark.parametrize("factor", [0.5, 8.0])
def test_the_wanted_speed_is_told(factor):
    with Running() as running:
        assert running.ask(Speed(factor=factor)) == ""
        assert running.loop.status().speed == factor
