"""The table of parameters that can be changed while the twin runs."""

import dataclasses
import math

import pytest

from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.parameters import Parameters
from motm_twin.control.tuning import GROUPS, PARAMETERS, PRESETS, check, parameter, tuned
from motm_twin.model.number import MOTM, OWN, ROBOT, STAA, numbers_of
from motm_twin.planning.parameters import PlanningParameters, StaaParameters

BY_NAME = {entry.name: entry for entry in PARAMETERS}


def raw(entry, objects):
    value = objects
    for name in entry.path:
        value = getattr(value, name)
    return value


def another(entry):
    if entry.kind == "switch":
        return not entry.default
    if entry.kind == "choice":
        return next(choice for choice in entry.choices if choice != entry.default)
    return entry.high if entry.default != entry.high else entry.low


def test_names_are_unique_and_every_entry_is_explained():
    assert len(BY_NAME) == len(PARAMETERS)
    for entry in PARAMETERS:
        assert entry.group in GROUPS, entry.name
        assert entry.title, entry.name
        assert entry.help.endswith("."), entry.name
        assert entry.source in ("own", "STAA*", "MotM") or entry.source.startswith("Paper, Sec. "), entry.name


def test_without_values_the_parameters_are_as_shipped():
    assert tuned({}) == Parameters()
    assert tuned({entry.name: entry.default for entry in PARAMETERS}) == Parameters()


@pytest.mark.parametrize("name", BY_NAME)
def test_each_entry_changes_its_own_value_and_no_other(name):
    entry = BY_NAME[name]
    changed = tuned({name: another(entry)})
    assert raw(entry, changed) != raw(entry, tuned({}))
    assert type(raw(entry, changed)) is type(raw(entry, tuned({}))), "another type would be compiled anew"
    for other in PARAMETERS:
        if other.name != name:
            assert raw(other, changed) == raw(other, tuned({})), other.name


@pytest.mark.parametrize("name", [entry.name for entry in PARAMETERS if entry.kind == "number"])
def test_default_and_paper_value_are_in_range_and_on_a_step(name):
    entry = BY_NAME[name]
    assert entry.low < entry.high
    for value in (entry.default, entry.paper):
        if value is not None:
            assert entry.low <= value <= entry.high
            steps = (value - entry.low) / entry.step
            assert math.isclose(steps, round(steps), abs_tol=1e-6)


@pytest.mark.parametrize("name", [entry.name for entry in PARAMETERS if entry.kind == "number"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -1e9, 1e9, "0.5", True, None])
def test_a_value_that_is_no_number_in_range_is_refused_with_the_range(name, value):
    with pytest.raises(ValueError, match=name):
        check(name, value)


@pytest.mark.parametrize("value", [6.0, 6.5])
def test_without_an_acceleration_of_zero_a_robot_could_not_keep_its_speed(value):
    with pytest.raises(ValueError, match="number from 5 to 7"):
        check("notches", value)
    assert tuned({"notches": 5.0}).planning.staa.notches == 5


@pytest.mark.parametrize("value", [1.0, 0, "yes", None])
def test_a_switch_takes_true_and_false_only(value):
    with pytest.raises(ValueError, match="switch"):
        check("bezier", value)


@pytest.mark.parametrize("value", ["never", True, 1.0, None])
def test_a_choice_names_what_can_be_chosen(value):
    with pytest.raises(ValueError, match="reach_goal"):
        check("termination", value)


def test_a_whole_number_stays_one():
    assert tuned({"positions": 24.0}).planning.placement.positions == 24
    with pytest.raises(ValueError, match="whole"):
        check("positions", 24.5)


def test_an_unknown_name_lists_near_ones():
    with pytest.raises(ValueError, match="next_weight"):
        parameter("next_wieght")
    with pytest.raises(ValueError, match="there is no parameter"):
        tuned({"nothing like it": 1.0})


def test_ranges_of_values_that_must_not_cross_do_not_overlap():
    assert BY_NAME["radius_min"].high <= BY_NAME["radius_max"].low
    assert BY_NAME["d_s"].high < BY_NAME["d_i"].low
    assert BY_NAME["margin"].high < BY_NAME["clearance"].low
    assert BY_NAME["link_d_s"].high < ArmParameters().avoidance.link_d_i
    assert BY_NAME["furniture_d_s"].high < ArmParameters().avoidance.furniture_d_i


def test_the_paper_s_values_are_those_of_its_literal_reading():
    values = {entry.name: entry.paper for entry in PARAMETERS if entry.paper is not None}
    assert tuned(values) == tuned(PRESETS["The paper's words"])


def test_presets_are_the_variants_that_are_compared():
    literal = StaaParameters(termination="pass", drive_on=False, grid_weight=1.0, penalty="grid")
    assert tuned(PRESETS["The paper's words"]) == Parameters(planning=PlanningParameters(staa=literal))
    switches = ("goal_orientation", "rotation_cost", "bezier", "scale_penalty")
    plain = dataclasses.replace(literal, termination="reach_goal", **dict.fromkeys(switches, False))
    plain = dataclasses.replace(plain, prediction=1.0, moving_weight=1.0)
    assert tuned(PRESETS["STAA*"]) == Parameters(planning=PlanningParameters(staa=plain))
    assert tuned(PRESETS["As shipped"]) == tuned({})


def test_every_number_of_a_parameter_class_says_what_it_is():
    said = {found.path: found.number for found in numbers_of(Parameters())}
    assert not [path for path in _scalars(Parameters()) if path not in said]
    for path, number in said.items():
        assert number.reason, path
        assert number.source in (OWN, STAA, MOTM, ROBOT) or number.source.startswith("Paper, Sec. "), path


def _scalars(tree, path=()):
    names = getattr(tree, "__struct_fields__", None) or [field.name for field in dataclasses.fields(tree)]
    for name in names:
        value = getattr(tree, name)
        if isinstance(value, bool | int | float | str):
            yield (*path, name)
        else:
            yield from _scalars(value, (*path, name))
