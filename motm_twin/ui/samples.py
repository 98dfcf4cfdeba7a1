"""What plots, timing and the list of events read of each period, without decoding the rest."""

import math
from typing import NamedTuple

import msgspec

from motm_twin.bus.messages import EventMessage, MaybeNumber, Vector

STAGES = ("map", "place", "plan", "arm", "monitor")  # of the period; its time is their sum


class _Robot(msgspec.Struct, frozen=True):
    twist: Vector
    dq: Vector


class _Arm(msgspec.Struct, frozen=True):
    slack: list[MaybeNumber]
    obstacle_distance: MaybeNumber


class Part(msgspec.Struct, frozen=True):
    """The fields of a TickMessage that are needed."""

    version: str
    run: int
    index: int
    time: float
    robot: _Robot
    arm: list[_Arm]
    events: list[EventMessage]
    stage_ms: dict[str, float]
    preview: bool
    began: float = 0.0
    first: int = 0
    past: int = -1


class Sample(NamedTuple):
    """One period as numbers; nan where there is none."""

    time: float  # [s]
    speed: float  # forward [m/s]
    yaw_rate: float  # [rad/s]
    dq1: float  # arm joint rates [rad/s]
    dq2: float
    dq3: float
    dq4: float
    dq5: float
    dq6: float
    dq7: float
    distance: float  # [m] gripper to the nearest seen obstacle, least of the period
    linear_slack: float  # [m/s] largest of the period
    angular_slack: float  # [rad/s]
    map: float  # [ms]
    place: float  # [ms]
    plan: float  # [ms]
    arm: float  # [ms]
    monitor: float  # [ms]
    period: float  # [ms]


def sample(part: Part) -> Sample:
    """The numbers of one period."""
    dq = [*part.robot.dq, *[math.nan] * 7][:7]
    distances = [step.obstacle_distance for step in part.arm if step.obstacle_distance is not None]
    slacks = [step.slack for step in part.arm if len(step.slack) == 6 and None not in step.slack]
    ms = part.stage_ms
    return Sample(
        part.time,
        part.robot.twist[0],
        part.robot.twist[1],
        *dq,
        min(distances, default=math.nan),
        max((math.hypot(*slack[:3]) for slack in slacks), default=math.nan),  # type: ignore[arg-type]
        max((math.hypot(*slack[3:]) for slack in slacks), default=math.nan),  # type: ignore[arg-type]
        *(ms.get(stage, math.nan) for stage in STAGES),
        ms.get("period", math.nan),
    )
