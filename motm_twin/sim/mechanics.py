"""Motion of robot, objects and agents in a substep: by kinematics here, by contact dynamics in package `physics`.

Base and arm have limits, a first-order lag, and errors between command and motion.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, Protocol

import msgspec
import numpy as np

from motm_twin.model.arm_kernels import TCP
from motm_twin.model.compiler import njit
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array
from motm_twin.model.motion import drive, lag_share
from motm_twin.model.plant import Contact, PhysicsTruth
from motm_twin.model.profile import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN, BaseLimits
from motm_twin.model.scene import Mismatch, Noise, Point, Scene
from motm_twin.sim.gripper import Gripper
from motm_twin.sim.objects import ObjectWorld
from motm_twin.sim.plant_state import ArmState, BaseState, PlantState
from motm_twin.sim.solids import Scenery


def _towards(now: float, desired: float, factor: float, largest: float) -> float:
    change = factor * (desired - now)
    return now + min(largest, max(-largest, change))


class Base:
    """Follows a commanded twist within its limits. Nothing in the world stops it: see `SimulatedPlant`."""

    def __init__(self, limits: BaseLimits, dt: float, scale: Sequence[float] | Array = (1.0, 1.0)) -> None:
        """Limits of the profile, for substeps of dt [s]; ``scale``: factors on the commanded speeds."""
        self.limits = limits
        self.dt = dt
        self.scale = (float(scale[0]), float(scale[1]))
        self._factor = lag_share(limits.velocity_lag, dt)

    def step(self, state: BaseState, twist: Array, *, more_lag: float = 0.0, grip: float = 1.0) -> None:
        """One substep towards the commanded forward speed and yaw rate, shape (2,).

        ``more_lag`` [s]: added to the velocity loop; ``grip``: share of the wheels' motion that moves the base.
        """
        limits, dt = self.limits, self.dt
        factor = self._factor if more_lag == 0.0 else lag_share(limits.velocity_lag + more_lag, dt)
        v_cmd, w_cmd = twist.tolist()
        v_goal = min(limits.forward_speed, max(-limits.reverse_speed, self.scale[0] * v_cmd))
        w_goal = min(limits.yaw_rate, max(-limits.yaw_rate, self.scale[1] * w_cmd))
        v = _towards(state.v, v_goal, factor, limits.linear_acceleration * dt)
        w = _towards(state.w, w_goal, factor, limits.yaw_acceleration * dt)
        state.pose = drive(state.pose, 0.5 * grip * (state.v + v), 0.5 * grip * (state.w + w), dt)
        state.v, state.w = v, w


class Arm:
    """Follows commanded joint rates within its limits, and brakes in time before a position limit."""

    def __init__(self, velocity_lag: float, dt: float) -> None:
        """Lag [s] of the velocity loop, for substeps of dt [s]."""
        self.dt = dt
        self._factor = lag_share(velocity_lag, dt)

    def step(self, state: ArmState, joint_velocity: Array) -> None:
        """One substep towards the commanded joint rates [rad/s], shape (7,)."""
        state.q, state.dq = _follow(state.q, state.dq, joint_velocity, self._factor, self.dt)


@njit(cache=True)
def _follow(q: Array, dq: Array, command: Array, factor: float, dt: float) -> tuple[Array, Array]:
    new_q, new_dq = np.empty_like(q), np.empty_like(dq)
    for i in range(q.shape[0]):
        a, old = DDQ_MAX[i], dq[i]
        desired = old + factor * (min(DQ_MAX[i], max(-DQ_MAX[i], command[i])) - old)
        desired = min(desired, _stoppable(Q_MAX[i] - q[i], old, a, dt))
        desired = max(desired, -_stoppable(q[i] - Q_MIN[i], -old, a, dt))
        new_dq[i] = old + min(a * dt, max(-a * dt, desired - old))
        new_q[i] = min(Q_MAX[i], max(Q_MIN[i], q[i] + 0.5 * (old + new_dq[i]) * dt))
    return new_q, new_dq


@njit(cache=True)
def _stoppable(room: float, speed: float, a: float, dt: float) -> float:
    """Largest next speed from which a joint can still stop within the remaining room [rad].

    Solves v dt / 2 + v' dt / 2 + v'^2 / (2 a) + a dt^2 / 8 = room for v'; the last term covers the final, partial
    braking step. Never negative: at a limit the joint stands still.
    """
    left = room - 0.5 * speed * dt - 0.125 * a * dt * dt
    return max(0.0, math.sqrt(max(0.25 * a * a * dt * dt + 2.0 * a * left, 0.0)) - 0.5 * a * dt)


_RNG_BASE, _RNG_ARM, _RNG_HAND_EYE = 0xBA5E5C, 0xA53A4E, 0xE7E0FF


class ControlErrors:
    """Actuation and hand-eye errors of one seed. Stateless: each is drawn from the seed and its substep."""

    def __init__(self, noise: Noise, mismatch: Mismatch, seed: int) -> None:
        """Noise of the scene, and its mismatch to the robot's model."""
        drawn = np.random.default_rng([seed, _RNG_BASE]).standard_normal(2)
        scale = 1.0 + noise.base_speed_scale_sd * drawn
        self.base_scale = scale * (1.0 + mismatch.base_scale)  # of forward speed and yaw rate, shape (2,)
        self.camera_bias = hand_eye(mismatch, seed)  # [m] in the hand's frame, shape (3,)
        self._rate_sd, self._seed = noise.arm_rate_sd, seed

    def rates(self, command: Array, substep: int) -> Array:
        """Joint rates [rad/s] that the arm tracks in a substep, given the commanded ones, shape (7,).

        A joint commanded to stand holds its position.
        """
        if self._rate_sd == 0.0:
            return command
        off = self._rate_sd * np.random.default_rng([self._seed, _RNG_ARM, substep]).standard_normal(7)
        return np.where(command == 0.0, command, command + off)


