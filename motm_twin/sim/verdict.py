"""From touches to contact episodes with one verdict each: caused by the robot, a person, an agent or nobody."""

from typing import NamedTuple

import coal

from motm_twin.model.exact import dot, norm, times, transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.profile import BaseLimits
from motm_twin.sim.cube_contacts import Meeting
from motm_twin.sim.referee_geometry import HELD, RobotShapes
from motm_twin.sim.referee_state import Episode, RefereeState, World
from motm_twin.sim.responsibility import (
    MOVES,
    NOT_BY_PUSH,
    UNMOVED,
    Gauge,
    Motion,
    Placed,
    Responsibility,
    Touch,
    braking_time,
    carried_along,
    cuts_in,
    persons_doing,
    still_persons_doing,
)

AGAINST = 0.2  # minus the cosine of the angle between two motions from which one opposes the other
ROLLS_OUT = 0.002  # [m] that a base may roll on, by drive lag, after braking because of a person


class Encounter(NamedTuple):
    """Part i of the robot overlaps something."""

    i: int
    other: str
    robot: Placed
    against: Placed
    distance: float  # [m], negative
    normal: Array  # from the part to the other, shape (3,)
    point: Array  # between the nearest points of the two [m], shape (3,)
    frame: int  # part of the robot that the other is fixed to; -1: none
    other_velocity: Array  # [m/s] of the other at the point, shape (3,)
    falls: bool  # an object that falls because of the robot


class Verdicts:
    """Keeps the episodes of a referee."""

    def __init__(self, robot: RobotShapes, limits: BaseLimits, dt: float) -> None:
        """Shapes of the robot and limits of its base; substeps of dt [s]."""
        self._braking = braking_time(limits)
        self._robot, self._dt = robot, dt
        self._responsibility, self._gauge = Responsibility(dt), Gauge()
        self._unmoved, self._earlier = coal.Transform3s(), coal.Transform3s()
        self._base = robot.bodies.index("base")
        self._hand = robot.bodies.index("panda_hand") if "panda_hand" in robot.bodies else -1

    def touched(self, state: RefereeState, world: World, placed: Array, met: Encounter) -> None:
        """A part of the robot, all of which is ``placed`` (n, 4, 4), overlaps something after a substep."""
        body = self._robot.bodies[met.i]
        body = f"held:{world.held}" if body == HELD else body
        touch = self._touch(state, placed, met)
        closing = dot(touch.velocity, met.normal)
        episode = state.episodes.get(met.other)
        begins = episode is None or body not in episode.bodies
        person = begins and persons_doing(
            self._gauge, _motions(state, met), world.time, robot=met.robot, other=met.against, closing=closing
        )
        if episode is None:
            toward = -dot(met.other_velocity, met.normal)
            episode = Episode(world.time, world.time, (body,), closing, toward, person, person, world.time)
            episode.base_towards = self._base_speed(state, placed, met) > MOVES
            state.episodes[met.other] = episode
        elif person and not episode.by_person:
            episode.by_person, episode.was_excused, episode.excused_from = True, True, world.time
        elif episode.by_person:  # until the robot could have stopped; after that it pushes on into something at rest
            since, now, motions = episode.excused_from, world.time, _motions(state, met)
            episode.by_person = any(still_persons_doing(each, since, now, self._braking) for each in motions)
        episode.touched(body, world.time, -met.distance)
        if not episode.caused and not episode.by_person:
            if self._by_robot(state, world, placed, met, touch, begins=begins):
                episode.gone_on += norm(touch.velocity) * self._dt
                episode.caused = not episode.was_excused or episode.gone_on > ROLLS_OUT

    @staticmethod
    def met(state: RefereeState, now: float, meeting: Meeting, *, by_robot: bool) -> None:
        """One cube overlaps another that it has come to."""
        episode = state.episodes.get(meeting.lies)
        if episode is None:
            episode = Episode(now, now, (meeting.comes,), 0.0, 0.0, False, False, now)
            state.episodes[meeting.lies] = episode
        episode.touched(meeting.comes, now, meeting.depth)
        episode.caused |= by_robot and not episode.by_person

    def _touch(self, state: RefereeState, placed: Array, met: Encounter) -> Touch:
        """The touch, with the part's motion relative to the frame that the other is fixed to."""
        before = state.placed_before[met.i]
        if met.frame >= 0:
            before = carried_along(before, state.placed_before[met.frame], placed[met.frame])
        velocity = _way(met.point, before, placed[met.i]) / self._dt
        self._unmoved.setTransform(before[:3, :3], before[:3, 3])
        return Touch(
            robot=met.robot,
            other=met.against,
            unmoved=self._unmoved,
            distance=met.distance,
            velocity=velocity,
            other_velocity=met.other_velocity,
        )

    def _base_speed(self, state: RefereeState, placed: Array, met: Encounter) -> float:
        """Speed [m/s] at which the motion of the base takes the touching point towards the other."""
        return dot(_way(met.point, state.placed_before[self._base], placed[self._base]), met.normal) / self._dt

    def _by_robot(
        self, state: RefereeState, world: World, placed: Array, met: Encounter, touch: Touch, *, begins: bool
    ) -> bool:
        """The robot caused the contact: now, by its earlier motion, or by an object that it dropped.

        While a body that hit the robot passes through it, only the robot's motion against that body counts.
        """
        if met.falls:
            return True
        first = world.time == state.episodes[met.other].began
        if (first or _against(touch)) and self._responsibility.by_own_motion(touch, begins=begins):
            return True
        if not begins or norm(met.other_velocity) <= MOVES:
            return False
        return cuts_in(state.in_way, met.other, world.time) or self._came_just_now(state, world, placed, met)

    def _came_just_now(self, state: RefereeState, world: World, placed: Array, met: Encounter) -> bool:
        """The other moves, but they would not touch had the robot stopped at its last chance."""
        trail = state.trail
        if not len(trail) or world.time - trail[0, 0] > trail[0, -1] + 1e-9 or trail[0, -1] == 0.0:
            return False
        then = self._robot.place(trail[0, 1:4], trail[0, 4:11], float(trail[0, 11]))
        T = then[met.i]
        if self._robot.bodies[met.i] == HELD:
            T = carried_along(placed[-1], placed[self._hand], then[self._hand])
        self._earlier.setTransform(T[:3, :3], T[:3, 3])
        return not self._responsibility.touches((met.robot[0], self._earlier), met.against)


def _way(point: Array, before: Array, now: Array) -> Array:
    """Way [m] of a point in the last substep that is fixed to a body, whose transforms (4, 4) are given."""
    local = transposed_times(now[:3, :3], point - now[:3, 3])
    return point - (times(before[:3, :3], local) + before[:3, 3])


def _against(touch: Touch) -> bool:
    """The robot drives against a moving body, or the body is at rest."""
    speed, other = norm(touch.velocity), norm(touch.other_velocity)
    return other <= MOVES or dot(touch.velocity, touch.other_velocity) < -AGAINST * speed * other


def _motions(state: RefereeState, met: Encounter) -> tuple[Motion, Motion]:
    """Motions by persons of the body in contact, and of the robot where relevant to this contact."""
    if met.frame >= 0:
        return UNMOVED, UNMOVED
    return state.edits.get(met.other, UNMOVED), UNMOVED if met.other in NOT_BY_PUSH else state.pushed
