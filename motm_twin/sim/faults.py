"""Faults of a scene: temporary ones of sensors, wheels and joints (`model.faults`), failed grasps, and moved cubes.

A temporary fault, requested by a person, a scene or a test, changes only reports, or how commands are followed: the
drawn noise is the same as without it. Grasps fail or take longer, and cubes are moved as the robot comes near, as in
`model.scene.Faults`. The robot sees the same as a real one: fingers that still move or end up closed, a
cube that lies where it was pushed or dropped, a cube that is elsewhere.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgspec
import numpy as np

from motm_twin.model.edits import InjectFault, MoveObject
from motm_twin.model.faults import KINDS, FaultFields
from motm_twin.model.geometry import Array, to_frame
from motm_twin.model.plant import Detection, Observation, Scan
from motm_twin.model.scene import Faults, Pick, Scene, TimedFault
from motm_twin.sim.gripper import Gripper, GripperState
from motm_twin.sim.objects import ObjectState, ObjectWorld, put_down
from motm_twin.sim.sensors import Frame, LidarState, LocalisationState
from motm_twin.sim.solids import Solids

_RNG_FAULT, _RNG_NOISE = 0xFA1C0DE, 0xFA1C0015E
_PLAIN_NOISE = 0.01  # [m] base value for a noise-free lidar
_GHOST_SD = 0.005  # [m] reported sd of a ghost (false detection)
_OF_CAMERA = frozenset(("camera_swap", "camera_lost", "camera_ghost"))
_MOTION = ("pose", "odometry", "twist", "q", "dq", "gripper_width", "gripper_moving")
Reported = tuple[int, Array, Array, Array, Array, Array, float, bool]  # substep, and `_MOTION` reported for it


@dataclass
class ActiveFault:
    """An active fault."""

    began: int  # substep
    until: int  # substep at which it is over
    value: float  # its number
    joint: int
    angle: float  # [rad] direction, for kinds with one; drawn from seed and substep


@dataclass
class FaultState:
    """Active faults, and the reports they hold back."""

    on: dict[str, ActiveFault] = field(default_factory=dict)
    reports: list[Reported] = field(default_factory=list)  # delayed reports, oldest first
    reported: Reported | None = None  # the robot's report of its motion while reports are late

    def active(self, fault: str) -> bool:
        """True when this fault is active."""
        return fault in self.on


def inject(state: FaultState, edit: InjectFault, now: int, substep: float, seed: int) -> None:
    """Begin a fault at substep ``now``; it replaces an active fault of the same kind."""
    value = KINDS[edit.fault].value(delay=edit.delay, amount=edit.amount, joint=edit.joint)
    angle = float(np.random.default_rng([seed, _RNG_FAULT, now]).uniform(-math.pi, math.pi))
    until = now + max(1, round(edit.seconds / substep))
    state.on[edit.fault] = ActiveFault(began=now, until=until, value=value, joint=edit.joint, angle=angle)


def expire(state: FaultState, now: int) -> None:
    """Forget the faults that are over at substep ``now``."""
    for fault in [fault for fault, one in state.on.items() if one.until <= now]:
        del state.on[fault]
    if "state_delay" not in state.on:
        state.reports, state.reported = [], None


def phrases(state: FaultState, now: int, substep: float) -> tuple[str, ...]:
    """One phrase for each fault: its kind and its remaining time."""
    return tuple(
        f"{KINDS[fault].phrase.format(one.value)} for {(one.until - now) * substep:.1f} s"
        for fault, one in sorted(state.on.items())
    )


class FaultEffects:
    """Applies the faults of a state to one plant; has no state itself."""

    def __init__(self, scene: Scene, substep: float) -> None:
        """Seed and noise of the scene; substep [s]."""
        self._seed, self._substep = scene.seed, substep
        self._range_sd = scene.noise.lidar_range_sd or _PLAIN_NOISE
        self._timed = [(round(one.at / substep), _edit_of(one)) for one in scene.faults.inject or ()]

    def inject_due(self, state: FaultState, now: int) -> None:
        """Inject the scene's faults due at substep ``now``."""
        for at, edit in self._timed:
            if at == now:
                inject(state, edit, now, self._substep, self._seed)

    def localised(self, state: FaultState, localisation: LocalisationState, now: int) -> Array:
        """The localised pose that is reported, shape (3,)."""
        return _shifted(localisation.pose, self._shift(state, ("pose_jump", "pose_drift"), now))

    def odometry(self, state: FaultState, localisation: LocalisationState, now: int) -> Array:
        """The odometry pose that is reported, shape (3,)."""
        return _shifted(localisation.odometry, self._shift(state, ("odometry_jump",), now))

    def _shift(self, state: FaultState, kinds: tuple[str, ...], now: int) -> tuple[float, float]:
        x = y = 0.0
        for kind in kinds:
            one = state.on.get(kind)
            if one is not None:
                passed = (now - one.began) * self._substep if kind == "pose_drift" else 1.0
                x += one.value * passed * math.cos(one.angle)
                y += one.value * passed * math.sin(one.angle)
        return x, y

    def sweep(self, state: FaultState, lidar: LidarState, previous: Scan | None, now: int) -> None:
        """Apply faults to the newest sweep: it may be altered or delayed."""
        scan = lidar.scan
        assert scan is not None
        ranges = scan.ranges
        if state.active("lidar_frozen") and previous is not None:
            ranges = previous.ranges
        noise, bad = state.on.get("lidar_noise"), state.on.get("lidar_nan")
        if noise is not None:
            more = self._range_sd * math.sqrt(max(noise.value**2 - 1.0, 0.0))
            drawn = np.random.default_rng([self._seed, _RNG_NOISE, now]).standard_normal(len(ranges))
            ranges = np.maximum(ranges + more * drawn, scan.range_min)
            ranges[ranges > scan.range_max] = np.inf
        if state.active("lidar_blind"):
            ranges = np.full(len(ranges), np.inf)
        sector = state.on.get("lidar_sector")
        if sector is not None:
            bearings = np.remainder(scan.angle_min + scan.angle_step * np.arange(len(ranges)) + math.pi, 2 * math.pi)
            ranges = np.where(np.abs(bearings - math.pi) <= 0.5 * math.radians(sector.value), np.inf, ranges)
        if bad is not None:
            count = max(1, round(bad.value * len(ranges)))
            order = np.random.default_rng([self._seed, _RNG_FAULT, bad.began]).permutation(len(ranges))
            ranges = ranges.copy()
            ranges[order[:count]] = np.nan
        if ranges is not scan.ranges:
            lidar.scan = scan = msgspec.structs.replace(scan, ranges=ranges)
        late = state.on.get("lidar_delay")
        if late is not None:
            arrival = now + round(late.value / self._substep)
            lidar.late = [*(entry for entry in lidar.late if entry[0] < arrival), (arrival, scan)]  # drop overtaken
            lidar.scan = previous
        elif lidar.late:
            lidar.late = []  # overtaken

    def detections(
        self, state: FaultState, found: tuple[Detection, ...], objects: list[ObjectState], eye: Array, frame: Frame
    ) -> tuple[Detection, ...]:
        """Apply faults to the newest detections; ``eye`` (3,) [m] in the world."""
        free = [item for item in objects if item.state != "held"]
        if not free or not state.on.keys() & _OF_CAMERA:
            return found
        near = sorted(free, key=lambda item: (math.dist(item.position.tolist(), eye.tolist()), item.name))
        if state.active("camera_swap") and len(near) > 1:
            first, second = near[0].name, near[1].name
            names = {first: second, second: first}
            found = tuple(msgspec.structs.replace(one, name=names.get(one.name, one.name)) for one in found)
        if state.active("camera_lost"):
            found = tuple(one for one in found if one.name != near[0].name)
        ghost = state.on.get("camera_ghost")
        return found if ghost is None else (_ghost(ghost, near[0], frame), *found)

    def base(self, state: FaultState, twist: Array) -> tuple[Array, float, float]:
        """Twist (2,) that the wheels track, their additional lag [s], and the share of it that moves the base."""
        lag, slip = state.on.get("base_lag"), state.on.get("wheel_slip")
        tracked = np.zeros(2) if state.active("base_stuck") else twist
        return tracked, 0.0 if lag is None else lag.value, 1.0 if slip is None else 1.0 - slip.value

    def rates(self, state: FaultState, commanded: Array) -> Array:
        """Joint rates (7,) [rad/s] that the arm tracks."""
        stuck = state.on.get("joint_stuck")
        if stuck is None:
            return commanded
        tracked = commanded.copy()
        tracked[stuck.joint - 1] = 0.0
        return tracked

    def report(self, state: FaultState, now: Observation, substep: int) -> None:
        """Store the motion report of a substep, and select the one reported while reports are late."""
        late = state.on.get("state_delay")
        if late is None:
            return
        state.reports.append((substep, *(getattr(now, name) for name in _MOTION)))
        newest = substep - round(late.value / self._substep)
        while len(state.reports) > 1 and state.reports[1][0] <= newest:
            state.reports.pop(0)
        state.reported = state.reports[0]

    def late(self, state: FaultState, now: Observation, substep: int) -> Observation:
        """The observation with the newest motion report that has arrived."""
        reported = state.reported
        if reported is None:
            return now
        at, *motion = reported
        age = (substep - at) * self._substep
        return msgspec.structs.replace(now, **dict(zip(_MOTION, motion, strict=True)), age=age, behind=age)