def hand_eye(mismatch: Mismatch, seed: int) -> Array:
    """Offset [m] between reported and true position, in the hand's frame, shape (3,), in a random direction."""
    if mismatch.hand_eye == 0.0:
        return np.zeros(3)
    drawn = np.random.default_rng([seed, _RNG_HAND_EYE]).standard_normal(3)
    return mismatch.hand_eye / norm(drawn) * drawn


def drives(scene: Scene, dt: float) -> tuple[Base, Arm]:
    """Base and arm of a scene, with their errors and mismatch, for substeps of dt [s]."""
    robot, mismatch = scene.robot, scene.mismatch
    limits = msgspec.structs.replace(robot.base, velocity_lag=robot.base.velocity_lag + mismatch.base_lag)
    scale = ControlErrors(scene.noise, mismatch, scene.seed).base_scale
    return Base(limits, dt, scale), Arm(robot.arm.velocity_lag + mismatch.arm_lag, dt)


NO_SLIDES: Mapping[str, Point] = MappingProxyType({})
Frames = Callable[[Array, Array], Array]  # pose (3,), q (7,) -> transforms of `ARM_FRAMES` in the world (11, 4, 4)


class DriveCommand(NamedTuple):
    """Command of the drives for a substep, with the faults of the drives."""

    twist: Array  # forward speed and yaw rate, shape (2,)
    more_lag: float  # [s] additional lag of the base
    grip: float  # share of the wheels' motion that moves the base
    rates: Array  # of the joints [rad/s], shape (7,)
    stuck: bool  # the fingers do not move


@dataclass(frozen=True, kw_only=True)
class Moved:
    """Result of a substep, in addition to the changed state."""

    frames: Array  # of the arm in the world, shape (11, 4, 4)
    mean_twist: tuple[float, float]  # by the wheels, over the substep
    twist: Array  # true forward speed and yaw rate of the base at its end, shape (2,)
    slides: Mapping[str, Point] = field(default_factory=lambda: NO_SLIDES)  # velocities [m/s] of thrown bodies
    riding: tuple[str, ...] = ()  # objects on thrown bodies
    links: Mapping[str, Array] | None = None  # transforms of the links in the world; None: those of a level base
    faults: tuple[tuple[str, str], ...] = ()  # kind and text of limits that the simulation itself broke


class Surroundings(Protocol):
    """Bodies that move by themselves, or because a person threw them."""

    def slide(self) -> tuple[Mapping[str, Point], tuple[str, ...]]:
        """Move thrown bodies; their velocities [m/s], and the objects carried along."""
        ...

    def drive_agents(self, frames: Array, slides: Mapping[str, Point]) -> None:
        """Move the agents on, given the frames of the arm."""
        ...

    @property
    def scenery(self) -> Scenery:
        """Everything that does not move by itself."""
        ...


