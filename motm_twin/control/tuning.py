"""Every parameter that a person can change while the twin runs: what it means, its bounds, and the paper's value.

The ranges are narrower than what the parameter classes accept: within them, and in every combination, the robot keeps
clear of what it knows and sees, and the period keeps its time. The monitor's limits cannot be changed here.
"""

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import msgspec

from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.model.edits import ParameterValue
from motm_twin.model.names import hint
from motm_twin.planning.parameters import DEG, PENALTIES, TERMINATIONS, PlanningParameters

GROUPS = ("Base placement", "Base control", "Modifications", "Arm", "Obstacle avoidance", "Safety")


class Parameter(msgspec.Struct, frozen=True, kw_only=True):
    """One parameter: how it is shown, what it may be, and where it comes from."""

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
    path: tuple[str, ...]  # where it is in (PlanningParameters, ArmParameters)
    scale: float = 1.0  # value of the parameter class = scale * value here
    whole: bool = False  # a whole number
    odd: bool = False  # an odd one, so that there is one in the middle


_DEFAULTS = {"planning": PlanningParameters(), "arm": ArmParameters()}


def _at(path: tuple[str, ...]) -> Any:
    value: Any = _DEFAULTS[path[0]]
    for name in path[1:]:
        value = getattr(value, name)
    return value


def _number(
    path: str, title: str, span: tuple[float, float, float], help: str, source: str, *, scale: float = 1.0, **more: Any
) -> Parameter:
    """A row of the table below; ``span``: lowest and highest value and step."""
    parts = tuple(path.split("."))
    default, name = _at(parts), more.pop("name", parts[-1])
    low, high, step = span
    return Parameter(
        name=name, title=title, low=low, high=high, step=step, help=help, source=source, path=parts, scale=scale,
        default=float(default) if scale == 1.0 else round(default / scale, 9), whole=isinstance(default, int), **more,
    )  # fmt: skip


def _switch(
    path: str, title: str, help: str, source: str, *, group: str, paper: bool | None = True, name: str = ""
) -> Parameter:
    parts = tuple(path.split("."))
    return Parameter(
        name=name or parts[-1], title=title, group=group, kind="switch", default=_at(parts), paper=paper, help=help,
        source=source, path=parts,
    )  # fmt: skip


def _choice(
    path: str, title: str, choices: tuple[str, ...], help: str, source: str, *, group: str, paper: str
) -> Parameter:
    parts = tuple(path.split("."))
    return Parameter(
        name=parts[-1], title=title, group=group, kind="choice", choices=choices, default=_at(parts), paper=paper,
        help=help, source=source, path=parts,
    )  # fmt: skip


