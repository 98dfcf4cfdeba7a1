"""Pass-by experiment of the arm alone: the base drives a given curve past one object and one bin, in the real plant."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles, ArmStep
from motm_twin.model.arm_kernels import HAND, TCP
from motm_twin.model.geometry import Array, compose, from_frame, inverse, wrap_angle
from motm_twin.model.known import known_world
from motm_twin.model.motion import drive
from motm_twin.model.plant import Observation, Truth
from motm_twin.model.scene import Scene
from motm_twin.perception.objects import ObjectTracker
from motm_twin.sim.plant import SimulatedPlant

DT = 0.01  # [s]
_RANGE = {"pick": 0.78, "place": 0.93}  # [m] from the mount: an object, the centre of a bin
_NODE = 0.1  # [s] between nodes of the promised plan
_NODES = 40


class Pass(msgspec.Struct, frozen=True, kw_only=True):
    """One pass: where the base starts and what twist is wanted over time."""

    start: tuple[float, float, float]
    twist: Callable[[float], tuple[float, float]]  # of the time [s]
    object: str
    bin: str = ""
    place_start: tuple[float, float, float] | None = None  # where the base is put for the place
    time: float = 12.0  # [s] at most


@dataclass
class PassResult:
    """Outcome of a pass: pick, place, contacts, and errors of the hand."""

    picked: bool = False
    held: bool = False  # by the referee's truth
    missed: int = 0
    contacts: list[str] = field(default_factory=list)
    faults: tuple[str, ...] = ()
    closing_speed: float = 0.0  # [m/s] mean base speed while the fingers close
    entry_radius: float = 0.0  # [m] mount to object when closing begins
    exit_radius: float = 0.0  # [m] the same when it ends
    worst_speed: float = 0.0  # [m/s] of the hand over the object while closing
    worst_error: float = 0.0  # [m]
    worst_tilt: float = 0.0  # [rad]
    approach_time: float = 0.0  # [s] final approach to closing
    stops: int = 0  # damped stops
    placed: bool = False
    time: float = 0.0
    reasons: list[str] = field(default_factory=list)
    steps: list[tuple[ArmStep, Observation, Truth]] = field(default_factory=list)


def limited(wanted: tuple[float, float], now: Array, scene: Scene, dt: float) -> Array:
    """The wanted twist, as far as one step's acceleration allows."""
    limits = scene.robot.base
    step = np.array([limits.linear_acceleration, limits.yaw_acceleration]) * dt
    return np.clip(np.array(wanted), now - step, now + step)


class Driver:
    """Closes the loop of plant, tracker and manipulator for a prescribed base motion."""

    def __init__(self, scene: Scene, parameters: ArmParameters | None = None, keep: bool = False) -> None:
        """A plant at the scene's start; the tracker reads the camera directly, so objects have markers."""
        self.scene = scene = msgspec.structs.replace(scene, detections="named")
        self.plant = SimulatedPlant(scene)
        self.known = known_world(scene)
        self.tracker = ObjectTracker(self.known)
        self.manipulator = Manipulator(self.known, parameters)
        self.keep = keep
        self.commanded = np.zeros(2)
        self.result = PassResult()
        self.obstacles = ArmObstacles(points=np.zeros((0, 2)), static=np.zeros(0, dtype=bool))

    def goal(self, observation: Observation, kind: str, name: str) -> ArmGoal:
        """The arm's goal as the task side would give it."""
        if kind == "pick":
            position, yaw, sd, seen = self.tracker.belief(name, observation)
            return ArmGoal(
                kind="pick", name=name, position=position, yaw=yaw, side=0.04, position_sd=sd, last_seen=seen
            )
        T = compose(observation.odometry, inverse(observation.pose))
        box = next((item for item in self.known.bins if item.name == name), None)
        if box is None:
            return ArmGoal(
                kind="none", name="", position=np.zeros(3), yaw=0.0, side=0.04, position_sd=0.0, last_seen=None
            )
        return ArmGoal(
            kind="place",
            name=name,
            position=from_frame(T, np.array([*box.centre, box.rim_z])),
            yaw=wrap_angle(box.yaw + T[2]),
            side=0.04,
            position_sd=0.0,
            last_seen=observation.time,
            release_half_width=0.5 * box.side - box.wall,
        )

    def step(self, wanted: Callable[[float], tuple[float, float]], kind: str, name: str, began: float) -> ArmStep:
        """One arm step."""
        observation = self.plant.observe()
        self.tracker.update(observation)
        goal = self.goal(observation, kind, name)
        now = observation.time - began
        twist = limited(wanted(now), self.commanded, self.scene, DT)
        times, poses = self._promise(observation, wanted, now)
        inputs = ArmInputs(
            observation=observation,
            dt=DT,
            goal=goal,
            base_twist=twist,
            time_to_range=self._time_to_range(goal, observation, times, poses),
            plan_times=times,
            plan_poses=poses,
            obstacles=self.obstacles,
            T_odom_world=compose(observation.odometry, inverse(observation.pose)),
        )
        step = self.manipulator.step(inputs)
        self.commanded = step.actuation.twist.copy()
        self._note(step, observation, goal)
        self.plant.command(step.actuation)
        self.plant.step(DT)
        return step

    def _promise(self, observation: Observation, wanted: Callable, now: float) -> tuple[Array, Array]:
        pose, twist = observation.odometry.copy(), self.commanded.copy()
        times, poses = [], []
        for i in range(_NODES):
            twist = limited(wanted(now + i * _NODE), twist, self.scene, _NODE)
            pose = drive(pose, float(twist[0]), float(twist[1]), _NODE)
            times.append((i + 1) * _NODE)
            poses.append([*pose, *twist])
        return np.array(times), np.array(poses)

    def _time_to_range(self, goal: ArmGoal, observation: Observation, times: Array, poses: Array) -> float:
        if goal.kind == "none":
            return math.inf
        x = self.scene.robot.arm.mount_x
        for t, pose in zip(
            np.concatenate([[0.0], times]), np.vstack([observation.odometry, poses[:, :3]]), strict=True
        ):
            dx = goal.position[0] - pose[0] - x * math.cos(pose[2])
            dy = goal.position[1] - pose[1] - x * math.sin(pose[2])
            if math.hypot(dx, dy) <= _RANGE[goal.kind]:
                return float(t)
        return math.inf

    def _note(self, step: ArmStep, observation: Observation, goal: ArmGoal) -> None:
        result = self.result
        result.time = observation.time
        result.stops += step.qp_status.startswith("damped stop")
        if step.reason and (not result.reasons or result.reasons[-1] != step.reason):
            result.reasons.append(step.reason)
        result.missed += step.outcome == "missed"
        result.picked |= step.outcome == "picked"
        result.placed |= step.outcome == "placed"
        if self.keep:
            result.steps.append((step, observation, self.plant.truth()))


