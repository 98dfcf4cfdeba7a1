"""Responsibility for a contact: the robot's, or that of a person who moved the other body or pushed the robot.

A person's motion excuses a contact that it explains: had the body (or the robot) stayed in its place, the two would be
apart now. Trembling of a hand, or putting a body back in its place, explains nothing.

The robot's own motion is judged at the touching point, in all directions, with the other body in its present place. The
normal of the shallowest overlap is not used: it points sideways when a body scrapes, and backwards deep inside one.

Cutting in: the robot moves into the area that an agent needs to stop. A contact that follows is the robot's doing. The
agent sweeps it going straight on until it stands: it has the width and height of the agent, and length v t + v^2 / 2a.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import coal
import numpy as np

from motm_twin.model.exact import dot, norm, product, times
from motm_twin.model.geometry import Array, about_z, compose, inverse
from motm_twin.model.plant import CutIn
from motm_twin.model.profile import DDQ_MAX, BaseLimits
from motm_twin.model.scene import AGENT_MOVES, AGENT_REACTION, PlanarPose
from motm_twin.sim.agents import AgentState
from motm_twin.sim.referee_geometry import RobotShapes

PERSON = 0.5  # [s] after a person moved a body or the robot: a new contact within it may be their doing
REACTION = 0.1  # [s] reaction time: from a scan to a command that acts
FORGOTTEN = 10.0  # [s] after which a motion is irrelevant; longer than any base takes to stop
OWN_MOTION = 0.03  # [m] a gap this large without the person's motion explains a contact in any case
JITTER = 0.01  # [m] least such gap, as hands tremble; in between the robot's own approach within `PERSON` counts
TURN_REACH = 0.3  # [m] lever arm by which a turn counts as a displacement
MERGED = 0.1  # [s] parts of a drag within this make one step
NOT_BY_PUSH = ("base", "floor")  # contacts with these are never excused by a push of the robot


class Shift(NamedTuple):
    """Displacement of a body by an edit; None: it was not in the world."""

    before: PlanarPose | None
    after: PlanarPose | None
    kind: tuple[float | str, ...] = ()  # shape and size of a body that appeared or vanished


class Step(NamedTuple):
    """Part of a drag: its start and end [s], and the poses before and after."""

    began: float
    time: float
    before: PlanarPose
    after: PlanarPose


class Gone(NamedTuple):
    """A body that a person took out of the world: time [s], last pose, shape and size."""

    time: float
    pose: PlanarPose
    kind: tuple[float | str, ...]


class Motion(NamedTuple):
    """Recent moves by persons of a body or of the robot."""

    came: float = -math.inf  # [s] when it was added or thrown: it has no earlier place
    steps: tuple[Step, ...] = ()
    anchor: PlanarPose | None = None  # its place when it last moved by more than jitter
    moved: float = -math.inf  # [s] that time
    gone: Gone | None = None


UNMOVED = Motion()


def appeared(time: float) -> Motion:
    """Motion of a body that appeared in the world or came from far away."""
    return Motion(came=time, moved=time)


def shifted(motion: Motion, time: float, shift: Shift) -> Motion:
    """The motion after an edit at a time [s]."""
    before, after = shift.before, shift.after
    if after is None:
        return motion if before is None else motion._replace(gone=Gone(time, before, shift.kind))
    if before is None:
        gone = motion.gone
        if gone is None or time - gone.time > PERSON or gone.kind != shift.kind:
            return appeared(time)
        before = gone.pose  # put back before its absence could matter
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
    """Motions that can still explain a contact."""
    return {name: motion for name, motion in motions.items() if now - _last(motion) <= FORGOTTEN}


def _last(motion: Motion) -> float:
    ended = motion.steps[-1].time if motion.steps else -math.inf
    return max(motion.came, ended, -math.inf if motion.gone is None else motion.gone.time)


def in_time(now: float, when: float) -> bool:
    """True when a contact that begins now may be due to a person who moved something at ``when`` [s]."""
    return now - when <= PERSON


def undone(motion: Motion, now: float) -> Iterator[Array]:
    """Planar transforms, world frame, shape (3,), that take a body back to its places before it was moved.

    One for each recent step of its way (`in_time`), the newest first.
    """
    back = np.zeros(3)
    for step in reversed(motion.steps):
        back = compose(compose(np.array(step.before), inverse(np.array(step.after))), back)
        if in_time(now, step.time):
            yield back


def explains(gap: float, closing: float) -> bool:
    """True when a motion explains a contact, because without it there would be this gap [m].

    ``closing`` [m/s]: speed at which the robot itself approaches the other.
    """
    return gap >= min(OWN_MOTION, max(JITTER, closing * PERSON))


def braking_time(limits: BaseLimits) -> float:
    """Time [s] that a base takes to stop from full speed; an excused contact that lasts stays excused for this long."""
    straight = limits.full_speed / limits.linear_acceleration
    return min(max(straight, limits.yaw_rate / limits.yaw_acceleration) + limits.velocity_lag + REACTION, FORGOTTEN)


def still_persons_doing(motion: Motion, began: float, now: float, braking: float) -> bool:
    """True while a contact that ``began`` [s] as a person's doing remains so, shortly after the body was moved."""
    before = max((step.time for step in motion.steps if step.time <= began), default=-math.inf)
    return now - max(motion.moved, motion.came, before) <= braking