class Mechanics(Protocol):
    """Mechanics of a plant: moves robot, objects and agents, one substep at a time."""

    solid: bool  # bodies press on each other, and may rest against each other

    def begin(self, state: PlantState, scenery: Scenery) -> tuple[Array, Mapping[str, Array] | None]:
        """Bring the state to rest at the start; returns frames of the arm, and the links."""
        ...

    def grip(self, state: PlantState, now: float, frames: Array) -> None:
        """Start the gripper command that changed at ``now`` [s]; ``frames`` of the arm."""
        ...

    def frames(self, state: PlantState) -> Array:
        """Frames of the arm in this state."""
        ...

    def substep(self, state: PlantState, command: DriveCommand, around: Surroundings) -> Moved:
        """Move everything on; ``state.substep`` counts up when robot and objects have moved."""
        ...

    def prepare(self, state: PlantState, scenery: Scenery) -> None:
        """Adapt to a state that was restored from a snapshot."""
        ...

    def felt(self, state: PlantState, judged: Sequence[Contact]) -> PhysicsTruth | None:
        """Contact forces so far, compared with the referee's contacts; None for mechanics without forces."""
        ...

    def edited(self, state: PlantState, scenery: Scenery) -> Mapping[str, Array] | None:
        """Adapt to a person's change of the state; returns the present links."""
        ...


class Kinematics:
    """The robot follows its commands; nothing in the world stops or pushes it. Objects obey rules of `grasp`."""

    solid = False

    def __init__(self, base: Base, arm: Arm, gripper: Gripper, objects: ObjectWorld, frames: Frames) -> None:
        self._base, self._arm, self._gripper, self._objects, self._frames = base, arm, gripper, objects, frames
        self._dt = base.dt

    def begin(self, state: PlantState, scenery: Scenery) -> tuple[Array, Mapping[str, Array] | None]:
        """Return the frames of the arm: the state is already at rest."""
        return self.frames(state), None

    def frames(self, state: PlantState) -> Array:
        """Frames of the arm in this state."""
        return self._frames(state.base.pose, state.arm.q)

    def grip(self, state: PlantState, now: float, frames: Array) -> None:
        """Take the gripper's changed command."""
        tcp, rotation = frames[TCP, :3, 3], frames[TCP, :3, :3]
        self._gripper.command(state.gripper, state.gripper_command, now, tcp, rotation, state.objects)

    def substep(self, state: PlantState, command: DriveCommand, around: Surroundings) -> Moved:
        """Move everything on."""
        s = state
        old_v, old_w, old_tcp = s.base.v, s.base.w, s.tcp
        self._base.step(s.base, command.twist, more_lag=command.more_lag, grip=command.grip)
        self._arm.step(s.arm, command.rates)
        s.path_length += command.grip * abs(0.5 * (old_v + s.base.v)) * self._dt
        s.substep += 1
        frames = self._frames(s.base.pose, s.arm.q)
        s.tcp = frames[TCP, :3, 3].copy()
        slides, riding = around.slide() if s.slides else (NO_SLIDES, ())
        solids = around.scenery.solids
        now, velocity = s.substep * self._dt, (s.tcp - old_tcp) / self._dt
        self._gripper.step(s.gripper, now, frames, velocity, s.objects, solids, stuck=command.stuck)
        for item in s.objects:
            if item.state == "falling":
                self._objects.fall(item, s.objects, solids)
        around.drive_agents(frames, slides)
        return Moved(
            frames=frames,
            mean_twist=(0.5 * (old_v + s.base.v), 0.5 * (old_w + s.base.w)),
            twist=np.array([s.base.v, s.base.w]),
            slides=slides,
            riding=riding,
        )

    def prepare(self, state: PlantState, scenery: Scenery) -> None:
        """Do nothing: kinematics keep no data outside the state."""

    def felt(self, state: PlantState, judged: Sequence[Contact]) -> PhysicsTruth | None:
        """None: kinematics have no forces."""
        return None

    def edited(self, state: PlantState, scenery: Scenery) -> Mapping[str, Array] | None:
        """None, as there are no links to report: kinematics keep no data outside the state."""
        return None
