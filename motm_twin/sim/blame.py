"""Who caused a contact: the robot, or a person who had just moved the other body or pushed the robot."""

import math
from collections.abc import Mapping
from typing import NamedTuple

PERSON = 0.5  # [s] after a person moved a body (or the robot) within which a new contact with it is the person's doing
BRAKING = 1.2  # [s] after that motion for which such a contact stays the person's doing while it lasts: the robot stops
REACTION = 0.2  # [s] until a robot that sees a body appear brakes at its limit: a scan, a period, the lag of its base
SPEED_SLACK = 0.02  # [m/s]
FORGOTTEN = 10.0  # [s] no base needs longer to stop
NOT_BY_PUSH = ("base", "floor")  # what the robot does not run into by being pushed


class Disturbance(NamedTuple):
    """When a person moved something [s], and how fast the base drove then [m/s]."""

    time: float
    base_speed: float


NEVER = Disturbance(-math.inf, 0.0)


def latest(moved: Mapping[str, Disturbance], pushed: Disturbance, other: str) -> Disturbance:
    """The last disturbance that concerns a contact of the robot with a body."""
    return max(moved.get(other, NEVER), NEVER if other in NOT_BY_PUSH else pushed)


def recent(moved: Mapping[str, Disturbance], now: float) -> dict[str, Disturbance]:
    """Those that can still be the cause of anything."""
    return {name: cause for name, cause in moved.items() if now - cause.time <= FORGOTTEN}


def persons_doing(cause: Disturbance, now: float, *, base_speed: float | None, deceleration: float) -> bool:
    """Whether a contact that begins now is the person's doing.

    It is within `PERSON` of the disturbance. Later it is for a base (``base_speed`` [m/s], None for other parts of the
    robot) that has braked at its limit ever since: a body that is put nearer than the base can stop cannot be avoided.
    """
    since = now - cause.time
    if since <= PERSON:
        return True
    if base_speed is None or not math.isfinite(since):
        return False
    slowest = abs(cause.base_speed) - deceleration * (since - REACTION)
    return SPEED_SLACK < abs(base_speed) <= slowest + SPEED_SLACK


def still_persons_doing(cause: Disturbance, now: float) -> bool:
    """Whether a contact that was the person's doing still is."""
    return now - cause.time <= BRAKING
