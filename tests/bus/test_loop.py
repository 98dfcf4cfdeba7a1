import contextlib
import itertools
import time
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin
from running import Running
from waiting import until

from motm_twin.bus.commands import (
    COMMAND_NAMES,
    AddObstacle,
    Command,
    Envelope,
    HandOver,
    Inspect,
    Load,
    MoveBody,
    Pause,
    Play,
    Refused,
    ReleaseBody,
    Reset,
    Speed,
    Step,
    TakeWheel,
)
from motm_twin.bus.live import MAX_ADDED
from motm_twin.bus.loop import STANDING_INTERVAL
from motm_twin.control.tick import SETTLE_PERIODS
from motm_twin.perf.fuzz import EXAMPLES


def test_a_paused_twin_stands_however_late_its_clock_is_read(monkeypatch):
    """What is to be shown may become due between two looks at the clock; that is no reason for a period."""
    reads = itertools.accumulate(itertools.cycle(np.linspace(0.1, 0.7, 13) * STANDING_INTERVAL))
    late = SimpleNamespace(monotonic=lambda: next(reads), perf_counter=time.perf_counter)
    monkeypatch.setattr("motm_twin.bus.loop.time", late)
    with Running() as running:
        for number in range(120):
            assert running.ask(Inspect(candidate=number % 40)) == ""
        assert running.last.index == 0


def test_play_pause_step_and_reset(running):
    assert (running.loop.status().state, running.last.index) == ("paused", 0)
    assert running.ask(Play()) == ""
    until(lambda: running.last.index > 3, "time does not run")
    assert running.ask(Pause()) == ""
    running.step(7)
    running.step()  # exactly as often as told
    run = running.loop.status().run
    assert running.ask(Reset()) == ""
    assert (running.last.index, running.loop.status().run) == (0, run + 1)
    assert running.loop.status().state == "paused"


def test_an_edit_that_the_twin_does_not_take_is_refused_in_its_words_and_forgotten(running):
    assert running.ask(AddObstacle(name="x", x=0.0, y=0.0)) == ""
    assert running.ask(AddObstacle(name="y", x=95.0, y=0.0)) == "that is outside the world"
    assert [body.name for body in running.last.obstacles] == ["x"]
    for number in range(MAX_ADDED - 1):
        assert running.ask(AddObstacle(name=f"x{number}", x=0.0, y=0.0)) == ""
    assert "remove one first" in running.ask(AddObstacle(name="one more", x=0.0, y=0.0))


def test_an_error_in_a_period_stops_time_and_is_told_and_reset_recovers(capsys):
    with Running(lambda scene, method: FakeTwin(scene, method=method, fail_at=5), playing=True) as running:
        until(lambda: running.loop.status().state == "error", "the error is not told")
        assert running.loop.status().text == "RuntimeError: the fake twin was told to fail"
        assert "stopped with an error" in running.ask(Play())
        running.twins[-1].fail_at = None
        assert running.ask(Reset()) == ""
        assert running.loop.status().state == "paused"
    assert "told to fail" in capsys.readouterr().err


def test_an_error_is_over_before_the_answer_to_who_leaves_it(capsys):
    """A status of the old error that is told after the answer was taken for one of the new run."""
    with Running(lambda scene, method: FakeTwin(scene, method=method, fail_at=5), playing=True) as running:
        until(lambda: running.loop.status().state == "error", "the error is not told")
        for number, command in enumerate((Reset(), Load(scene="other"))):
            told = []
            envelope = Envelope(sender="ann", seq=number, expires=time.time() + 60.0, command=command)
            running.loop.request(envelope, lambda *_, told=told: told.append(running.loop.status().state))
            assert until(lambda told=told: told, "no answer") == ["loading"]
            until(lambda: running.loop.status().state != "loading", "it does not begin")
    assert "told to fail" in capsys.readouterr().err


def fails(*_):
    raise MemoryError("no memory")