def _edit_of(one: TimedFault) -> InjectFault:
    return InjectFault(**{field: getattr(one, field) for field in FaultFields.__struct_fields__})


def _ghost(fault: ActiveFault, item: ObjectState, frame: Frame) -> Detection:
    """A false detection of an object, beside its true position."""
    stamp, pose, odometry = frame
    beside = item.position + fault.value * np.array([math.cos(fault.angle), math.sin(fault.angle), 0.0])
    return Detection(
        stamp=stamp,
        name=item.name,
        p_base=to_frame(pose, beside),
        yaw_base=math.remainder(item.yaw - float(pose[2]), 0.5 * math.pi),
        position_sd=_GHOST_SD,
        odometry=odometry.copy(),
    )


def _shifted(pose: Array, shift: tuple[float, float]) -> Array:
    x, y = shift
    return pose if x == y == 0.0 else pose + np.array([x, y, 0.0])


_RNG_FAULTS = 0xFA0175


def gripper_with(scene: Scene, objects: ObjectWorld, dt: float) -> Gripper:
    """The gripper of a scene: the regular one unless the scene has grasp faults."""
    usual = scene.robot.gripper, objects, dt, scene.grasp_rule, scene.grasp_speed
    plain = msgspec.structs.replace(scene.faults, inject=None) == Faults()
    return Gripper(*usual) if plain else FaultyGripper(scene.faults, scene.seed, *usual)