Placed = tuple[coal.CollisionGeometry, coal.Transform3s]


class Gauge:
    """Distance [m] of two shapes, negative where they overlap; normal and nearest points are in ``result`` then."""

    def __init__(self) -> None:
        self._request, self.result = coal.DistanceRequest(), coal.DistanceResult()

    def __call__(self, one: Placed, other: Placed) -> float:
        """Measure."""
        self.result.clear()
        return coal.distance(*one, *other, self._request, self.result)


def persons_doing(
    gauge: Gauge, motions: tuple[Motion, Motion], now: float, *, robot: Placed, other: Placed, closing: float
) -> bool:
    """True when a contact that begins now [s] is due to a person who moved the other body or the robot.

    ``motions``: of the other body, and of the robot; ``closing`` [m/s]: the robot's approach speed.
    """
    of_other, of_robot = motions
    if any(in_time(now, motion.came) for motion in motions):
        return True
    pairs = [(robot, (other[0], _transformed(back, other[1]))) for back in undone(of_other, now)]
    pairs += [((robot[0], _transformed(back, robot[1])), other) for back in undone(of_robot, now)]
    return any(explains(gauge(*pair), closing) for pair in pairs)


def _transformed(planar: Array, transform: coal.Transform3s) -> coal.Transform3s:
    """The transform after a planar motion in the world."""
    turn, shift = about_z(planar[2]), np.array([planar[0], planar[1], 0.0])
    return coal.Transform3s(product(turn, transform.getRotation()), times(turn, transform.getTranslation()) + shift)


TOUCH = 1e-5  # [m] of penetration that counts as contact
MOVES = 1e-3  # [m/s] of the touching point, from which a part of the robot counts as moving
PARTS = 0.2  # share of a motion that must increase the distance for it to count as parting
FURTHEST = 3.0  # [m] limit of the search for a way out of an overlap
STRIDE = 0.005  # [m] least step of that search
NO_TRAIL = np.zeros((0, 13))


@dataclass(frozen=True, kw_only=True)
class Touch:
    """A part of the robot and another body that overlap at the end of a substep."""

    robot: Placed
    other: Placed
    unmoved: coal.Transform3s  # place of the part if the robot had not moved in this substep
    distance: float  # [m] of the two, negative
    velocity: Array  # [m/s] of the touching point by the robot's own motion, shape (3,)
    other_velocity: Array  # [m/s] of the other there, shape (3,)


