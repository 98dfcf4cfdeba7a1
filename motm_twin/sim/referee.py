"""Ground truth at every substep: contacts, clearances, picks, places, drops, and whether the plant kept its limits.

It checks the robot against the world and against itself, the held cube, all cubes, and cubes against each
other. Shares no code with perception, planning or control.
"""

import math
from collections.abc import Collection, Mapping, Sequence

import coal
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.compiler import njit
from motm_twin.model.exact import dot
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, RobotProfile
from motm_twin.model.scene import PlanarPose, Scene, Task
from motm_twin.sim.cube_contacts import FINGERS, CubePairs, Shove, array_of, between_pads, poses_of, shoved, stands_on
from motm_twin.sim.kernels import clearance
from motm_twin.sim.objects import ObjectState, right_bins
from motm_twin.sim.referee_geometry import (
    HELD,
    RobotShapes,
    Surroundings,
    cube,
    self_pairs,
    update_gaps,
    update_self_gaps,
)
from motm_twin.sim.responsibility import (
    LOOKS,
    NO_TRAIL,
    TOUCH,
    UNMOVED,
    Gauge,
    Placed,
    Shift,
    StoppingAreas,
    appeared,
    followed,
    remembered,
    shifted,
    stopping_time,
)
from motm_twin.sim.verdict import (
    Counts,
    Encounter,
    PlantCheckState,
    RefereeState,
    Verdicts,
    World,
    contact_of,
    take_ended,
)

SLACK = 1e-6  # by which a limit may be exceeded
OBJECT_JUMP = 0.08  # [m] per axis and substep; only a teleported object moves farther
KINDS = (
    "forward speed",
    "reverse speed",
    "yaw rate",
    "linear acceleration",
    "yaw acceleration",
    "way of the base by its speed",
    "sideways motion of the base",
    "turn of the base by its rate",
    "joint position",
    "joint speed",
    "joint acceleration",
    "way of a joint by its speed",
    "jump of an object",
)


class PlantCheck:
    """Compares consecutive substeps, from positions as well as from reported rates."""

    def __init__(self, profile: RobotProfile, dt: float) -> None:
        """Limits of the profile; substeps of dt [s]."""
        base, self.dt = profile.base, dt
        self._limits = np.array([base.forward_speed, base.reverse_speed, base.yaw_rate, *base.accelerations])

    def start(self, world: World) -> PlantCheckState:
        """State before the first substep."""
        return PlantCheckState(
            world.pose.copy(), world.twist.copy(), world.q.copy(), world.dq.copy(), _positions(world)
        )

    @staticmethod
    def edited(state: PlantCheckState, world: World) -> None:
        """Adopt places of base and objects after an edit between two substeps: the jump is not judged as motion."""
        state.pose, state.objects = world.pose, _positions(world)

    def step(self, state: PlantCheckState, world: World) -> None:
        """Compare with the previous substep, and store this one."""
        objects = _positions(world)
        before = (state.pose, state.twist, state.q, state.dq, state.objects)
        now = (world.pose, world.twist, world.q, world.dq, objects)
        excess, kept = _excess(*before, *now, self._limits, self.dt)
        if not kept:
            for kind, value in zip(KINDS, excess.tolist(), strict=True):
                if not value <= SLACK:
                    state.faults.setdefault(kind, f"{world.time:.2f} s: {kind} exceeded by {value:.3g}")
        state.pose, state.twist, state.q, state.dq, state.objects = now


@njit(cache=True)
def _excess(
    pose0: Array,
    twist0: Array,
    q0: Array,
    dq0: Array,
    objects0: Array,
    pose: Array,
    twist: Array,
    q: Array,
    dq: Array,
    objects: Array,
    limits: Array,
    dt: float,
) -> tuple[Array, bool]:
    """Excess over each of `KINDS`, and True when all limits are kept.

    ``limits``: speeds forward, reverse, yaw; accelerations linear, yaw.
    """
    excess = np.full(13, -np.inf)
    v, w, v0, w0 = twist[0], twist[1], twist0[0], twist0[1]
    excess[0], excess[1], excess[2] = v - limits[0], -v - limits[1], abs(w) - limits[2]
    excess[3], excess[4] = abs(v - v0) / dt - limits[3], abs(w - w0) / dt - limits[4]
    dx, dy, turned = pose[0] - pose0[0], pose[1] - pose0[1], pose[2] - pose0[2]
    turned -= 2.0 * math.pi * round(turned / (2.0 * math.pi))
    middle = pose0[2] + 0.5 * turned
    excess[5] = math.hypot(dx, dy) - max(abs(v), abs(v0)) * dt
    excess[6] = abs(math.cos(middle) * dy - math.sin(middle) * dx)
    excess[7] = abs(turned) - max(abs(w), abs(w0)) * dt
    for i in range(q.shape[0]):
        excess[8] = max(excess[8], q[i] - Q_MAX[i], Q_MIN[i] - q[i])
        excess[9] = max(excess[9], abs(dq[i]) - DQ_MAX[i])
        excess[10] = max(excess[10], abs(dq[i] - dq0[i]) / dt - DDQ_MAX[i])
        excess[11] = max(excess[11], abs(q[i] - q0[i]) - max(abs(dq[i]), abs(dq0[i])) * dt)
    for i in range(objects.shape[0]):
        for k in range(3):
            excess[12] = max(excess[12], abs(objects[i, k] - objects0[i, k]) - OBJECT_JUMP)
    return excess, (excess <= SLACK).all()