@dataclass(kw_only=True)
class FaultyGripperState(GripperState):
    """Gripper state, and the faults of its grasps."""

    rng: np.random.Generator
    delay: float = 0.0  # [s] by which the newest closing takes longer
    tries: dict[str, int] = field(default_factory=dict)  # grasps of each cube so far, in the order of the first


class FaultyGripper(Gripper):
    """Makes grasps fail or take longer as the scene says.

    Slow fingers reach the cube in the usual time and then take longer to hold it firmly. Until then the rule of `grasp`
    must be kept.
    """

    def __init__(self, faults: Faults, seed: int, *usual: Any) -> None:
        """``seed`` of the scene; ``usual``: arguments of `Gripper`."""
        super().__init__(*usual)
        self.faults, self._seed = faults, seed

    def start(self) -> FaultyGripperState:
        """Open and empty."""
        return FaultyGripperState(width=self.spec.max_width, rng=np.random.default_rng([self._seed, _RNG_FAULTS]))

    def command(
        self, state: GripperState, command: str, now: float, tcp: Array, rotation: Array, cubes: Sequence[ObjectState]
    ) -> None:
        """React to a changed command at its time; a grasp that begins now may draw a fault."""
        assert isinstance(state, FaultyGripperState)
        before = state.phase
        super().command(state, command, now, tcp, rotation, cubes)
        if state.phase == "closing" and before != "closing":
            state.delay = 0.0
            if state.candidate:
                self._draw_fault(state)

    def _draw_fault(self, state: FaultyGripperState) -> None:
        """Draw the fault of a grasp that begins; every grasp draws equally many numbers, so none affects another."""
        faults, name = self.faults, state.candidate
        state.tries[name] = tried = state.tries.get(name, 0) + 1
        chance, more = state.rng.random(2)
        if faults.only_object and list(state.tries).index(name) + 1 != faults.only_object:
            return
        state.delay = faults.grasp_delay + faults.grasp_delay_spread * more
        due = faults.grasp_misses + faults.grasp_slips
        if tried <= faults.grasp_misses or (tried > due and chance < faults.grasp_failure_probability):
            state.candidate = ""
        elif tried <= due:
            state.slid = True

    def _closing_duration(self, state: GripperState) -> float:
        """As in `Gripper`, with the additional time to a firm hold."""
        assert isinstance(state, FaultyGripperState)
        return self.spec.closing_time + state.delay


