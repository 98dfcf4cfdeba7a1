"""Ground truth at every substep: contacts, clearances, picks, places, drops, and whether the plant kept its limits.

Shares no code with perception, planning or control.
"""

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field

import coal
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import dot, times, transposed_times
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact
from motm_twin.model.scene import PlanarPose, Scene, Task
from motm_twin.sim.agents import AgentState
from motm_twin.sim.blame import (
    NOT_BY_PUSH,
    UNMOVED,
    Motion,
    Shift,
    appeared,
    remembered,
    shifted,
    still_persons_doing,
)
from motm_twin.sim.episodes import Episode, contact_of
from motm_twin.sim.kernels import clearance
from motm_twin.sim.objects import ObjectState, right_bins
from motm_twin.sim.plant_check import PlantCheck, PlantCheckState
from motm_twin.sim.referee_geometry import HELD, RobotShapes, Surroundings, update_gaps
from motm_twin.sim.solids import Solids
from motm_twin.sim.without import Without

TOUCH = 1e-5  # [m] of penetration that counts as contact
ROBOT_MOVES = 0.02  # [m/s] towards the other, from which the robot caused a contact
EPISODE_END = 0.1  # [s] apart after which a contact episode has ended
LIFTED = 0.02  # [m] above where it was taken: the cube counts as picked
SUPPORT_CLEAR = 0.005  # [m] after which a held cube no longer rests on what it was taken from
DROP_HEIGHT = 0.01  # [m] of fall that makes a drop
NEVER_SELF = ("base", "panda_link0", "panda_link1")  # fixed to the own base, or always beside it
_NEVER, _CONTACT, _ARM, _BASE, _HELD = range(5)  # kinds of pairs: which distance makes an exact measurement worth it


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


@dataclass
class RefereeState:
    """Everything the referee remembers."""

    check: PlantCheckState
    gaps: Array = field(default_factory=lambda: np.zeros((0, 0)))  # lower bounds of distances [m]
    placed_before: Array = field(default_factory=lambda: np.zeros((0, 4, 4)))
    agents_before: Array = field(default_factory=lambda: np.zeros((0, 4)))
    episodes: dict[tuple[str, str], Episode] = field(default_factory=dict)
    contacts: list[Contact] = field(default_factory=list)  # ended
    edits: dict[str, Motion] = field(default_factory=dict)  # body: how persons moved it lately
    pushed: Motion = UNMOVED  # how persons pushed the robot lately
    disturbed: tuple[str, ...] = ()  # objects that lie or fall where they do by a person's doing: no place, no drop
    held: str = ""
    held_from_z: float = 0.0
    resting_on: tuple[str, ...] = ()  # what the held cube touched when it was taken, until clear of it
    picked: bool = False  # the held cube has been counted
    falling_from: dict[str, float] = field(default_factory=dict)
    right_bins: dict[str, tuple[str, ...]] = field(default_factory=dict)  # where each object belongs
    inside: tuple[str, ...] = ()  # objects counted as placed, until they are picked again
    placed: tuple[str, ...] = ()
    picks: int = 0
    drops: int = 0
    min_base_clearance: float = math.inf
    min_arm_clearance: float = math.inf
    min_ee_obstacle: float = math.inf
    ee_obstacle: float = math.inf


