"""Sliders and the twin's parameters: what is sent and followed; and comparisons of a run with others."""

import threading
from types import SimpleNamespace

import msgspec
import pytest
from page import until
from person import status

from motm_twin.bus.commands import SetParameter
from motm_twin.bus.library import MethodLibrary
from motm_twin.bus.messages import MethodChoice
from motm_twin.control.tuning import PARAMETERS, PRESETS, check, parameter
from motm_twin.methods.registry import FAST
from motm_twin.model.scene_file import load_scene
from motm_twin.record.what_if import parse_changes
from motm_twin.sessions.session import encode_session
from motm_twin.twin import Twin
from motm_twin.ui.panel import tune_tab
from motm_twin.ui.panel.tune_tab import TuningValues, begun_since, hint, marks, result, shipped_with, summary, title
from motm_twin.ui.scene.robot_view import labels
from motm_twin.ui.what_if import RUNS, Other, Outcome, Runs, State, WhatIf, arguments


@pytest.fixture
def clock():
    return SimpleNamespace(now=100.0)


@pytest.fixture
def values(clock):
    return TuningValues(lambda: clock.now)


def test_the_last_value_wins_and_five_a_second_are_sent(values, clock):
    for value in (1.1, 1.2, 1.3):
        values.move("next_weight", value)
    assert values.due() == [SetParameter(name="next_weight", value=1.3)]
    values.move("next_weight", 1.4)
    assert values.due() == []
    clock.now += tune_tab.INTERVAL
    assert values.due() == [SetParameter(name="next_weight", value=1.4)]
    assert values.due() == []


def test_sliders_follow_what_others_set(values):
    assert values.follow({"xi": 0.9}) == ["xi"]
    assert values.chosen["xi"] == 0.9 and values.due() == []
    assert values.follow({"xi": 0.9}) == []
    assert values.follow({}) == ["xi"]
    assert values.chosen["xi"] == parameter("xi").default


def test_a_slider_under_the_hand_is_left_alone_and_a_refused_one_goes_back(values, clock):
    values.move("xi", 1.2)
    values.due()
    assert values.follow({}) == []
    clock.now += tune_tab.HOLD + 0.1
    assert values.follow({}) == ["xi"]
    assert values.chosen["xi"] == parameter("xi").default


def test_apart_from_the_twin_nothing_is_sent_or_followed(values, clock):
    values.follow({"d_s": 0.3})
    values.part(True)
    values.move("next_weight", 0.0)
    clock.now += 1.0
    assert values.due() == [] and values.follow({"xi": 1.0}) == []
    assert values.compared() == {"next_weight": 0.0, "d_s": 0.3, "xi": parameter("xi").default}
    assert values.differs()
    values.part(False)
    assert set(values.follow({"xi": 1.0})) == {"xi", "next_weight", "d_s"}
    assert not values.differs()


def test_reset_sends_what_differs_only(values, clock):
    values.follow({"xi": 1.0})
    values.reset([entry.name for entry in PARAMETERS])
    assert values.due() == [SetParameter(name="xi", value=parameter("xi").default)]


@pytest.mark.parametrize("name", PRESETS)
def test_presets_can_be_set(values, name):
    values.reset([entry.name for entry in PARAMETERS], values.preset(name))
    for command in values.due():
        assert command.value is not None
        check(command.name, command.value)
    wanted = {key: value for key, value in PRESETS[name].items() if value != parameter(key).default}
    assert values.changed() == wanted


@pytest.mark.parametrize("entry", PARAMETERS, ids=lambda entry: entry.name)
def test_every_parameter_is_shown_with_the_papers_value(entry):
    assert title(entry, True) == "● " + title(entry, False)
    about, marked = hint(entry, entry.default), marks(entry, entry.default)
    assert entry.unit in title(entry, False) and entry.help in about
    places = [value for value, _ in marked]
    if entry.kind == "number":
        assert entry.default in places and all(entry.low <= value <= entry.high for value in places)
        if entry.paper is not None and entry.low <= entry.paper <= entry.high:
            assert any(words.startswith("paper") for _, words in marked)
    if entry.paper is not None:
        assert "Paper: " in about


