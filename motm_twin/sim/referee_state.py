"""What the referee looks at, and what it remembers."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact, CutIn
from motm_twin.sim.agents import AgentState
from motm_twin.sim.blame import UNMOVED, Motion
from motm_twin.sim.counts import Counts
from motm_twin.sim.cube_contacts import Pose
from motm_twin.sim.cut_in import InWay
from motm_twin.sim.episodes import Episode
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.responsibility import NO_TRAIL
from motm_twin.sim.solids import Solids


@dataclass
class World:
    """What the referee looks at after a substep."""

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
