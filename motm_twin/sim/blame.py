"""Who caused a contact: the robot, or a person who had just moved the other body or pushed the robot.

A person's motion excuses a contact that it explains: had the body (or the robot) stayed where it was, they would be
apart now. A hand that trembles, or puts a body back where it was, explains nothing.
"""

import math
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from motm_twin.model.geometry import Array, compose, inverse
from motm_twin.model.profile import BaseLimits
from motm_twin.model.scene import PlanarPose

PERSON = 0.5  # [s] after a person moved a body (or the robot) within which a new contact with it can be their doing
REACTION = 0.1  # [s] from a scan to a command that acts: what a robot takes before it brakes
FORGOTTEN = 10.0  # [s] after which a motion matters to nothing; more than any base takes to stop
OWN_MOTION = 0.03  # [m] that a person's motion must part the two by to explain their contact; less when as far as
JITTER = 0.01  # [m] the robot went itself in PERSON, but never less than this: a hand that holds something trembles
TURN_REACH = 0.3  # [m] from its centre: how far a turn moves a body
MERGED = 0.1  # [s] of a drag that make one step
NOT_BY_PUSH = ("base", "floor")  # what the robot does not run into by being pushed


class Shift(NamedTuple):
    """What an edit did to a body: from where to where; None: it was not in the world."""

    before: PlanarPose | None
    after: PlanarPose | None
    kind: tuple[float | str, ...] = ()  # shape and size of what came or went


class Step(NamedTuple):
    """Part of a drag: when it began and ended [s], from where to where."""

    began: float
    time: float
    before: PlanarPose
    after: PlanarPose


class Gone(NamedTuple):
    """A body that a person took out of the world: when [s], where it stood, shape and size."""

    time: float
    pose: PlanarPose
    kind: tuple[float | str, ...]


class Motion(NamedTuple):
    """What persons did lately to a body, or to the robot."""

    came: float = -math.inf  # [s] it came into the world or slid as thrown: no place before
    steps: tuple[Step, ...] = ()
    anchor: PlanarPose | None = None  # where it was when it was last seen to move by more than jitter
    moved: float = -math.inf  # [s] then
    gone: Gone | None = None


UNMOVED = Motion()


def appeared(time: float) -> Motion:
    """Of a body that came to where it is from nowhere near."""
    return Motion(came=time, moved=time)


def shifted(motion: Motion, time: float, shift: Shift) -> Motion:
    """After an edit at a time [s]."""
    before, after = shift.before, shift.after
    if after is None:
        return motion if before is None else motion._replace(gone=Gone(time, before, shift.kind))
    if before is None:
        gone = motion.gone
        if gone is None or time - gone.time > PERSON or gone.kind != shift.kind:
            return appeared(time)
        before = gone.pose  # put back before anybody could have made use of its absence
    steps = tuple(step for step in motion.steps if time - step.time <= FORGOTTEN)
    last = steps[-1] if steps else None
    follows = last is not None and last.after == before
    anchor = motion.anchor if follows and motion.anchor is not None else before
    if follows and last is not None and time - last.began < MERGED:
        steps = (*steps[:-1], last._replace(time=time, after=after))
    else:
        steps = (*steps, Step(time, time, before, after))
    motion = motion._replace(steps=steps, anchor=anchor, gone=None)
    return motion if _way(anchor, after) < JITTER else motion._replace(anchor=after, moved=time)


def _way(a: PlanarPose, b: PlanarPose) -> float:
    turn = abs(math.remainder(a[2] - b[2], 2.0 * math.pi))
    return math.hypot(a[0] - b[0], a[1] - b[1]) + TURN_REACH * turn


def remembered(motions: Mapping[str, Motion], now: float) -> dict[str, Motion]:
    """Those that can still be the cause of anything."""
    return {name: motion for name, motion in motions.items() if now - _last(motion) <= FORGOTTEN}


def _last(motion: Motion) -> float:
    ended = motion.steps[-1].time if motion.steps else -math.inf
    return max(motion.came, ended, -math.inf if motion.gone is None else motion.gone.time)


def in_time(now: float, when: float) -> bool:
    """Whether a contact that begins now may be the doing of a person who moved something at ``when`` [s]."""
    return now - when <= PERSON


def undone(motion: Motion, now: float) -> Iterator[Array]:
    """Planar transforms, world frame, shape (3,), that take a body back to where it stood before it was moved.

    One for each step of its way that is recent enough (`in_time`), the newest first.
    """
    back = np.zeros(3)
    for step in reversed(motion.steps):
        back = compose(compose(np.array(step.before), inverse(np.array(step.after))), back)
        if in_time(now, step.time):
            yield back


def explains(gap: float, closing: float) -> bool:
    """Whether a contact is the doing of a motion without which the gap [m] would be there.

    ``closing`` [m/s]: how fast the robot comes towards the other by itself.
    """
    return gap >= min(OWN_MOTION, max(JITTER, closing * PERSON))


def braking_time(limits: BaseLimits) -> float:
    """Time [s] a base takes to stop from its full speed; so long a contact stays the person's doing while it lasts."""
    straight = max(limits.forward_speed, limits.reverse_speed) / limits.linear_acceleration
    return min(max(straight, limits.yaw_rate / limits.yaw_acceleration) + limits.velocity_lag + REACTION, FORGOTTEN)


def still_persons_doing(motion: Motion, began: float, now: float, braking: float) -> bool:
    """Whether a contact that began [s] as the person's doing still is: not long after the body was really moved."""
    before = max((step.time for step in motion.steps if step.time <= began), default=-math.inf)
    return now - max(motion.moved, motion.came, before) <= braking
