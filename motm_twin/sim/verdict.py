"""Verdicts of the referee and its memory: the world that it judges, contact episodes, picks, places and drops.

Each episode gets one verdict: caused by the robot, a person, an agent or nobody.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import coal
import numpy as np

from motm_twin.model.exact import dot, norm, times, transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact, CutIn
from motm_twin.model.profile import BaseLimits
from motm_twin.model.state import LATER
from motm_twin.sim.agents import AgentState
from motm_twin.sim.cube_contacts import Meeting, Pose
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.referee_geometry import HELD, RobotShapes
from motm_twin.sim.responsibility import (
    MOVES,
    NO_TRAIL,
    NOT_BY_PUSH,
    UNMOVED,
    Gauge,
    InWay,
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
from motm_twin.sim.solids import Solids

EPISODE_END = 0.1  # [s] without contact after which a contact episode has ended


@dataclass
class Episode:
    """An ongoing contact with one body."""

    began: float
    last: float
    bodies: tuple[str, ...]  # bodies that have touched it, in order
    closing_speed: float
    other_speed: float
    by_person: bool
    was_excused: bool  # it has been a person's doing
    excused_from: float  # [s] when it became a person's doing
    gone_on: float = 0.0  # [m] own motion of the robot in this contact since the excuse ended
    depth: float = 0.0
    caused: bool = False
    base_towards: bool = field(default=False, metadata=LATER)  # when it began, the base moved towards the other

    def touched(self, body: str, now: float, depth: float) -> None:
        """Note that a body touches it now [s], to a depth [m]."""
        if body not in self.bodies:
            self.bodies = (*self.bodies, body)
        self.last = now
        self.depth = max(self.depth, depth)


def contact_of(other: str, episode: Episode) -> Contact:
    """The contact with another body so far: one verdict for the whole episode."""
    return Contact(
        time=episode.began,
        body=episode.bodies[0],
        other=other,
        depth=episode.depth,
        closing_speed=episode.closing_speed,
        other_speed=episode.other_speed,
        caused_by_robot=episode.caused,
        duration=episode.last - episode.began,
        bodies=episode.bodies,
        base_moved_towards=episode.base_towards,
    )


def take_ended(episodes: dict[str, Episode], now: float) -> list[Contact]:
    """Contacts of the ended episodes, which are removed."""
    ended = [other for other, episode in episodes.items() if now - episode.last > EPISODE_END]
    return [contact_of(other, episodes.pop(other)) for other in ended]


LIFTED = 0.02  # [m] above its height when grasped: the cube counts as picked
DROP_HEIGHT = 0.01  # [m] a longer fall is a drop


@dataclass
class Counts:
    """Objects picked, placed and dropped so far, and the state needed to count the next ones."""

    right_bins: dict[str, tuple[str, ...]] = field(default_factory=dict)  # where each object belongs
    disturbed: tuple[str, ...] = ()  # objects moved by a person: they count neither as placed nor as dropped
    held: str = ""
    held_from_z: float = 0.0
    picked: bool = False  # the held cube has been counted
    falling_from: dict[str, float] = field(default_factory=dict)
    inside: tuple[str, ...] = ()  # objects counted as placed, until they are picked again
    placed: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()  # not picked up and placed since
    picks: int = 0
    drops: int = 0

    def step(self, objects: Sequence[ObjectState], held: str) -> bool:
        """Count the events of a substep; True when another object, or none, is held now."""
        for item in objects:
            if item.state == "falling":
                self.falling_from.setdefault(item.name, item.bottom)
            else:
                self._settled(item)
        if not held and not self.held:
            return False
        item = next((item for item in objects if item.name == held), None)
        if held != self.held:
            self.held, self.picked = held, False
            self.held_from_z = float(item.position[2]) if item is not None else 0.0
            return True
        if item is not None and not self.picked and item.position[2] > self.held_from_z + LIFTED:
            self.picked = True
            self.picks += 1
            self.inside = tuple(name for name in self.inside if name != held)
            if held not in self.right_bins:  # without a bin, holding it again puts the drop right
                self._put_right(held)
        return False

    def _settled(self, item: ObjectState) -> None:
        """Count an object that does not fall: placed in a bin, or dropped."""
        fell_from = self.falling_from.pop(item.name, None)
        binned = item.state.startswith("binned:")
        if item.name in self.disturbed:
            if not binned:
                self.disturbed = tuple(name for name in self.disturbed if name != item.name)
        elif binned:
            bin_name = item.state.removeprefix("binned:")
            if item.name not in self.inside and bin_name in self.right_bins.get(item.name, ()):
                self.inside, self.placed = (*self.inside, item.name), (*self.placed, item.name)
                self._put_right(item.name)
        elif fell_from is not None and item.state != "held" and fell_from - item.bottom > DROP_HEIGHT:
            self.drops += 1
            self._put_right(item.name)
            self.dropped = (*self.dropped, item.name)
            self.inside = tuple(name for name in self.inside if name != item.name)

    def _put_right(self, item: str) -> None:
        self.dropped = tuple(name for name in self.dropped if name != item)


@dataclass
class World:
    """The world for the referee after a substep."""

    time: float
    pose: Array
    twist: Array
    q: Array
    dq: Array
    width: float
    held: str
    tcp: Array
    objects: list[ObjectState]
    solids: Solids
    agents: Array  # x, y, radius, height, shape (n, 4)
    agent_states: list[AgentState]
    agent_bodies: tuple[tuple[str, float, float], ...]  # name, radius, height; the same object while nothing changes
    slides: Mapping[str, tuple[float, float]]  # velocity [m/s] in this substep of thrown bodies
    riders: tuple[str, ...] = ()  # objects carried along by thrown bodies
    links: Mapping[str, Array] | None = None  # transforms of the robot's links; None: as of a level base at the pose
    solid: bool = False  # bodies press on each other: a falling one may touch a resting one
    faults: tuple[tuple[str, str], ...] = ()  # kind and text of limits that the simulation itself broke


@dataclass
class PlantCheckState:
    """Motion in the previous substep."""

    pose: Array
    twist: Array  # forward speed and yaw rate, shape (2,)
    q: Array
    dq: Array
    objects: Array  # positions, shape (n, 3)
    faults: dict[str, str] = field(default_factory=dict)  # kind: first occurrence


@dataclass
class RefereeState:
    """Memory of the referee."""

    check: PlantCheckState
    counts: Counts
    gaps: Array = field(default_factory=lambda: np.zeros((0, 0)))  # lower bounds of distances [m]
    self_gaps: Array = field(default_factory=lambda: np.zeros(0))  # the same between parts of the robot
    placed_before: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    agents_before: Array = field(default_factory=lambda: np.zeros((0, 4)))
    cubes_seen: tuple[Pose, ...] = ()  # last places of the objects
    cubes_at: Array = field(default_factory=lambda: np.zeros((0, 4)))  # last places at which overlaps were tested
    carried: str = ""  # held object, whose column is unused
    episodes: dict[str, Episode] = field(default_factory=dict)  # by the touched body
    contacts: list[Contact] = field(default_factory=list)  # ended ones
    cut_ins: list[CutIn] = field(default_factory=list)
    in_way: dict[str, InWay] = field(default_factory=dict)  # agents that have the robot in their stopping area
    trail: Array = field(default_factory=lambda: NO_TRAIL)  # recent places of the robot, see `followed`
    edits: dict[str, Motion] = field(default_factory=dict)  # body: its recent moves by persons
    pushed: Motion = UNMOVED  # recent pushes of the robot by persons
    resting_on: tuple[str, ...] = ()  # bodies that touched the held cube when it was grasped, until it is clear of them
    min_base_clearance: float = math.inf
    min_arm_clearance: float = math.inf
    min_ee_obstacle: float = math.inf
    ee_obstacle: float = math.inf


NOT_JUDGED = RefereeState(check=PlantCheckState(*(np.zeros(0) for _ in range(5))), counts=Counts())


AGAINST = 0.2  # two motions are opposed when the cosine of their angle is below minus this
ROLLS_OUT = 0.002  # [m] that a base may roll on, by drive lag, while it brakes for a person


class Encounter(NamedTuple):
    """An overlap of part i of the robot with another body."""

    i: int
    other: str
    robot: Placed
    against: Placed
    distance: float  # [m], negative
    normal: Array  # from the part to the other, shape (3,)
    point: Array  # midpoint of the nearest points of the two [m], shape (3,)
    frame: int  # part of the robot to which the other is fixed; -1: none
    other_velocity: Array  # [m/s] of the other at the point, shape (3,)
    falls: bool  # the other is an object that falls because of the robot


class Verdicts:
    """Judges contacts, and keeps the contact episodes of a referee."""

    def __init__(self, robot: RobotShapes, limits: BaseLimits, dt: float) -> None:
        """Shapes of the robot and limits of its base; substeps of dt [s]."""
        self._braking = braking_time(limits)
        self._robot, self._dt = robot, dt
        self._responsibility, self._gauge = Responsibility(dt), Gauge()
        self._unmoved, self._earlier = coal.Transform3s(), coal.Transform3s()
        self._base = robot.bodies.index("base")
        self._hand = robot.bodies.index("panda_hand") if "panda_hand" in robot.bodies else -1

    def touched(self, state: RefereeState, world: World, placed: Array, met: Encounter) -> None:
        """Judge an overlap of the robot after a substep; ``placed``: transforms of all its parts (n, 4, 4)."""
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
        elif episode.by_person:  # until the robot could have stopped; a longer contact is its own
            since, now, motions = episode.excused_from, world.time, _motions(state, met)
            episode.by_person = any(still_persons_doing(each, since, now, self._braking) for each in motions)
        episode.touched(body, world.time, -met.distance)
        if not episode.caused and not episode.by_person:
            if self._by_robot(state, world, placed, met, touch, begins=begins):
                episode.gone_on += norm(touch.velocity) * self._dt
                episode.caused = not episode.was_excused or episode.gone_on > ROLLS_OUT

    @staticmethod
    def met(state: RefereeState, now: float, meeting: Meeting, *, by_robot: bool) -> None:
        """Judge an overlap of a moved cube with another one."""
        episode = state.episodes.get(meeting.lies)
        if episode is None:
            episode = Episode(now, now, (meeting.comes,), 0.0, 0.0, False, False, now)
            state.episodes[meeting.lies] = episode
        episode.touched(meeting.comes, now, meeting.depth)
        episode.caused |= by_robot and not episode.by_person

    def _touch(self, state: RefereeState, placed: Array, met: Encounter) -> Touch:
        """The touch, with the part's motion relative to the frame to which the other is fixed."""
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
        """True when the robot caused the contact: now, by its earlier motion, or by an object that it dropped.

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
        """True when the two would not touch if the robot had stopped at its last chance; the other moves."""
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
    """Displacement [m] in the last substep of a point fixed to a body with these transforms (4, 4)."""
    local = transposed_times(now[:3, :3], point - now[:3, 3])
    return point - (times(before[:3, :3], local) + before[:3, 3])


def _against(touch: Touch) -> bool:
    """True when the robot moves against a moving body, or the body is at rest."""
    speed, other = norm(touch.velocity), norm(touch.other_velocity)
    return other <= MOVES or dot(touch.velocity, touch.other_velocity) < -AGAINST * speed * other


def _motions(state: RefereeState, met: Encounter) -> tuple[Motion, Motion]:
    """Motions by persons of the body in contact, and of the robot where relevant to this contact."""
    if met.frame >= 0:
        return UNMOVED, UNMOVED
    return state.edits.get(met.other, UNMOVED), UNMOVED if met.other in NOT_BY_PUSH else state.pushed