class Referee:
    """Watches one scene. Clearances: base body and arm (links, hand, fingers) to everything but floor and itself.

    The distance of the gripper centre to what is not in the map is taken in the plane, the other as tall, as in the
    paper (Sec. V).
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        """The scene's robot and task list; substeps of dt [s]."""
        self.dt = dt
        self.robot = RobotShapes(scene.robot)
        self.check = PlantCheck(scene.robot, dt)
        self._foot, self._has_arm = scene.robot.footprint, scene.robot.has_arm
        self._tasks = scene.tasks
        self._surroundings: Surroundings | None = None
        self._bodies: tuple[tuple[str, float, float], ...] | None = None
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()
        self._transform = coal.Transform3s()
        self._without = Without()
        self._base_shape = self.robot.bodies.index("base")
        self._base_reach = math.hypot(0.5 * self._foot.length + abs(self._foot.offset_x), 0.5 * self._foot.width)

    def start(self, world: World) -> RefereeState:
        """State before the first substep; the start itself is judged too."""
        state = RefereeState(check=self.check.start(world), right_bins=right_bins(self._tasks))
        state.placed_before = self._place(world)
        state.agents_before = world.agents.copy()
        self._judge(state, world, state.placed_before)
        return state

    def expect(self, state: RefereeState, tasks: Sequence[Task]) -> None:
        """The task list is another one now: objects belong where it says."""
        state.right_bins = right_bins(tasks)

    def edited(
        self, state: RefereeState, world: World, *, moved: Mapping[str, Shift], disturbed: Collection[str]
    ) -> None:
        """A person changed the world between two substeps: distances are measured anew, jumps are no fault.

        Contacts that bodies make because they were ``moved`` are the person's for a while; what ``disturbed`` objects
        do next is not the robot's doing.
        """
        state.edits = remembered(state.edits, world.time)
        for name, shift in moved.items():
            known = state.edits.get(name, UNMOVED)
            state.edits[name] = shifted(known, world.time, shift)
        state.disturbed = tuple(sorted({*state.disturbed, *disturbed}))
        state.gaps = np.zeros((0, 0))
        state.agents_before = world.agents
        self.check.edited(state.check, world)

    def pushed(self, state: RefereeState, world: World) -> None:
        """A person pushed the robot, between two substeps."""
        self.edited(state, world, moved={}, disturbed=())
        placed = self._place(world)
        before, after = (_planar(bodies[self._base_shape]) for bodies in (state.placed_before, placed))
        state.pushed = shifted(state.pushed, world.time, Shift(before, after))
        state.placed_before = placed

    def step(self, state: RefereeState, world: World) -> None:
        """Judge the substep that ended with this world."""
        for name in world.slides:
            state.edits[name] = appeared(world.time)
        self.check.step(state.check, world)
        self._objects(state, world)
        placed = self._place(world)
        self._judge(state, world, placed)
        state.placed_before, state.agents_before = placed, world.agents

    def contacts(self, state: RefereeState) -> tuple[Contact, ...]:
        """All contacts so far, those that go on included, by time."""
        going_on = [contact_of(pair, episode) for pair, episode in state.episodes.items()]
        return tuple(sorted([*state.contacts, *going_on], key=lambda contact: contact.time))

    def _place(self, world: World) -> Array:
        placed = self.robot.place(world.pose, world.q, world.width)
        if world.held:
            item = next(item for item in world.objects if item.name == world.held)
            placed[-1, :3, :3], placed[-1, :3, 3] = item.rotation, item.position
        return placed

    def _objects(self, state: RefereeState, world: World) -> None:
        for item in world.objects:
            if item.state == "falling":
                state.falling_from.setdefault(item.name, item.bottom)
                continue
            fell_from = state.falling_from.pop(item.name, None)
            binned = item.state.startswith("binned:")
            if item.name in state.disturbed:
                if not binned:
                    state.disturbed = tuple(name for name in state.disturbed if name != item.name)
            elif binned:
                bin_name = item.state.removeprefix("binned:")
                if item.name not in state.inside and bin_name in state.right_bins.get(item.name, ()):
                    state.inside, state.placed = (*state.inside, item.name), (*state.placed, item.name)
            elif fell_from is not None and item.state != "held" and fell_from - item.bottom > DROP_HEIGHT:
                state.drops += 1
        if not world.held and not state.held:
            return
        held = next((item for item in world.objects if item.name == world.held), None)
        if world.held != state.held:
            state.held, state.picked, state.resting_on = world.held, False, ()
            state.held_from_z = float(held.position[2]) if held is not None else 0.0
            if held is not None:
                state.gaps[-1:] = -1.0
                state.resting_on = (HELD,)  # to be replaced by names at the first look
        elif held is not None and not state.picked and held.position[2] > state.held_from_z + LIFTED:
            state.picked = True
            state.picks += 1
            state.inside = tuple(name for name in state.inside if name != world.held)

    def _look_around(self, world: World) -> Surroundings:
        known = self._surroundings
        if known is None or known.solids is not world.solids or self._bodies is not world.agent_bodies:
            base = (self.robot.shapes[self._base_shape], self._foot.height)
            self._surroundings = Surroundings(world.solids, world.agent_bodies, base, known)
            self._bodies = world.agent_bodies
            self._kind = self._kinds(self._surroundings)
            return self._surroundings
        return known

    def _kinds(self, around: Surroundings) -> NDArray[np.int64]:
        """For each pair which limit tells that it must be measured exactly, shape (shapes, columns)."""
        kind = np.full((len(self.robot.bodies), len(around.names)), _ARM, dtype=np.int64)
        kind[:, (around.own_base, around.floor)] = _CONTACT
        kind[self._base_shape] = _BASE
        kind[self._base_shape, around.floor] = _NEVER
        kind[[body in NEVER_SELF for body in self.robot.bodies], around.own_base] = _NEVER
        kind[-1] = _HELD
        return kind

    def _judge(self, state: RefereeState, world: World, placed: Array) -> None:
        around = self._look_around(world)
        if state.gaps.shape != self._kind.shape:
            state.gaps = np.full(self._kind.shape, -1.0)
        if world.held:
            side = next(item.side for item in world.objects if item.name == world.held)
            self.robot.shapes[-1], self.robot.radii[-1] = self.robot.cube(side), 0.5 * side * math.sqrt(3.0)
            if state.resting_on == (HELD,):
                state.placed_before[-1] = placed[-1]
        for name in world.slides:
            state.gaps[:, [other == name for other in around.names]] = -1.0
        around.move(world.pose, self._foot, self._base_motion(state, placed), world.agents, state.agents_before)
        held_limit = (SUPPORT_CLEAR * 1.01 if state.resting_on else 0.0) if world.held else -math.inf
        pairs = update_gaps(
            state.gaps,
            self._kind,
            np.array([-math.inf, 0.0, state.min_arm_clearance, state.min_base_clearance, held_limit]),
            placed,
            state.placed_before,
            self.robot.centres,
            self.robot.radii,
            around.corners,
            around.first,
            around.z,
            around.discs,
            around.disc_z,
            around.motion,
        )
        if len(pairs) or state.resting_on:
            self._measure(state, world, placed, around, pairs)
        if state.episodes:
            self._end_episodes(state, world.time)
        if not self._has_arm:
            return
        x, y, _ = world.tcp.tolist()
        state.ee_obstacle = clearance(x, y, around.unmapped_corners, around.unmapped_first, around.unmapped_discs)
        state.min_ee_obstacle = min(state.min_ee_obstacle, state.ee_obstacle)

    def _base_motion(self, state: RefereeState, placed: Array) -> float:
        """Distance [m] that no point of the base body has moved beyond in the last substep."""
        old, new = state.placed_before[self._base_shape], placed[self._base_shape]
        (old_c, _, _, old_x), (old_s, _, _, old_y) = old[:2].tolist()
        (c, _, _, x), (s, _, _, y) = new[:2].tolist()
        turned = abs(math.atan2(s * old_c - c * old_s, dot(new[:2, 0], old[:2, 0])))
        return math.hypot(x - old_x, y - old_y) + turned * self._base_reach

    def _measure(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, pairs: NDArray[np.int64]
    ) -> None:
        touching: list[str] = []
        for i, j in pairs.tolist():
            distance = self._distance(placed, around, i, j)
            state.gaps[i, j] = distance
            self._clearance(state, i, j, distance, around)
            if i == len(placed) - 1 and distance < SUPPORT_CLEAR:
                touching.append(around.names[j])
            elif distance < -TOUCH:
                self._touch(state, world, placed, around, i, j, distance)
        self._rest(state, world, placed, around, touching)

    def _distance(self, placed: Array, around: Surroundings, i: int, j: int) -> float:
        """Exact distance [m] of a pair, negative when they overlap; normal and nearest points are in the result."""
        self._transform.setTransform(placed[i, :3, :3], placed[i, :3, 3])
        around.settle(j, placed[self._base_shape])
        self._result.clear()
        return coal.distance(
            self.robot.shapes[i], self._transform, around.shapes[j], around.transforms[j], self._request, self._result
        )

    def _rest(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, touching: list[str]
    ) -> None:
        """What the held cube touches: no contact as long as it is what the cube was taken from."""
        if state.resting_on == (HELD,):
            state.resting_on = tuple(sorted(set(touching)))
        else:
            state.resting_on = tuple(name for name in state.resting_on if name in touching)
        last = len(placed) - 1
        for j in np.flatnonzero(state.gaps[last] < -TOUCH) if touching else ():
            if around.names[j] in touching and around.names[j] not in state.resting_on:
                self._touch(state, world, placed, around, last, int(j), float(state.gaps[last, j]))

    def _clearance(self, state: RefereeState, i: int, j: int, distance: float, around: Surroundings) -> None:
        if j in (around.own_base, around.floor):
            return
        if i == self._base_shape:
            state.min_base_clearance = min(state.min_base_clearance, max(0.0, distance))
        elif i < len(self.robot.bodies) - 1:
            state.min_arm_clearance = min(state.min_arm_clearance, max(0.0, distance))

    def _touch(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, i: int, j: int, distance: float
    ) -> None:
        self._distance(placed, around, i, j)
        normal = self._result.normal
        point = 0.5 * (self._result.getNearestPoint1() + self._result.getNearestPoint2())
        closing = dot(self._velocity(state, placed, i, point), normal)
        other_speed = -dot(self._other_velocity(state, world, placed, around, j, point), normal)
        body = f"held:{world.held}" if self.robot.bodies[i] == HELD else self.robot.bodies[i]
        pair = (body, around.names[j])
        episode = state.episodes.get(pair)
        if episode is None:
            by_person = self._by_person(state, world, around, i, j, closing)
            episode = Episode(world.time, world.time, 0.0, closing, other_speed, False, by_person)
            state.episodes[pair] = episode
        elif episode.by_person:  # for as long as the robot needs to stop; then it goes on into what stands still
            motions = _motions(state, pair[1])
            episode.by_person = any(still_persons_doing(motion, episode.began, world.time) for motion in motions)
        episode.last = world.time
        episode.depth = max(episode.depth, -distance)
        episode.robot_moved |= closing > ROBOT_MOVES and not episode.by_person

    def _by_person(
        self, state: RefereeState, world: World, around: Surroundings, i: int, j: int, closing: float
    ) -> bool:
        """Whether a contact that begins now is a person's doing, or part of one that is and lasts."""
        other = around.names[j]
        if any(name == other and episode.by_person for (_, name), episode in state.episodes.items()):
            return True
        return self._without.persons_doing(
            _motions(state, other),
            world.time,
            robot=(self.robot.shapes[i], self._transform),
            other=(around.shapes[j], around.transforms[j]),
            closing=closing,
        )

    def _velocity(self, state: RefereeState, placed: Array, i: int, point: Array) -> Array:
        """Velocity [m/s] of a point fixed to shape i, over the last substep, shape (3,)."""
        now, before = placed[i], state.placed_before[i]
        local = transposed_times(now[:3, :3], point - now[:3, 3])
        return (point - (times(before[:3, :3], local) + before[:3, 3])) / self.dt

    def _other_velocity(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, j: int, point: Array
    ) -> Array:
        if j == around.own_base:
            return self._velocity(state, placed, self._base_shape, point)
        slide = world.slides.get(around.names[j])
        if slide is not None:
            return np.append(slide, 0.0)
        if around.first_agent <= j < around.floor:
            agent = world.agent_states[j - around.first_agent]
            return np.array([agent.v * math.cos(agent.pose[2]), agent.v * math.sin(agent.pose[2]), 0.0])
        return np.zeros(3)

    def _end_episodes(self, state: RefereeState, now: float) -> None:
        for pair in [pair for pair, episode in state.episodes.items() if now - episode.last > EPISODE_END]:
            state.contacts.append(contact_of(pair, state.episodes.pop(pair)))


def _motions(state: RefereeState, other: str) -> tuple[Motion, Motion]:
    """What persons did to a body, and to the robot as far as it concerns a contact with that body."""
    return state.edits.get(other, UNMOVED), UNMOVED if other in NOT_BY_PUSH else state.pushed


def _planar(transform: Array) -> PlanarPose:
    x, y = transform[:2, 3].tolist()
    return x, y, math.atan2(transform[1, 0], transform[0, 0])