def _positions(world: World) -> Array:
    positions = [item.position for item in world.objects]
    return np.array(positions) if positions else np.zeros((0, 3))


SUPPORT_CLEAR = 0.005  # [m] away from its old support, or deep in it, a held cube no longer rests there
NEVER_SELF = ("base", "panda_link0", "panda_link1")  # fixed to the base, or always beside it
_NEVER, _CONTACT, _ARM, _BASE, _HELD = range(5)  # kinds of pairs, by the distance below which they are measured exactly


class Referee:
    """Judges one scene. Clearances: base body and arm (links, hand, fingers) to all but floor, cubes and itself.

    The distance of the gripper centre to unmapped bodies is taken in the plane, as if they were tall, as in the
    paper (Sec. V).
    """

    def __init__(self, scene: Scene, dt: float) -> None:
        """The scene's robot and task list; substeps of dt [s]."""
        self.dt = dt
        self.robot = RobotShapes(scene.robot)
        self.check = PlantCheck(scene.robot, dt)
        self._limits, self._foot, self._has_arm = scene.robot.base, scene.robot.footprint, scene.robot.has_arm
        self._tasks = scene.tasks
        self._surroundings: Surroundings | None = None
        self._bodies: tuple[tuple[str, float, float], ...] | None = None
        self._gauge, self._transform, self._own_transform = Gauge(), coal.Transform3s(), coal.Transform3s()
        self._verdicts, self._areas = Verdicts(self.robot, self._limits, dt), StoppingAreas(self.robot)
        self._cube_pairs = CubePairs()
        bodies = self.robot.bodies
        self._base_shape = bodies.index("base")
        self._base_reach = math.hypot(0.5 * self._foot.length + abs(self._foot.offset_x), 0.5 * self._foot.width)
        self._hand = bodies.index("panda_hand") if self._has_arm else -1
        self._fingers = frozenset(i for i, body in enumerate(bodies) if body in FINGERS)
        self._self_pairs = self_pairs(bodies)
        self._pairs_of_held = self._self_pairs[:, 0] == len(bodies) - 1

    def start(self, world: World) -> RefereeState:
        """State before the first substep; contacts at the start are judged too, as nobody's doing."""
        state = RefereeState(check=self.check.start(world), counts=Counts(right_bins=right_bins(self._tasks)))
        state.placed_before = self._place(world)
        state.agents_before = world.agents.copy()
        state.self_gaps = np.where(self._pairs_of_held, math.inf, -1.0)  # no cube is in the hand
        state.cubes_seen = poses_of(world.objects)
        state.cubes_at = array_of(state.cubes_seen)
        everything = tuple(item.name for item in world.objects)
        shove = Shove(state.cubes_seen, pushed=(), moved=everything)
        self._judge(state, world, state.placed_before, shove, disturbed=everything)
        return state

    def expect(self, state: RefereeState, tasks: Sequence[Task]) -> None:
        """Adopt a new task list, which says where objects belong."""
        state.counts.right_bins = right_bins(tasks)

    def edited(
        self, state: RefereeState, world: World, *, moved: Mapping[str, Shift], disturbed: Collection[str]
    ) -> None:
        """Account for a person's edit between two substeps: distances are measured anew, jumps are no fault.

        Contacts that bodies make because they were ``moved`` are the person's doing for a while; the next motion of
        ``disturbed`` objects is not the robot's doing.
        """
        state.edits = remembered(state.edits, world.time)
        for name, shift in moved.items():
            state.edits[name] = shifted(state.edits.get(name, UNMOVED), world.time, shift)
            state.in_way.pop(name, None)
        state.counts.disturbed = tuple(sorted({*state.counts.disturbed, *disturbed}))
        state.edits.update(dict.fromkeys(disturbed, appeared(world.time)))
        state.gaps = np.zeros((0, 0))
        state.agents_before = world.agents
        state.cubes_seen = poses_of(world.objects)
        state.cubes_at = array_of(state.cubes_seen)
        self.check.edited(state.check, world)

    def pushed(self, state: RefereeState, world: World) -> None:
        """Account for a person's push of the robot between two substeps."""
        self.edited(state, world, moved={}, disturbed=())
        placed = self._place(world)
        before, after = (_planar(bodies[self._base_shape]) for bodies in (state.placed_before, placed))
        state.pushed = shifted(state.pushed, world.time, Shift(before, after))
        state.placed_before, state.trail, state.in_way = placed, NO_TRAIL, {}

    def step(self, state: RefereeState, world: World) -> None:
        """Judge the substep that ended with this world."""
        counts = state.counts
        for name in (*world.slides, *world.riders):
            state.edits[name] = appeared(world.time)
        if not world.solid:  # only kinematics must keep the limits: colliding bodies may exceed them
            self.check.step(state.check, world)
        for kind, text in world.faults:
            state.check.faults.setdefault(kind, text)
        now, disturbed = poses_of(world.objects), (*counts.disturbed, *world.riders)
        shove = shoved(world.objects, now, state.cubes_seen, (*counts.falling_from, counts.held, *world.riders))
        for name in counts.disturbed:
            if name in counts.falling_from:
                state.edits[name] = appeared(world.time)
        if counts.step(world.objects, world.held):
            state.resting_on = (HELD,) if world.held else ()  # replaced by names at the next measurement
        placed = self._place(world)
        if world.agent_states and round(world.time / self.dt) % LOOKS == 0:
            self._watch_agents(state, world, placed)
        self._judge(state, world, placed, shove, disturbed)
        state.placed_before, state.agents_before, state.cubes_seen = placed, world.agents, now

    def contacts(self, state: RefereeState) -> tuple[Contact, ...]:
        """All contacts so far, including ongoing ones, by time."""
        going_on = [contact_of(other, episode) for other, episode in state.episodes.items()]
        return tuple(sorted([*state.contacts, *going_on], key=lambda contact: contact.time))

    def _place(self, world: World) -> Array:
        level = world.links is None
        placed = self.robot.place(world.pose, world.q, world.width) if level else self.robot.place_links(world.links)
        if world.held:
            item = next(item for item in world.objects if item.name == world.held)
            placed[-1, :3, :3], placed[-1, :3, 3] = item.rotation, item.position
        return placed

    def _watch_agents(self, state: RefereeState, world: World, placed: Array) -> None:
        """Update cut-ins, and the trail of the robot."""
        trail = state.trail
        before = self.robot.place(trail[-1, 1:4], trail[-1, 4:11], float(trail[-1, 11])) if len(trail) else None
        state.cut_ins += self._areas.look(state.in_way, world.agent_states, world.time, placed, before)
        stop = stopping_time(self._limits, world.twist, world.dq)
        here = np.array([world.time, *world.pose.tolist(), *world.q.tolist(), world.width, stop])
        state.trail = followed(trail, here)

    def _look_around(self, world: World) -> Surroundings:
        known = self._surroundings
        same = known is not None and known.solids is world.solids and self._bodies is world.agent_bodies
        if known is None or not same or known.floor - known.first_cube != len(world.objects):
            base = (self.robot.shapes[self._base_shape], self._foot.height)
            cubes = [(item.name, item.side) for item in world.objects]
            self._surroundings = Surroundings(world.solids, world.agent_bodies, cubes, base, known)
            self._bodies = world.agent_bodies
            self._kind = self._kinds(self._surroundings)
            return self._surroundings
        return known

    def _kinds(self, around: Surroundings) -> NDArray[np.int64]:
        """Kind of every pair: the limit below which its distance is measured exactly, shape (shapes, columns)."""
        kind = np.full((len(self.robot.bodies), len(around.names)), _ARM, dtype=np.int64)
        kind[:, (around.own_base, around.floor)] = _CONTACT
        kind[self._base_shape] = _BASE
        kind[self._base_shape, around.floor] = _NEVER
        kind[:, around.first_cube : around.floor] = _CONTACT
        kind[[body in NEVER_SELF for body in self.robot.bodies], around.own_base] = _NEVER
        kind[-1] = _HELD
        return kind

    def _judge(
        self, state: RefereeState, world: World, placed: Array, shove: Shove, disturbed: Collection[str]
    ) -> None:
        around = self._look_around(world)
        if state.gaps.shape != self._kind.shape:
            state.gaps = np.full(self._kind.shape, -1.0)
        self._attach_held(state, world, placed, around)
        for name in world.slides:
            state.gaps[:, [other == name for other in around.names]] = -1.0
        cubes = array_of(shove.places) if shove.moved else state.cubes_at
        agents = (world.agents, state.agents_before)
        were = state.cubes_at if len(state.cubes_at) == len(cubes) else cubes
        around.move(world.pose, self._foot, self._base_motion(state, placed), agents, (cubes, were))
        state.cubes_at = cubes
        held_limit = (SUPPORT_CLEAR * 1.01 if state.resting_on else 0.0) if world.held else -math.inf
        limits = np.array([-math.inf, 0.0, state.min_arm_clearance, state.min_base_clearance, held_limit])
        robot = placed, state.placed_before, self.robot.centres, self.robot.radii
        world_now = around.corners, around.first, around.z, around.discs, around.disc_z, around.motion
        pairs = update_gaps(state.gaps, self._kind, limits, *robot, *world_now)
        if len(pairs) or state.resting_on:
            self._measure(state, world, placed, around, pairs)
        if self._has_arm:
            self._measure_itself(state, world, placed)
        if shove.moved:
            now = poses_of(world.objects)
            piled = world.solids.bins if world.solid else ()
            for meeting in self._cube_pairs.meetings(world.objects, now, shove, piled):
                self._verdicts.met(state, world.time, meeting, by_robot=meeting.comes not in disturbed)
        if state.episodes:
            state.contacts += take_ended(state.episodes, world.time)
        if not self._has_arm:
            return
        x, y, _ = world.tcp.tolist()
        state.ee_obstacle = clearance(x, y, around.unmapped_corners, around.unmapped_first, around.unmapped_discs)
        state.min_ee_obstacle = min(state.min_ee_obstacle, state.ee_obstacle)

    def _attach_held(self, state: RefereeState, world: World, placed: Array, around: Surroundings) -> None:
        """Make a newly held object a part of the robot instead of its surroundings, and the reverse on release."""
        if world.held != state.carried:
            state.gaps[:, [name == state.carried for name in around.names]] = -1.0
            state.gaps[-1] = -1.0
            state.self_gaps[self._pairs_of_held] = -1.0 if world.held else math.inf
            state.carried = world.held
            if world.held:
                state.placed_before[-1] = placed[-1]
        if world.held:
            item = next(item for item in world.objects if item.name == world.held)
            state.gaps[:, around.first_cube + world.objects.index(item)] = math.inf
            self.robot.shapes[-1], self.robot.radii[-1] = cube(item.side), 0.5 * item.side * math.sqrt(3.0)

    def _base_motion(self, state: RefereeState, placed: Array) -> float:
        """Upper bound [m] of the motion of any point of the base body in the last substep."""
        old, new = state.placed_before[self._base_shape], placed[self._base_shape]
        (old_c, _, _, old_x), (old_s, _, _, old_y) = old[:2].tolist()
        (c, _, _, x), (s, _, _, y) = new[:2].tolist()
        turned = abs(math.atan2(s * old_c - c * old_s, dot(new[:2, 0], old[:2, 0])))
        return math.hypot(x - old_x, y - old_y) + turned * self._base_reach

    def _measure(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, pairs: NDArray[np.int64]
    ) -> None:
        held = []
        for i, j in pairs.tolist():
            distance = self._distance(placed, around, i, j)
            state.gaps[i, j] = distance
            self._clearance(state, i, j, distance, around)
            if i == len(placed) - 1:
                held.append((j, distance))
            elif distance < -TOUCH:
                self._touch(state, world, placed, around, i, j, distance)
        if held or state.resting_on:
            self._rest(state, world, placed, around, held)

    def _distance(self, placed: Array, around: Surroundings, i: int, j: int) -> float:
        """Exact distance [m] of a pair, negative when they overlap; normal and nearest points are in the result."""
        self._transform.setTransform(placed[i, :3, :3], placed[i, :3, 3])
        around.settle(j, placed[self._base_shape])
        return self._gauge((self.robot.shapes[i], self._transform), (around.shapes[j], around.transforms[j]))

    def _rest(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, held: list[tuple[int, float]]
    ) -> None:
        """Judge contacts of the held cube, except with the support from which it was taken.

        The exception for a support ends when the cube is `SUPPORT_CLEAR` away from it, or as deep in it.
        """
        touching = {around.names[j] for j, distance in held if distance < SUPPORT_CLEAR}
        if state.resting_on == (HELD,):
            state.resting_on = tuple(sorted(touching))
        deep = {around.names[j] for j, distance in held if distance < -SUPPORT_CLEAR}
        state.resting_on = tuple(name for name in state.resting_on if name in touching and name not in deep)
        for j, distance in held:
            if distance < -TOUCH and around.names[j] not in state.resting_on:
                self._touch(state, world, placed, around, len(placed) - 1, j, distance)

    def _clearance(self, state: RefereeState, i: int, j: int, distance: float, around: Surroundings) -> None:
        if j == around.own_base or j >= around.first_cube:
            return
        if i == self._base_shape:
            state.min_base_clearance = min(state.min_base_clearance, max(0.0, distance))
        elif i < len(self.robot.bodies) - 1:
            state.min_arm_clearance = min(state.min_arm_clearance, max(0.0, distance))

    def _touch(
        self, state: RefereeState, world: World, placed: Array, around: Surroundings, i: int, j: int, distance: float
    ) -> None:
        """Judge a part that overlaps something, unless it is a finger that handles the cube between the pads."""
        self._distance(placed, around, i, j)
        normal, other, falls = self._gauge.result.normal, around.names[j], False
        if around.first_cube <= j < around.floor:
            item = world.objects[j - around.first_cube]
            if i in self._fingers and self._handles(world, placed, around.cubes[j - around.first_cube], item, normal):
                return
            falls = item.state == "falling" and other not in state.counts.disturbed
        against, frame = (around.shapes[j], around.transforms[j]), self._base_shape if j == around.own_base else -1
        met = self._encounter(i, other, against, distance, frame, _velocity(world, around, j), falls=falls)
        self._verdicts.touched(state, world, placed, met)

    def _encounter(
        self, i: int, other: str, against: Placed, distance: float, frame: int, velocity: Array, *, falls: bool = False
    ) -> Encounter:
        """The encounter of part i, from the last measurement."""
        result, robot = self._gauge.result, (self.robot.shapes[i], self._transform)
        point = 0.5 * (result.getNearestPoint1() + result.getNearestPoint2())
        return Encounter(i, other, robot, against, distance, result.normal, point, frame, velocity, falls)

    def _handles(self, world: World, placed: Array, cube: Array, item: ObjectState, normal: Array) -> bool:
        """True when a finger that touches a cube is grasping or releasing it."""
        hand = placed[self._hand]
        if not between_pads(hand, world.width, cube):
            return False
        return item.state == "falling" or not stands_on(hand, world.width, cube, item.side, normal)

    def _measure_itself(self, state: RefereeState, world: World, placed: Array) -> None:
        """Measure the arm and the held cube against parts of the arm that are not their neighbours."""
        below = update_self_gaps(
            state.self_gaps, self._self_pairs, placed, state.placed_before, self.robot.centres, self.robot.radii
        )
        for p in below.tolist():
            i, k = self._self_pairs[p].tolist()
            self._transform.setTransform(placed[i, :3, :3], placed[i, :3, 3])
            self._own_transform.setTransform(placed[k, :3, :3], placed[k, :3, 3])
            own = (self.robot.shapes[k], self._own_transform)
            distance = self._gauge((self.robot.shapes[i], self._transform), own)
            state.self_gaps[p] = distance
            if distance < -TOUCH:
                met = self._encounter(i, self.robot.bodies[k], own, distance, k, np.zeros(3))
                self._verdicts.touched(state, world, placed, met)


def _velocity(world: World, around: Surroundings, j: int) -> Array:
    """Velocity [m/s] of the body in column j, shape (3,)."""
    slide = world.slides.get(around.names[j])
    if slide is not None:
        return np.append(slide, 0.0)
    if around.first_agent <= j < around.first_cube:
        agent = world.agent_states[j - around.first_agent]
        return np.array([agent.v * math.cos(agent.pose[2]), agent.v * math.sin(agent.pose[2]), 0.0])
    if around.first_cube <= j < around.floor:
        item = world.objects[j - around.first_cube]
        return item.velocity.copy() if item.state == "falling" else np.zeros(3)
    return np.zeros(3)


def _planar(transform: Array) -> PlanarPose:
    x, y = transform[:2, 3].tolist()
    return x, y, math.atan2(transform[1, 0], transform[0, 0])