class TestMethod:
    """As shipped means the method that drives."""

    @pytest.fixture
    def fast(self, values):
        values.ship(shipped_with(status(method=FAST.name, methods=MethodLibrary().choices())))
        values.follow(FAST.parameters)
        return values

    def test_a_method_that_nobody_has_changed_is_as_shipped(self, fast):
        assert fast.changed() == fast.compared() == {} and not fast.differs()
        assert "All as shipped with MotM, fast" in summary(fast, "MotM, fast")
        assert fast.preset("As shipped") == fast.chosen != fast.preset("The paper's words")

    def test_reset_brings_back_the_values_of_the_method(self, fast):
        everything = [entry.name for entry in PARAMETERS]
        fast.reset(everything)
        assert fast.due() == []
        fast.reset(everything, fast.preset("The paper's words"))
        assert fast.chosen["bezier_offset"] == parameter("bezier_offset").default
        fast.reset(["bezier_offset"])
        assert fast.chosen["bezier_offset"] == 0.1
        fast.reset(everything)
        assert fast.changed() == {}

    def test_a_comparison_also_sets_what_is_a_default_but_not_as_shipped(self, fast):
        fast.move("bezier_offset", parameter("bezier_offset").default)
        assert fast.compared() == {"bezier_offset": parameter("bezier_offset").default}

    def test_both_the_papers_value_and_that_of_the_method_are_marked(self, fast):
        entry = parameter("bezier_offset")
        assert [value for value, _ in marks(entry, fast.shipped[entry.name])] == [0.1, 0.25]
        assert "Paper: 0.25." in hint(entry, 0.1) and "drives: 0.1." in hint(entry, 0.1)

    def test_what_this_page_does_not_know_is_left_out(self):
        choice = MethodChoice(name="new", title="", summary="", parameters={"xi": 1e9, "unheard_of": 1.0, "d_s": 0.3})
        assert shipped_with(status(method="new", methods=[choice])) == {**tune_tab.DEFAULTS, "d_s": 0.3}
        assert shipped_with(status(method="new")) == tune_tab.DEFAULTS


def test_the_summary_counts_what_is_changed(values):
    assert "All as shipped" in summary(values)
    assert "looking back" in summary(values, live=False)
    values.move("xi", 1.0)
    assert "<b>1</b> of" in summary(values)


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
    def test_between_two_samples_the_robot_moves_evenly_and_turns_the_short_way_and_stands_before_and_after(self):
        runs = Runs()
        runs.add(sample("as it was", 1.0, 0.0, 3.0))
        runs.add(sample("as it was", 1.1, 0.2, -3.0))
        (before,), (robot,), (after,) = (runs.at(time) for time in (0.0, 1.05, 99.0))
        assert (robot.pose[0], robot.pose[2]) == (pytest.approx(0.1), pytest.approx(3.1416, abs=1e-3))
        assert (before.pose[0], after.pose[0]) == (0.0, 0.2)

    def test_both_are_shown_up_to_where_both_are_known(self):
        runs = Runs()
        for run, last in zip(RUNS, (3, 8), strict=True):
            for at in range(last + 1):
                runs.add(sample(run, float(at)))
        assert runs.common() == 3.0
        runs.add(outcome("as it was", 2.5))
        assert runs.common() == 8.0
        assert [other.label for other in runs.at(2.6)] == ["as it was: 2.5 s", "changed"]

    @pytest.mark.parametrize(
        "line",
        [b"", b"nonsense", b"[]", b'{"run": "another", "time": 1}', b'{"run": "changed"}',
         b'{"run": "changed", "time": 0, "pose": [1], "q": [], "gripper": 0}', b'{"run": "changed", "done": true}'],
    )  # fmt: skip
    def test_what_is_no_line_of_the_process_is_refused(self, line):
        runs = Runs()
        with pytest.raises(ValueError):
            runs.add(line)
        assert runs.at(0.0) == [] and runs.add(b'{"error": "no such session"}') == "no such session"