@pytest.mark.parametrize("part", ["request", "wheel", "session"])
def test_an_error_between_two_periods_is_told_and_does_not_end_the_loop(running, monkeypatch, capsys, part):
    """The thread of the loop ended, and the twin still said that it plays."""
    loop = running.loop
    assert running.ask(Play()) == ""
    with monkeypatch.context() as broken:
        if part == "request":
            loop._put(fails)
        else:
            broken.setattr(*{"wheel": (loop._wheel, "look_after"), "session": (loop._sessions, "serve")}[part], fails)
        until(lambda: loop.status().state == "error", "the error is not told")
    assert loop.status().text == "MemoryError: no memory"
    assert running.ask(Reset()) == ""
    running.step()
    assert "no memory" in capsys.readouterr().err


def test_a_run_ends_after_settling_and_play_starts_it_again():
    with Running(lambda scene, method: FakeTwin(scene, method=method, periods=3)) as running:
        running.ask(Step(count=3 + SETTLE_PERIODS))
        until(lambda: running.loop.status().state == "done", "the run does not end")
        assert "ended" in running.ask(Step())
        assert running.ask(Play()) == ""
        assert (running.loop.status().run, running.last.run) == (2, 2)
        assert running.loop.status().state == "playing"


def test_another_scene_can_be_loaded_and_a_wrong_one_changes_nothing(running):
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
    monkeypatch.setattr("motm_twin.bus.commands.HELD_FOR", 0.0)
    released = []

    class Watching(FakeTwin):
        def post(self, edit):
            if isinstance(edit, ReleaseBody):
                released.append(edit.name)
            super().post(edit)

    with Running(Watching) as running:
        assert running.ask(MoveBody(name="temi1", x=0.0, y=0.0)) == ""
        until(lambda: released == ["temi1"], "nobody let go")


def test_one_drives_others_look_until_the_wheel_is_handed_over(running):
    assert running.ask(Speed(factor=2.0)) == ""
    status = running.loop.status()
    assert (status.driver, status.driver_name) == ("ann", "Ann")
    assert 0.0 < status.driver_left <= 10.0
    assert "Ann is driving" in running.ask(Speed(factor=4.0), sender="bob", name="Bob")
    assert running.loop.status().speed == 2.0
    assert running.ask(Inspect(candidate=3), sender="bob", name="Bob") == ""
    assert running.ask(HandOver(to="bob", name="Bob")) == ""
    assert "Bob is driving" in running.ask(Play())
    assert running.ask(Speed(factor=0.5), sender="bob", name="Bob") == ""
    assert running.loop.status().speed == 0.5
    assert running.ask(HandOver(), sender="bob", name="Bob") == ""
    assert running.loop.status().driver == ""


def test_a_wheel_that_is_handed_over_without_a_name_shows_the_one_that_was_heard(running):
    assert running.ask(Speed(factor=2.0)) == ""
    assert "Ann is driving" in running.ask(Play(), sender="bob", name="Bob")
    assert running.ask(HandOver(to="bob")) == ""
    assert running.loop.status().driver_name == "Bob"
    assert running.ask(HandOver(to="cid"), sender="bob", name="Bob") == ""
    assert running.loop.status().driver_name == "cid"  # nobody has heard of him


def test_a_refused_command_and_an_inspection_take_no_wheel(running):
    assert "to move" in running.ask(MoveBody(name="ghost", x=0.0, y=0.0))
    assert running.ask(Inspect(staa_path=False)) == ""
    assert running.loop.status().driver == ""
    assert running.ask(TakeWheel(), name="") == ""
    assert running.loop.status().driver_name == "ann"