_RNG_MEDDLING = 0x3EDD1E
_DIRECTIONS = 16  # directions tried, beginning with a random one
_LEVEL = 1e-6  # [m] by which the support heights may differ


class CubeMover:
    """Moves each cube once, and only while it stands exactly where the scene has it."""

    def __init__(self, scene: Scene) -> None:
        """``scene`` may have no moved cubes; then nothing happens."""
        self._by, self._within = scene.faults.cube_moved_by, scene.faults.cube_moved_within
        self._starts = {item.name: item.position for item in scene.objects}
        self._order = [task.object for task in scene.tasks if isinstance(task, Pick)]
        drawn = np.random.default_rng([scene.seed, _RNG_MEDDLING]).uniform(0.0, 2.0 * math.pi, len(self._order))
        self._angles = dict(zip(self._order, drawn.tolist(), strict=True))

    def attempts(self, objects: Sequence[ObjectState], pose: Array, solids: Solids) -> Iterator[MoveObject]:
        """Candidate places for the cube that is picked next, in order of preference; none if it must not move."""
        if self._by <= 0.0:
            return
        states = {item.name: item for item in objects}
        item = next((states[name] for name in self._order if states[name].state == "resting"), None)
        if item is None or any(other.state in ("held", "falling") for other in objects):
            return
        x, y, z = self._starts[item.name]
        if math.hypot(x - pose[0], y - pose[1]) > self._within or not np.array_equal(item.position, (x, y, z)):
            return
        for k in range(_DIRECTIONS):
            angle = self._angles[item.name] + 2.0 * math.pi * k / _DIRECTIONS
            edit = MoveObject(name=item.name, x=x + self._by * math.cos(angle), y=y + self._by * math.sin(angle))
            if _carried_whole(objects, solids, edit, item):
                yield edit


def _carried_whole(objects: Sequence[ObjectState], solids: Solids, edit: MoveObject, item: ObjectState) -> bool:
    """True when all four corners would be supported at the cube's present height."""
    half = 0.5 * item.side * math.sqrt(2.0)
    for dx, dy in ((half, half), (half, -half), (-half, half), (-half, -half)):
        corner = MoveObject(name=edit.name, x=edit.x + dx, y=edit.y + dy)
        below, bin_name = put_down(objects, solids, corner)
        if bin_name or abs(float(below.position[2]) - float(item.position[2])) > _LEVEL:
            return False
    return True