def test_values_go_to_the_program_and_come_back_the_same():
    values = {entry.name: check(entry.name, entry.default) for entry in PARAMETERS}
    options = arguments(values, 30)
    assert options[:2] == ["--from", "1.500"]
    assert parse_changes(options[4::2]) == values


class TestLabels:
    def test_two_robots_at_one_place_have_one_label(self):
        for later in ("", " at 3 s"):
            ((words, place),) = labels([Other(run + later, (1.0, 2.0, 0.0), (0.0,) * 7, 0.08) for run in RUNS])
            assert words == f"both runs{later}" and place[:2] == (1.0, 2.0)

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
        was, changed = RUNS
        ended = {was: ended_run(was, 70.0), changed: replace(ended_run(changed, 64.5), forecast_from_s=12.3)}
        text = result(State(phase="done", outcomes=ended))
        assert all(words in text for words in ("5.5 s faster (forecast)", "70.0 s", "64.5 s", "from 12.3 s"))
        assert text.count(">forecast</div>") == 1

    def test_it_says_what_is_changed_and_how_far_it_is(self):
        values = {"next_weight": 0.0, "bezier": False, "d_s": 0.2, "xi": 0.5}
        text = result(State(phase="running", values={"next_weight": 0.0}, reached={"changed": 12.0}))
        assert "changed: Weight of the next target: 0</div>" in text and "at 12 s" in text
        assert "Bezier heuristic: off, Stop distance: 0.2, and 1 more" in result(State(phase="running", values=values))


@pytest.fixture
def now():
    return [10.0]


@pytest.fixture
def what_if(now):
    """A comparison of which a test gives the samples, at its own time."""
    return WhatIf(bytes, lambda: now[0])


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
        assert "session" in what_if.state.text and what_if.others(0.0) == []

    def test_without_a_server_it_says_so_and_another_can_be_started(self):
        def silent():
            raise RuntimeError("the twin server does not answer")

        what_if = WhatIf(silent)
        for _ in range(2):
            what_if.start({"next_weight": 0.0}, 0)
            until(lambda: what_if.state.phase == "failed")
            assert what_if.state.text == "the twin server does not answer"

    def test_after_a_branch_it_says_that_it_is_of_the_run_before(self, what_if):
        for run in RUNS:
            what_if._runs.add(sample(run, 0.0))
        what_if.state = State(phase="done", run=1)
        assert [other.label for other in what_if.others(0.0, 1)] == list(RUNS)
        assert all(other.label.endswith("(run before)") for other in what_if.others(0.0, 2))
        for past, word in ((1, "branch"), (-1, "reset")):
            assert begun_since(what_if.state, SimpleNamespace(run=2, past=past)) == word
            assert f"of the run before the {word}" in result(what_if.state, word)
        assert begun_since(what_if.state, SimpleNamespace(run=1, past=-1)) == ""

    def test_watched_alone_both_run_from_where_they_part_to_the_end(self, what_if, now):
        for run in RUNS:
            for at in range(10):
                what_if._runs.add(sample(run, float(at), float(at)))
        what_if.state = State(phase="done", start=3.0)
        assert what_if.others(99.0)[0].pose[0] == 9.0
        what_if.watch()
        assert what_if.others(99.0)[0].pose[0] == 3.0
        for later, watched in ((1.0, 6.0), (1.5, 9.0), (60.0, None)):
            now[0] += later
            assert what_if.watched == watched

    def test_who_else_is_about_in_either_run_is_shown_only_where_they_are_watched_alone(self, what_if, now):
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