def test_a_change_of_driver_is_told_and_lets_go_of_what_was_held(monkeypatch):
    monkeypatch.setattr("motm_twin.bus.commands.SILENCE", 0.2)
    with Running() as running:
        before = running.sink.states
        assert running.ask(MoveBody(name="temi1", x=0.0, y=0.0)) == ""
        until(lambda: ReleaseBody(name="temi1") in running.twins[0].queue, "nobody let go")
        until(lambda: running.sink.states >= before + 2, "not told who has the wheel, or not that it is free")
        assert running.loop.status().driver == ""
        monkeypatch.setattr("motm_twin.bus.commands.SILENCE", 60.0)  # or the wheel may be free again before we look
        assert running.ask(MoveBody(name="temi1", x=1.0, y=0.0), sender="bob", name="Bob") == ""
        assert running.loop.status().driver_name == "Bob"


def test_a_command_that_waited_for_too_long_is_refused(running):
    assert "stale" in running.ask(Play(), expires=-0.1)
    assert running.loop.status().state == "paused"


def test_many_steps_can_be_ended_by_pause(running):
    assert running.ask(Step(count=100_000)) == ""
    assert running.ask(Pause()) == ""
    index = running.last.index
    assert index < 100_000
    running.step()
    assert running.last.index == index + 1


def test_what_the_robot_refuses_after_all_is_an_event():
    class Refusing(FakeTwin):
        def advance(self, budget=None):
            tick = super().advance(budget)
            self.refused = ["the robot has refused add_obstacle x: no"] if tick.edits else []
            return tick

    with Running(Refusing) as running:
        assert running.ask(AddObstacle(name="x", x=0.0, y=0.0)) == ""
        running.step(3)
        (event,) = running.sink.events
        text = "the robot has refused add_obstacle x: no"
        assert (event["kind"], event["text"], event["index"]) == ("refused", text, 1)


def test_an_edit_that_fails_in_the_twin_is_refused_and_the_loop_goes_on(capsys):
    class Broken(FakeTwin):
        def post(self, edit):
            raise RuntimeError("post is broken")

    with Running(Broken) as running:
        assert running.ask(AddObstacle(name="x", x=0.0, y=0.0)) == "RuntimeError: post is broken"
        running.step()
    assert "post is broken" in capsys.readouterr().err


@pytest.mark.parametrize("playing", [False, True])
def test_a_flood_of_inspections_neither_floods_the_readers_nor_stops_the_periods(playing):
    with Running(playing=playing) as running:
        start, first, asked = time.monotonic(), len(running.sink.ticks), 0
        index = running.last.index
        while asked < 2000 or (playing and running.last.index < index + 5):
            with contextlib.suppress(Refused):
                command = Inspect(candidate=asked % 40)
                envelope = Envelope(sender="eve", seq=asked, expires=time.time() + 60.0, command=command)
                running.loop.request(envelope, lambda *_: None)
            asked += 1
        until(lambda: accepted(running, Inspect(candidate=1)), "the flood never drains")
        sent, elapsed = len(running.sink.ticks) - first, time.monotonic() - start
        assert sent <= elapsed / STANDING_INTERVAL + 8  # late periods are caught up with
        assert all(tick.run == 1 for tick in running.sink.ticks)


def accepted(running, command):
    """Whether a command is done; one that finds the queue full is not."""
    with contextlib.suppress(Refused):
        return running.ask(command) == ""
    return False


def test_no_command_of_somebody_who_does_not_drive_has_an_effect():
    assert set(EXAMPLES) == set(COMMAND_NAMES)
    free = ("inspect", "audience")
    commands = [msgspec.convert({"type": name, **EXAMPLES[name]}, Command) for name in EXAMPLES if name not in free]
    with Running() as running:
        assert running.ask(TakeWheel()) == ""
        ticks, before = len(running.sink.ticks), running.loop.status()
        for command in commands:
            assert "Ann is driving" in running.ask(command, sender="bob", name="Bob"), command
        after = running.loop.status()
        assert running.twins[0].queue == []
        assert len(running.twins) == 1
        assert len(running.sink.ticks) == ticks
        same = {"server_time": 0.0, "driver_left": 0.0}
        assert msgspec.structs.replace(before, **same) == msgspec.structs.replace(after, **same)