PARAMETERS: tuple[Parameter, ...] = (
    _number("planning.placement.next_weight", "Weight of the next target", (0.0, 3.0, 0.05),
            "Weight of the way on to the next target when a place is chosen; 0 ignores it.",
            "Paper, Sec. IV", group="Base placement", paper=1.05),
    _number("planning.placement.radius_min", "Smallest ring", (0.45, 0.70, 0.05),
            "Radius of the first ring of candidates round the target.",
            "Paper, Sec. IV", group="Base placement", unit="m", paper=0.60),
    _number("planning.placement.radius_max", "Largest ring", (0.70, 0.95, 0.05),
            "Radius of the last ring that is tried when the smaller ones have no free candidate.",
            "Paper, Sec. IV", group="Base placement", unit="m", paper=0.80),
    _number("planning.placement.positions", "Positions on a ring", (12, 48, 4),
            "Positions per ring, each with two tangential headings; 36 are 10 degrees apart.",
            "Paper, Sec. IV", group="Base placement", paper=36.0),
    _number("planning.placement.hysteresis", "Loyalty to the choice", (0.0, 2.0, 0.1),
            "A new candidate must be this much cheaper than the one chosen before.",
            "own", group="Base placement", unit="s"),
    _number("planning.staa.local_radius", "Local region", (1.5, 5.0, 0.25),
            "How far round the robot the local search looks; beyond it the global path is followed.",
            "STAA*", group="Base control", unit="m"),
    _number("planning.staa.node_duration", "Time step of the search", (0.2, 0.5, 0.05),
            "Time between two nodes of the local search.",
            "STAA*", group="Base control", symbol="Dt", unit="s"),
    _number("planning.staa.notches", "Accelerations that are tried", (5, 7, 2),
            "So many from the strongest braking to the strongest acceleration, and as many of turning, at every node.",
            "STAA*", group="Base control", odd=True),
    _number("planning.staa.epsilon", "Weight of the heuristic", (0.5, 3.0, 0.1),
            "Above 1 the search goes straighter for the goal and finds worse motions sooner.",
            "STAA*", group="Base control", symbol="epsilon"),
    _number("planning.staa.grid_weight", "Proximity penalty", (0.0, 2.0, 0.05),
            "Time that a node beside an obstacle is charged for.",
            "STAA*", group="Base control", unit="s", paper=1.0),
    _number("planning.staa.grid_range", "Range of the penalty", (0.04, 0.40, 0.01),
            "Clearance below which the penalty grows from 0 to 1.",
            "own", group="Base control", unit="m"),
    _number("planning.staa.prediction", "Expect what moves", (0.0, 2.0, 0.1),
            "For so long the local search expects what moves to go on as it does; 0: it is an obstacle where it is.",
            "STAA*", group="Base control", unit="s", paper=0.0),
    _number("planning.staa.moving_weight", "Penalty beside what is expected", (0.0, 2.0, 0.1),
            "Time that a node at such an obstacle is charged for, less with every metre, nothing from 1 m on.",
            "STAA*", group="Base control", unit="s", paper=0.0),
    _number("planning.staa.steadiness", "Steadiness", (0.0, 0.2, 0.01),
            "Part of its time that turning faster or slower is charged for: the base drives fewer wriggles.",
            "own", group="Base control", paper=0.0),
    _choice("planning.staa.penalty", "What the penalty looks at", PENALTIES,
            "Clearance of the whole footprint, or the map's blurred grid at the corners of the hull.",
            "STAA*", group="Base control", paper="grid"),
    _number("planning.staa.pass_distance", "Close enough to pass", (0.05, 0.50, 0.01),
            "Distance from the candidate at which a passing path counts as there.",
            "own", group="Base control", unit="m"),
    _number("planning.staa.pass_heading", "Turned enough to pass", (5.0, 60.0, 1.0),
            "The same for the heading.",
            "own", group="Base control", unit="deg", scale=DEG),
    _switch("planning.staa.goal_orientation", "Goal orientation",
            "The local search wants the candidate's heading, not only its position.",
            "Paper, Sec. III-A", group="Modifications"),
    _switch("planning.staa.rotation_cost", "Rotation cost",
            "The global path pays for turning as PathRTR does.",
            "Paper, Sec. III-B", group="Modifications"),
    _choice("planning.staa.termination", "When the search is finished", TERMINATIONS,
            "task: the job is predicted to be done; pass: a path passes the candidate; reach_goal: it stops there.",
            "Paper, Sec. III-C", group="Modifications", paper="pass"),
    _switch("planning.staa.drive_on", "Drive on to the next target",
            "Motions that get the job done are judged by their way on to the next target.",
            "own", group="Modifications", paper=False),
    _switch("planning.staa.scale_penalty", "Scale the penalty",
            "The proximity penalty fades while the goal comes near: k = max(k_min, min(t_h / k_time, 1)).",
            "Paper, Sec. III-D", group="Modifications"),
    _number("planning.staa.k_min", "Least scale of the penalty", (0.0, 1.0, 0.05),
            "What is left of the penalty at the goal.",
            "Paper, Sec. III-D", group="Modifications", symbol="k", paper=0.1),
    _number("planning.staa.k_time", "Fading time", (0.5, 10.0, 0.5),
            "Time before the goal from which on the penalty fades.",
            "Paper, Sec. III-D", group="Modifications", symbol="t_h", unit="s", paper=3.0),
    _switch("planning.staa.bezier", "Bezier heuristic",
            "Nodes near the goal are judged by the time of a smooth curve to it.",
            "Paper, Sec. III-E", group="Modifications"),
    _number("planning.staa.bezier_offset", "Bezier control points", (0.05, 0.50, 0.05),
            "Their distance from the ends, as a share of the straight distance.",
            "Paper, Sec. III-E", group="Modifications", paper=0.25),
    _number("arm.k_A", "Start of the arm", (0.25, 1.0, 0.05),
            "The hand leaves when distance / (base speed k_A) is as long as the target needs to come into reach.",
            "MotM", group="Arm", symbol="k_A"),
    _number("arm.k_P", "Gain of the final approach", (3.0, 15.0, 0.5),
            "How briskly the hand closes the last distance to the grasp.",
            "MotM", group="Arm", symbol="k_P", unit="1/s"),
    _number("arm.approach_distance", "Final approach from", (0.06, 0.20, 0.01),
            "Distance of hand and target at which the final approach begins.",
            "MotM", group="Arm", symbol="d_T", unit="m"),
    _number("arm.hand_speed", "Speed of the hand", (0.3, 1.2, 0.05),
            "Fastest motion of the hand, relative to the base, on its way.",
            "own", group="Arm", unit="m/s"),
    _number("arm.hover_height", "Height of waiting", (0.05, 0.12, 0.01),
            "Of the hand above the object, until it is below the fingers and seen well.",
            "own", group="Arm", unit="m"),
    _number("arm.extension_lead", "Stretch out before arrival", (0.0, 1.5, 0.1),
            "How early the arm is stretched out fully: earlier arms meet more obstacles.",
            "own", group="Arm", unit="s"),
    _switch("arm.avoidance.enabled", "Arm avoidance",
            "The gripper's speed towards what the lidar sees outside the map is limited.",
            "Paper, Sec. V", group="Obstacle avoidance", name="arm_avoidance"),
    _number("arm.avoidance.xi", "Approach speed", (0.1, 1.5, 0.05),
            "Speed towards an obstacle that is allowed at the distance d_i.",
            "Paper, Sec. V", group="Obstacle avoidance", symbol="xi", unit="m/s", paper=0.6),
    _number("arm.avoidance.d_s", "Stop distance", (0.05, 0.35, 0.01),
            "The gripper comes no nearer to an obstacle than this.",
            "Paper, Sec. V", group="Obstacle avoidance", symbol="d_s", unit="m", paper=0.25),
    _number("arm.avoidance.d_i", "Influence distance", (0.40, 1.20, 0.05),
            "Obstacles further from the gripper than this do not slow it.",
            "Paper, Sec. V", group="Obstacle avoidance", symbol="d_i", unit="m", paper=0.6),
    _number("arm.avoidance.link_d_s", "Stop distance of the links", (0.02, 0.15, 0.01),
            "Of elbow, forearm and wrist from moving obstacles; the paper limits the gripper only.",
            "own", group="Obstacle avoidance", unit="m"),
    _number("planning.placement.clearance", "Clearance of a place", (0.06, 0.20, 0.01),
            "Room that a candidate pose must have round the base.",
            "own", group="Safety", unit="m"),
    _number("planning.staa.margin", "Clearance on the way", (0.03, 0.05, 0.01),
            "Room that every node of the local search keeps.",
            "own", group="Safety", unit="m"),
    _number("planning.staa.growth_margin", "Room beside the way", (0.03, 0.20, 0.01),
            "Obstacles are grown by half the width of the base and this much for the global path.",
            "own", group="Safety", unit="m"),
    _number("arm.avoidance.furniture_d_s", "Arm to furniture", (0.01, 0.04, 0.005),
            "Distance that the whole arm keeps from mapped furniture, except the fingers at a grasp.",
            "own", group="Safety", unit="m"),
)  # fmt: skip

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
    """The entry of a name; ValueError with the names there are when there is none."""
    if name in _BY_NAME:
        return _BY_NAME[name]
    raise ValueError(f"there is no parameter {name!r} (docs/zenoh.md, Parameters, lists all); {hint(name, _BY_NAME)}")


