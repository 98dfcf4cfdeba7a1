"""Sliders and the twin's parameters: what is sent, what is followed, what a comparison takes."""

from types import SimpleNamespace

import pytest
from person import status

from motm_twin.bus.commands import SetParameter
from motm_twin.bus.library import MethodLibrary
from motm_twin.bus.messages import MethodChoice
from motm_twin.control.tuning import PARAMETERS, PRESETS, check, parameter
from motm_twin.methods.registry import FAST
from motm_twin.ui.panel.tune_tab import (
    DEFAULTS,
    HOLD,
    INTERVAL,
    TuningValues,
    hint,
    marks,
    shipped_with,
    summary,
    title,
)


def driven_by(method):
    return status(method=method.name, methods=MethodLibrary().choices())


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
    clock.now += INTERVAL
    assert values.due() == [SetParameter(name="next_weight", value=1.4)]
    assert values.due() == []


def test_sliders_follow_what_others_set(values):
    assert values.follow({"xi": 0.9}) == ["xi"]
    assert values.wanted["xi"] == 0.9 and values.due() == []
    assert values.follow({"xi": 0.9}) == []
    assert values.follow({}) == ["xi"]
    assert values.wanted["xi"] == parameter("xi").default


def test_a_slider_under_the_hand_is_left_alone_and_a_refused_one_goes_back(values, clock):
    values.move("xi", 1.2)
    values.due()
    assert values.follow({}) == []
    clock.now += HOLD + 0.1
    assert values.follow({}) == ["xi"]
    assert values.wanted["xi"] == parameter("xi").default


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
        values.ship(shipped_with(driven_by(FAST)))
        values.follow(FAST.parameters)
        return values

    def test_a_method_that_nobody_has_changed_is_as_shipped(self, fast):
        assert fast.changed() == fast.compared() == {} and not fast.differs()
        assert "All as shipped with MotM, fast" in summary(fast, "MotM, fast")
        assert fast.preset("As shipped") == fast.wanted != fast.preset("The paper's words")

    def test_reset_brings_back_the_values_of_the_method(self, fast):
        everything = [entry.name for entry in PARAMETERS]
        fast.reset(everything)
        assert fast.due() == []
        fast.reset(everything, fast.preset("The paper's words"))
        assert fast.wanted["bezier_offset"] == parameter("bezier_offset").default
        fast.reset(["bezier_offset"])
        assert fast.wanted["bezier_offset"] == 0.1
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
        assert shipped_with(status(method="new", methods=[choice])) == {**DEFAULTS, "d_s": 0.3}
        assert shipped_with(status(method="new")) == DEFAULTS


def test_the_summary_counts_what_is_changed(values):
    assert "All as shipped" in summary(values)
    assert "looking back" in summary(values, live=False)
    values.move("xi", 1.0)
    assert "<b>1</b> of" in summary(values)
