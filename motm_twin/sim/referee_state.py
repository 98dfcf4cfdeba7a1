"""State of the referee: the world that it looks at, contact episodes, and counts of picks, places and drops."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact, CutIn
from motm_twin.model.state import LATER
from motm_twin.sim.agents import AgentState
from motm_twin.sim.cube_contacts import Pose
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.responsibility import NO_TRAIL, UNMOVED, InWay, Motion
from motm_twin.sim.solids import Solids

EPISODE_END = 0.1  # [s] apart after which a contact episode has ended


@dataclass
class Episode:
    """A contact with one thing that goes on."""

    began: float
    last: float
    bodies: tuple[str, ...]  # that touch it, in order
    closing_speed: float
    other_speed: float
    by_person: bool
    was_excused: bool  # it has been a person's doing
    excused_from: float  # [s] when it became that
    gone_on: float = 0.0  # [m] that the robot went on into what was no longer a person's doing
    depth: float = 0.0
    caused: bool = False
    base_towards: bool = field(default=False, metadata=LATER)  # when it began, the base moved towards the other

    def touched(self, body: str, now: float, depth: float) -> None:
        """A body touches the thing now [s], to a depth [m]."""
        if body not in self.bodies:
            self.bodies = (*self.bodies, body)
        self.last = now
        self.depth = max(self.depth, depth)


def contact_of(other: str, episode: Episode) -> Contact:
    """The contact of the robot with something else as far as it has gone: one verdict for the whole episode."""
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
    """Those that have ended, taken out."""
    ended = [other for other, episode in episodes.items() if now - episode.last > EPISODE_END]
    return [contact_of(other, episodes.pop(other)) for other in ended]


LIFTED = 0.02  # [m] above where it was taken: the cube counts as picked
DROP_HEIGHT = 0.01  # [m] of fall that makes a drop


@dataclass
class Counts:
    """Objects picked, placed and dropped so far, and the state needed to count the next ones."""

    right_bins: dict[str, tuple[str, ...]] = field(default_factory=dict)  # where each object belongs
    disturbed: tuple[str, ...] = ()  # objects that lie or fall where they do by a person's doing: no place, no drop
    held: str = ""
    held_from_z: float = 0.0
    picked: bool = False  # the held cube has been counted
    falling_from: dict[str, float] = field(default_factory=dict)
    inside: tuple[str, ...] = ()  # objects counted as placed, until they are picked again
    placed: tuple[str, ...] = ()
    dropped: tuple[str, ...] = ()  # and not picked up and placed since
    picks: int = 0
    drops: int = 0

    def step(self, objects: Sequence[ObjectState], held: str) -> bool:
        """Count what a substep brought; whether another object, or none, is held now."""
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
            if held not in self.right_bins:  # nowhere to be placed: in the hand again is all there is
                self._put_right(held)
        return False

    def _settled(self, item: ObjectState) -> None:
        """An object does not fall, or no longer."""
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
    """The world as the referee sees it after a substep."""

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
    slides: Mapping[str, tuple[float, float]]  # velocity [m/s] in this substep of bodies that a person threw
    riders: tuple[str, ...] = ()  # objects that went along with those
    links: Mapping[str, Array] | None = None  # transforms of the robot's links; None: of a level base at the pose
    solid: bool = False  # bodies press on each other: what falls may touch what lies there
    faults: tuple[tuple[str, str], ...] = ()  # kind and text of what the simulation itself broke in this substep


@dataclass
class PlantCheckState:
    """The substep before."""

    pose: Array
    twist: Array  # forward speed and yaw rate, shape (2,)
    q: Array
    dq: Array
    objects: Array  # positions, shape (n, 3)
    faults: dict[str, str] = field(default_factory=dict)  # kind: first occurrence


@dataclass
class RefereeState:
    """Everything the referee remembers."""

    check: PlantCheckState
    counts: Counts
    gaps: Array = field(default_factory=lambda: np.zeros((0, 0)))  # lower bounds of distances [m]
    self_gaps: Array = field(default_factory=lambda: np.zeros(0))  # the same of the robot's parts from each other
    placed_before: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    agents_before: Array = field(default_factory=lambda: np.zeros((0, 4)))
    cubes_seen: tuple[Pose, ...] = ()  # where the objects were
    cubes_at: Array = field(default_factory=lambda: np.zeros((0, 4)))  # and where they were looked for
    carried: str = ""  # the object whose column is out of use
    episodes: dict[str, Episode] = field(default_factory=dict)  # by what is touched
    contacts: list[Contact] = field(default_factory=list)  # ended
    cut_ins: list[CutIn] = field(default_factory=list)
    in_way: dict[str, InWay] = field(default_factory=dict)  # agents that have the robot in their stopping area
    trail: Array = field(default_factory=lambda: NO_TRAIL)  # where the robot was, as far as it matters
    edits: dict[str, Motion] = field(default_factory=dict)  # body: how persons moved it lately
    pushed: Motion = UNMOVED  # how persons pushed the robot lately
    resting_on: tuple[str, ...] = ()  # what the held cube touched when it was taken, until clear of it
    min_base_clearance: float = math.inf
    min_arm_clearance: float = math.inf
    min_ee_obstacle: float = math.inf
    ee_obstacle: float = math.inf


NOT_JUDGED = RefereeState(check=PlantCheckState(*(np.zeros(0) for _ in range(5))), counts=Counts())