def check(name: str, value: ParameterValue) -> ParameterValue:
    """The value as the table keeps it; ValueError when the parameter cannot have it."""
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


def tuned(
    values: Mapping[str, ParameterValue],
    planning: PlanningParameters | None = None,
    arm: ArmParameters | None = None,
) -> tuple[PlanningParameters, ArmParameters]:
    """The parameter objects with these values, everything else as in the given objects or as shipped.

    Raises ValueError for an unknown name or a value that is not allowed.
    """
    base, hand = planning or PlanningParameters(), arm or ArmParameters()
    for name, value in values.items():
        entry = parameter(name)
        inner = _inner(entry, check(name, value))
        if entry.path[0] == "planning":
            base = _changed(base, entry.path[1:], inner)
        else:
            hand = _changed(hand, entry.path[1:], inner)
    return base, hand


def _inner(entry: Parameter, value: ParameterValue) -> ParameterValue:
    """A checked value in the unit and type of its parameter class: another type would be compiled anew."""
    if isinstance(value, bool | str):
        return value
    scaled = value * entry.scale if entry.scale != 1.0 else value
    return round(scaled) if entry.whole else scaled


def _changed(owner: Any, path: tuple[str, ...], value: ParameterValue) -> Any:
    """A copy of nested frozen objects in which one value is another."""
    inner = value if len(path) == 1 else _changed(getattr(owner, path[0]), path[1:], value)
    if isinstance(owner, msgspec.Struct):
        return msgspec.structs.replace(owner, **{path[0]: inner})
    return dataclasses.replace(owner, **{path[0]: inner})


def _range(entry: Parameter) -> str:
    unit = f" {entry.unit}" if entry.unit else ""
    return f"{entry.low:g} to {entry.high:g}{unit}"
