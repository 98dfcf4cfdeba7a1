"""Comparing a run with others: lines of the process are read, shown at one time, and it ends when asked."""

import threading
from types import SimpleNamespace

import msgspec
import pytest
from page import until

from motm_twin.control.tuning import PARAMETERS, check
from motm_twin.model.scene_file import load_scene
from motm_twin.record.what_if import parse_changes
from motm_twin.sessions.session import encode_session
from motm_twin.twin import Twin
from motm_twin.ui.panel.tune_tab import begun_since, result
from motm_twin.ui.scene.robot_view import labels
from motm_twin.ui.what_if import RUNS, Other, Outcome, Runs, State, WhatIf, arguments

replace = msgspec.structs.replace
HOSTILE = "<script>alert(1)</script>"


def sample(run, time, x=0.0, heading=0.0, movers=()):
    line = {"run": run, "time": time, "pose": (x, 0.0, heading), "q": (0.0,) * 7, "gripper": 0.08, "movers": movers}
    return msgspec.json.encode(line)


def ended_run(run, seconds, success=True, reason=""):
    return Outcome(
        run=run, time_s=seconds, picks=6, places=6, contacts=0, path_length=20.0, success=success, reason=reason
    )


def outcome(run, seconds):
    return msgspec.json.encode(ended_run(run, seconds))


class TestRuns:
    def test_between_two_samples_the_robot_moves_evenly_and_turns_the_short_way(self):
        runs = Runs()
        runs.add(sample("as it was", 1.0, 0.0, 3.0))
        runs.add(sample("as it was", 1.1, 0.2, -3.0))
        (robot,) = runs.at(1.05)
        assert robot.pose[0] == pytest.approx(0.1)
        assert robot.pose[2] == pytest.approx(3.1416, abs=1e-3)

    def test_before_and_after_its_samples_a_robot_stands(self):
        runs = Runs()
        for at in (1.0, 2.0):
            runs.add(sample("changed", at, at))
        assert runs.at(0.0)[0].pose[0] == 1.0 and runs.at(99.0)[0].pose[0] == 2.0

    def test_both_are_shown_up_to_where_both_are_known(self):
        runs = Runs()
        for run, last in zip(RUNS, (3, 8), strict=True):
            for at in range(last + 1):
                runs.add(sample(run, float(at)))
        assert runs.common() == 3.0
        runs.add(outcome("as it was", 2.5))
        assert runs.common() == 8.0
        assert [other.label for other in runs.at(2.6)] == ["as it was: 2.5 s", "changed"]

    def test_an_error_is_handed_on(self):
        assert Runs().add(b'{"error": "no such session"}') == "no such session"

    @pytest.mark.parametrize(
        "line",
        [b"", b"nonsense", b"[]", b'{"run": "another", "time": 1}', b'{"run": "changed"}',
         b'{"run": "changed", "time": 0, "pose": [1], "q": [], "gripper": 0}', b'{"run": "changed", "done": true}'],
    )  # fmt: skip
    def test_what_is_no_line_of_the_process_is_refused(self, line):
        runs = Runs()
        with pytest.raises(ValueError):
            runs.add(line)
        assert runs.at(0.0) == []


def test_values_go_to_the_program_and_come_back_the_same():
    values = {entry.name: check(entry.name, entry.default) for entry in PARAMETERS}
    options = arguments(values, 30)
    assert options[:2] == ["--from", "1.500"]
    assert parse_changes(options[4::2]) == values


class TestLabels:
    def test_two_robots_at_one_place_have_one_label(self):
        robots = [Other(run, (1.0, 2.0, 0.0), (0.0,) * 7, 0.08) for run in RUNS]
        (only,) = labels(robots)
        assert only[0] == "both runs" and only[1][:2] == (1.0, 2.0)
        behind = [Other(f"{run} at 3 s", (1.0, 2.0, 0.0), (0.0,) * 7, 0.08) for run in RUNS]
        assert labels(behind)[0][0] == "both runs at 3 s"

    def test_near_ones_share_a_label_that_tells_them_by_colour_and_far_ones_have_their_own(self):
        for apart, count in ((0.5, 1), (3.0, 2)):
            robots = [Other(run, (apart * i, 0.0, 0.0), (0.0,) * 7, 0.08) for i, run in enumerate(RUNS)]
            found = labels(robots)
            assert len(found) == count
            assert all(run in " ".join(text for text, _ in found) for run in RUNS)
        assert labels(robots[:1])[0][0] == RUNS[0] and labels([]) == []

    def test_a_time_that_is_a_forecast_says_so(self):
        runs = Runs()
        runs.add(sample("changed", 1.0))
        runs.add(msgspec.json.encode(replace(ended_run("changed", 1.0), forecast_from_s=0.5)))
        assert runs.at(1.0)[0].label == "changed: 1.0 s (forecast)"