class Responsibility:
    """Judges touches by the robot's own motion; knows nothing of persons."""

    def __init__(self, dt: float) -> None:
        """Substeps of dt [s]."""
        self.dt = dt
        self._gap = Gauge()
        self._shifted = coal.Transform3s()

    def by_own_motion(self, touch: Touch, *, begins: bool) -> bool:
        """True when the robot's motion in this substep causes a contact, or leads along it or further into it.

        Motion that separates the two does not count, nor does the shortest way out of an existing overlap, nor
        motion that does not gain on another body that follows the robot or drives away.
        """
        speed = norm(touch.velocity)
        apart = self._gap((touch.robot[0], touch.unmoved), touch.other)
        if speed < MOVES:
            return begins and apart > -TOUCH and norm(touch.other_velocity) <= MOVES
        parts = touch.distance - apart >= PARTS * speed * self.dt
        if parts or dot(touch.velocity, touch.velocity - touch.other_velocity) <= 0.0:
            return False
        return begins or not self._leads_out(touch, touch.velocity / speed)

    def touches(self, robot: Placed, other: Placed) -> bool:
        """True when the two overlap."""
        return self._gap(robot, other) < -TOUCH

    def _leads_out(self, touch: Touch, direction: Array) -> bool:
        """True when moving on in this direction ends the overlap sooner than moving back."""
        ahead = behind = 0.0
        while max(ahead, behind) < FURTHEST:
            forward = ahead <= behind
            gap = self._gap_at(touch, direction * (ahead if forward else -behind))
            if gap > -TOUCH:
                return forward
            if forward:
                ahead += max(-gap, STRIDE)
            else:
                behind += max(-gap, STRIDE)
        return False

    def _gap_at(self, touch: Touch, shift: Array) -> float:
        self._shifted.setTransform(touch.robot[1].getRotation(), touch.robot[1].getTranslation() + shift)
        return self._gap((touch.robot[0], self._shifted), touch.other)


def stopping_time(limits: BaseLimits, twist: Array, dq: Array) -> float:
    """Time [s] that the robot needs to stop from base speeds (2,) and joint rates (7,); 0 at rest."""
    v, w = (abs(value) for value in twist.tolist())
    joints = float(np.max(np.abs(dq) / DDQ_MAX))
    if v < MOVES and w < MOVES:
        return max(0.0, joints)
    return max(max(v / limits.linear_acceleration, w / limits.yaw_acceleration) + limits.velocity_lag, joints)


def followed(trail: Array, now: Array) -> Array:
    """The trail with a place added, and without those from which the robot could have stopped before now.

    A place: time [s], pose (3,), joints (7,), width between the pads [m], stopping time [s]; shape (k, 13).
    """
    trail = np.concatenate([trail, now[None]])
    useful = now[0] - trail[:, 0] <= trail[:, -1] + 1e-9
    useful[-1] = True
    return trail[int(np.argmax(useful)) :]


def carried_along(shape: Array, frame: Array, earlier: Array) -> Array:
    """Present transform of a shape that is fixed to a frame with another transform earlier; all (4, 4)."""
    local = product(frame[:3, :3].T, shape[:3, :3])
    offset = times(frame[:3, :3].T, shape[:3, 3] - frame[:3, 3])
    T = np.eye(4)
    T[:3, :3] = product(earlier[:3, :3], local)
    T[:3, 3] = times(earlier[:3, :3], offset) + earlier[:3, 3]
    return T


DEEPER = 0.02  # [m] deeper into an agent's first stopping area, by own motion: then it is a cut-in after all
PARTED = 1.0  # [s] outside the area after which a new entry counts separately
LOOKS = 5  # substeps between two looks
_UPRIGHT = np.eye(3)


class Area(NamedTuple):
    """Position x, y [m] and course [rad] of an agent, and its stopping distance [m]."""

    x: float
    y: float
    course: float
    way: float


class InWay(NamedTuple):
    """The robot in an agent's stopping area."""

    cut_in: bool  # the robot came there by its own motion
    last: float  # [s] last time when it was seen there
    chance: Area  # stopping area of the agent when the robot was first seen in it
    depth: float  # [m] depth of the robot in that area at that time


def stopping_way(speed: float, braking: float) -> float:
    """Stopping distance [m] of an agent from a speed [m/s], with reaction and braking [m/s^2]."""
    return speed * AGENT_REACTION + speed * speed / (2.0 * braking)


def cuts_in(ways: dict[str, InWay], agent: str, now: float) -> bool:
    """True when the robot has cut in on this agent, and is in its way or was just now."""
    way = ways.get(agent)
    return way is not None and way.cut_in and now - way.last <= PARTED