def run_pick(scene: Scene, spec: Pass, parameters: ArmParameters | None = None, keep: bool = False) -> PassResult:
    """Drive past and pick."""
    scene = msgspec.structs.replace(scene, start=spec.start)
    driver = Driver(scene, parameters, keep)
    _pick(driver, spec)
    _finish(driver, spec.object)
    return driver.result


def _pick(driver: Driver, spec: Pass) -> None:
    result = driver.result
    speeds = []
    carry_until = None
    began = driver.plant.time
    last_phase, final_at = "", 0.0
    kind, name = "pick", spec.object
    while driver.plant.time - began < spec.time:
        step = driver.step(spec.twist, kind, name, began)
        truth = driver.plant.truth()
        item = next(body for body in truth.objects if body.name == spec.object)
        radius = _mount_distance(truth.pose, item.position, driver.scene)
        if step.phase == "final" and last_phase != "final":
            final_at = step.time
        if step.phase == "closing":
            if last_phase != "closing":
                speeds = []
                result.entry_radius, result.approach_time = radius, step.time - final_at
                result.worst_error = result.worst_tilt = 0.0
            speeds.append(abs(float(driver.plant.observe().twist[0])))
            result.exit_radius = radius
            tcp = driver.plant._state.tcp
            result.worst_error = max(result.worst_error, float(np.abs(tcp - np.array(item.position)).max()))
            result.worst_tilt = max(result.worst_tilt, step.tilt)
        last_phase = step.phase
        if step.outcome == "picked":
            kind, name = "none", ""
            carry_until = step.time + 1.5
        if carry_until is not None and step.time > carry_until:
            break
    result.closing_speed = float(np.mean(speeds)) if speeds else 0.0


def run_place(scene: Scene, spec: Pass, parameters: ArmParameters | None = None, keep: bool = False) -> PassResult:
    """Pick as in `run_pick`, then put the base at ``place_start`` and drive past the bin."""
    scene = msgspec.structs.replace(scene, start=spec.start)
    driver = Driver(scene, parameters, keep)
    standing = msgspec.structs.replace(spec, twist=lambda t: (0.0, 0.0))
    _pick(driver, standing)
    assert spec.place_start is not None
    _put(driver.plant, np.array(spec.place_start))
    began = driver.plant.time
    done = None
    kind = "place"
    while driver.plant.time - began < spec.time:
        step = driver.step(spec.twist, kind, spec.bin if kind == "place" else "", began)
        if step.outcome == "placed":
            driver.result.exit_radius = _mount_distance(
                driver.plant.truth().pose, next(box.centre for box in scene.bins if box.name == spec.bin), scene
            )
            driver.result.approach_time = step.time - began
            driver.result.closing_speed = abs(float(driver.plant.observe().twist[0]))
            done, kind = step.time + 1.5, "none"
        if done is not None and step.time > done:
            break
    _finish(driver, spec.object)
    return driver.result


def _put(plant: SimulatedPlant, pose: Array) -> None:
    """Move the robot, and let the referee begin anew: nothing has happened on the way."""
    state = plant._state
    state.base.pose, state.localisation.pose = pose.copy(), pose.copy()
    state.tcp = plant._frames(pose, state.arm.q)[TCP, :3, 3].copy()
    item = next((item for item in state.objects if item.name == state.gripper.held), None)
    if item is not None:
        frames = plant._frames(pose, state.arm.q)
        item.position = frames[HAND, :3, 3] + frames[HAND, :3, :3] @ state.gripper.position_in_hand
    state.referee = plant._referee.start(plant._world(links=None))


def _mount_distance(pose: Array, point: tuple[float, ...], scene: Scene) -> float:
    x = scene.robot.arm.mount_x
    return math.hypot(point[0] - pose[0] - x * math.cos(pose[2]), point[1] - pose[1] - x * math.sin(pose[2]))


def _finish(driver: Driver, name: str) -> None:
    truth = driver.plant.truth()
    item = next(body for body in truth.objects if body.name == name)
    driver.result.held = item.state == "held"
    driver.result.placed = driver.result.placed and item.state.startswith("binned")
    driver.result.contacts = [f"{c.body}-{c.other} {c.depth * 1e3:.1f}mm t={c.time:.2f}" for c in truth.contacts]
    driver.result.faults = truth.plant_faults