class TestResult:
    def test_texts_are_escaped(self):
        assert HOSTILE not in result(State(phase="failed", text=HOSTILE))
        ended = {run: ended_run(run, 1.0, success=False, reason=HOSTILE) for run in RUNS}
        assert HOSTILE not in result(State(phase="done", outcomes=ended))

    def test_it_says_how_much_faster(self):
        ended = {
            run: replace(ended_run(run, seconds), forecast_from_s=begin)
            for run, seconds, begin in zip(RUNS, (70.0, 64.5), (None, 12.3), strict=True)
        }
        text = result(State(phase="done", outcomes=ended))
        assert "5.5 s faster" in text and "70.0 s" in text and "64.5 s" in text
        assert text.count(">forecast</div>") == 1 and "from 12.3 s" in text
        assert "5.5 s faster (forecast)" in text

    def test_it_says_what_is_changed(self):
        values = {"next_weight": 0.0, "bezier": False, "d_s": 0.2, "xi": 0.5}
        assert "changed: Weight of the next target: 0</div>" in result(
            State(phase="running", values={"next_weight": 0.0})
        )
        assert "Bezier heuristic: off, Stop distance: 0.2, and 1 more" in result(State(phase="running", values=values))

    def test_it_says_how_far_it_is(self):
        assert "at 12 s" in result(State(phase="running", reached={"changed": 12.0}))


class TestProcess:
    def test_a_session_is_computed_by_both_runs_and_the_process_ends_when_stopped(self):
        twin = Twin(load_scene("exp2", "random", 0))
        for _ in range(4):
            twin.advance()
        data = encode_session(twin.session())
        what_if = WhatIf(lambda: data)
        what_if.start({"next_weight": 0.0}, 2)
        with pytest.raises(ValueError, match="stop it first"):
            what_if.start({"next_weight": 0.0}, 2)
        until(lambda: len(what_if.state.reached) == len(RUNS) or what_if.state.phase == "failed")
        assert what_if.state.phase == "running", what_if.state.text
        assert [other.label for other in what_if.others(0.0)] == list(RUNS)
        assert all(" at " in other.label for other in what_if.others(9e3))  # not computed that far
        process = what_if._process
        what_if.stop()
        assert process.poll() is not None
        assert what_if.state == State() and what_if.others(0.0) == []
        until(lambda: not any(thread.name.startswith("what if") for thread in threading.enumerate()))

    def test_what_is_no_session_says_so(self):
        what_if = WhatIf(lambda: b"{}")
        what_if.start({"next_weight": 0.0}, 0)
        until(lambda: what_if.state.phase == "failed")
        assert "session" in what_if.state.text
        assert what_if.others(0.0) == []

    def test_without_a_server_it_says_so_and_another_can_be_started(self):
        def silent():
            raise RuntimeError("the twin server does not answer")

        what_if = WhatIf(silent)
        for _ in range(2):
            what_if.start({"next_weight": 0.0}, 0)
            until(lambda: what_if.state.phase == "failed")
            assert what_if.state.text == "the twin server does not answer"

    def test_after_a_branch_it_says_that_it_is_of_the_run_before(self):
        what_if = WhatIf(bytes)
        for run in RUNS:
            what_if._runs.add(sample(run, 0.0))
        what_if.state = State(phase="done", run=1)
        assert [other.label for other in what_if.others(0.0, 1)] == list(RUNS)
        assert all(other.label.endswith("(run before)") for other in what_if.others(0.0, 2))
        for past, word in ((1, "branch"), (-1, "reset")):
            assert begun_since(what_if.state, SimpleNamespace(run=2, past=past)) == word
            assert f"of the run before the {word}" in result(what_if.state, word)
        assert begun_since(what_if.state, SimpleNamespace(run=1, past=-1)) == ""

    def test_watched_alone_both_run_from_where_they_part_to_the_end(self):
        now = [10.0]
        what_if = WhatIf(bytes, lambda: now[0])
        for run in RUNS:
            for at in range(10):
                what_if._runs.add(sample(run, float(at), float(at)))
        what_if.state = State(phase="done", start=3.0)
        assert what_if.others(99.0)[0].pose[0] == 9.0
        what_if.watch()
        assert what_if.others(99.0)[0].pose[0] == 3.0
        now[0] += 1.0
        assert what_if.watched == 6.0
        now[0] += 1.5
        assert what_if.watched == 9.0
        now[0] += 60.0
        assert what_if.watched is None

    def test_who_else_is_about_in_either_run_is_shown_only_where_they_are_watched_alone(self):
        now = [10.0]
        what_if = WhatIf(bytes, lambda: now[0])
        temi = (0.25, 1.0)
        for run in RUNS:
            for at in range(2):
                what_if._runs.add(sample(run, float(at), movers=[(at, 2.0, *temi)]))
            what_if._runs.add(sample(run, 2.0))  # it has gone
        what_if.state = State(phase="done")
        assert not any(other.movers for other in what_if.others(0.5))
        what_if.watch()
        assert [other.movers for other in what_if.others(99.0)] == [((0.0, 2.0, *temi),)] * 2
        now[0] += 1.0 / 6.0
        assert what_if.others(99.0)[1].movers == (pytest.approx((0.5, 2.0, *temi)),)
        now[0] += 1.0
        assert what_if.others(99.0)[1].movers == ()