class StoppingAreas:
    """Looks for the robot in the stopping areas of all agents."""

    def __init__(self, robot: RobotShapes) -> None:
        self._robot = robot
        offsets = np.sqrt((robot.centres[:-1] ** 2).sum(axis=1))
        self._reach = offsets + robot.radii[:-1]  # [m] of each part from its frame
        self._gauge = Gauge()
        self._here, self._there = coal.Transform3s(), coal.Transform3s()

    def look(
        self, ways: dict[str, InWay], agents: Sequence[AgentState], now: float, placed: Array, before: Array | None
    ) -> list[CutIn]:
        """Update the agents that have the robot in their way; returns the cut-ins that begin now [s].

        Transforms of the robot's shapes now and at the last look, shape (n, 4, 4); None: its motion since is not its
        own. The robot cuts in when it moves into the area, or into the area as it was when the agent came near.
        """
        found = []
        for agent in agents:
            name, known = agent.agent.name, ways.get(agent.agent.name)
            if known is not None and now - known.last > PARTED:
                del ways[name]
                known = None
            if agent.v < AGENT_MOVES:
                continue
            x, y, course = agent.pose.tolist()
            area = Area(x, y, course, stopping_way(agent.v, agent.agent.acceleration))
            depth = self._depth(agent, area, placed)
            if depth <= 0.0:
                continue
            if known is None:
                own = before is not None and self._depth(agent, area, before) <= 0.0
                known = InWay(own, now, area, depth)
            else:
                own = not known.cut_in and self._depth(agent, known.chance, placed) > known.depth + DEEPER
                known = known._replace(cut_in=known.cut_in or own, last=now)
            if own:
                gap = self._gap(agent, placed)
                found.append(CutIn(time=now, agent=name, gap=gap, stopping_way=area.way, speed=agent.v))
            ways[name] = known
        return found

    def _depth(self, agent: AgentState, area: Area, placed: Array) -> float:
        """Depth [m] of the robot in an area of this agent; 0 outside."""
        radius, height = agent.agent.radius, agent.agent.height
        c, s = math.cos(area.course), math.sin(area.course)
        near = self._near(placed, (area.x, area.y, c, s), area.way + radius, radius)
        if not near:
            return 0.0
        turn = about_z(area.course)
        middle = np.array([area.x + 0.5 * area.way * c, area.y + 0.5 * area.way * s, 0.5 * height])
        end = np.array([area.x + area.way * c, area.y + area.way * s, 0.5 * height])
        strip, cap = coal.Box(area.way, 2.0 * radius, height), coal.Cylinder(radius, height)
        deepest = 0.0
        for i in near:
            self._here.setTransform(placed[i, :3, :3], placed[i, :3, 3])
            for shape, rotation, place in ((strip, turn, middle), (cap, _UPRIGHT, end)):
                self._there.setTransform(rotation, place)
                deepest = max(deepest, -self._distance(i, shape))
        return deepest

    def _near(self, placed: Array, line: tuple[float, float, float, float], way: float, radius: float) -> list[int]:
        """Parts of the robot that may reach an area of length ``way`` and half width ``radius`` [m].

        ``line``: x, y of its start, and cosine and sine of its course.
        """
        x, y, c, s = line
        dx, dy = placed[:-1, 0, 3] - x, placed[:-1, 1, 3] - y
        along, aside = c * dx + s * dy, np.abs(c * dy - s * dx)
        reach = self._reach
        return np.flatnonzero((along > -reach) & (along < way + reach) & (aside < radius + reach)).tolist()

    def _gap(self, agent: AgentState, placed: Array) -> float:
        """Distance [m] between agent and robot, 0 when they touch."""
        x, y, _ = agent.pose.tolist()
        body = coal.Cylinder(agent.agent.radius, agent.agent.height)
        least = math.inf
        self._there.setTransform(_UPRIGHT, np.array([x, y, 0.5 * agent.agent.height]))
        for i in range(len(self._reach)):
            self._here.setTransform(placed[i, :3, :3], placed[i, :3, 3])
            least = min(least, self._distance(i, body))
        return max(0.0, least)

    def _distance(self, i: int, other: coal.CollisionGeometry) -> float:
        return self._gauge((self._robot.shapes[i], self._here), (other, self._there))
