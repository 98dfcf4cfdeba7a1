"""Every parameter that a person can change while the twin runs: its meaning, its bounds, and the paper's value.

The ranges are narrower than those of the parameter classes: within them, and in every combination, the robot keeps
clear of all that it knows and sees, and the period keeps its time. The monitor's limits cannot be changed here, but
passive safety, which the paper does not have, can be added.

The table is made from the fields of the parameter classes that have a `Slider`.
"""

import math
from collections.abc import Iterator, Mapping

import msgspec

from motm_twin.control.parameters import Parameters
from motm_twin.model.edits import ParameterValue
from motm_twin.model.names import hint
from motm_twin.model.number import Found, Slider, numbers_of, replaced
from motm_twin.model.profile import DEG

GROUPS = ("Base placement", "Base control", "Modifications", "Arm", "Obstacle avoidance", "Safety")


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter: its name and unit, the values that it may have, and its source."""

    name: str
    title: str
    symbol: str = ""  # as in the paper or its sources
    unit: str = ""
    group: str  # one of `GROUPS`
    kind: str = "number"  # "number" | "switch" | "choice"
    low: float = 0.0  # numbers only, as are high and step
    high: float = 0.0
    step: float = 0.0
    choices: tuple[str, ...] = ()
    default: ParameterValue
    paper: ParameterValue | None = None  # None: the paper gives no value
    help: str  # one sentence
    source: str  # "Paper, Sec. ..." | "STAA*" | "MotM" | "own"
    path: tuple[str, ...]  # where it is in `Parameters`
    scale: float = 1.0  # value of the parameter class = scale * value here
    whole: bool = False  # a whole number
    odd: bool = False  # an odd one, so that there is one in the middle


def _parameter(found: Found, slider: Slider) -> Parameter:
    """The entry of a field that a person can change."""
    default = found.default
    low, high, step = slider.span
    return Parameter(
        name=slider.name or found.path[-1],
        title=slider.title,
        symbol=found.number.symbol,
        unit="deg" if slider.degrees else found.number.unit,
        group=slider.group,
        kind="switch" if isinstance(default, bool) else "choice" if slider.choices else "number",
        low=low,
        high=high,
        step=step,
        choices=slider.choices,
        default=_shown(default, slider),
        paper=slider.paper,
        help=slider.help,
        source=found.number.source,
        path=found.path,
        scale=DEG if slider.degrees else 1.0,
        whole=isinstance(default, int) and not isinstance(default, bool),
        odd=slider.odd,
    )


def _shown(value: ParameterValue, slider: Slider) -> ParameterValue:
    """A value of a field in the unit of its slider."""
    if isinstance(value, bool | str):
        return value
    return round(value / DEG, 9) if slider.degrees else float(value)


def _changeable() -> Iterator[Parameter]:
    """Every field with a slider, by group, and in a group as the fields are written."""
    entries = [_parameter(each, each.slider) for each in numbers_of(Parameters()) if each.slider is not None]
    return iter(sorted(entries, key=lambda entry: GROUPS.index(entry.group)))


PARAMETERS: tuple[Parameter, ...] = tuple(_changeable())
_BY_NAME = {entry.name: entry for entry in PARAMETERS}

PRESETS: dict[str, dict[str, ParameterValue]] = {
    "As shipped": {},
    "The paper's words": {"termination": "pass", "drive_on": False, "grid_weight": 1.0, "penalty": "grid"},
    "STAA*": {
        "termination": "reach_goal", "drive_on": False, "grid_weight": 1.0, "penalty": "grid",
        "goal_orientation": False, "rotation_cost": False, "bezier": False, "scale_penalty": False,
        "prediction": 1.0, "moving_weight": 1.0,
    },
}  # fmt: skip


def parameter(name: str) -> Parameter:
    """The entry of a name; raises ValueError with a hint at similar names when there is none."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    raise ValueError(f"there is no parameter {name!r} (docs/zenoh.md, Parameters, lists all); {hint(name, _BY_NAME)}")


def check(name: str, value: ParameterValue) -> ParameterValue:
    """The value as the table keeps it; raises ValueError when the parameter cannot have it."""
    entry = parameter(name)
    if entry.kind == "switch":
        if not isinstance(value, bool):
            raise ValueError(f"{name} is a switch: true or false, not {value!r}")
        return value
    if entry.kind == "choice":
        if value not in entry.choices or not isinstance(value, str):
            raise ValueError(f"{name} cannot be {value!r}: use one of {', '.join(entry.choices)}")
        return value
    if isinstance(value, bool | str) or not isinstance(value, int | float) or not math.isfinite(value):
        raise ValueError(f"{name} is a number from {_range(entry)}, not {value!r}")
    if not entry.low <= value <= entry.high:
        raise ValueError(f"{name} = {value:g} is out of range: use {_range(entry)}")
    if entry.whole and value != round(value):
        raise ValueError(f"{name} = {value:g}: use a whole number from {_range(entry)}")
    if entry.odd and value % 2 == 0:
        raise ValueError(f"{name} = {value:g}: use an odd number from {_range(entry)}")
    return float(value)


def tuned(values: Mapping[str, ParameterValue], parameters: Parameters | None = None) -> Parameters:
    """The parameters with these values, everything else as in the given ones or as shipped.

    Raises ValueError for an unknown name or a value that is not allowed.
    """
    changed = parameters or Parameters()
    for name, value in values.items():
        entry = parameter(name)
        changed = replaced(changed, entry.path, _inner(entry, check(name, value)))
    return changed


def _inner(entry: Parameter, value: ParameterValue) -> ParameterValue:
    """A checked value in the unit and type of its parameter class: another type would be compiled anew."""
    if isinstance(value, bool | str):
        return value
    scaled = value * entry.scale if entry.scale != 1.0 else value
    return round(scaled) if entry.whole else scaled


def _range(entry: Parameter) -> str:
    unit = f" {entry.unit}" if entry.unit else ""
    return f"{entry.low:g} to {entry.high:g}{unit}"
