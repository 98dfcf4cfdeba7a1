"""Motion of robot, objects and agents in a substep: by kinematics here, by contact dynamics in the room `physics`."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import NamedTuple, Protocol

import numpy as np

from motm_twin.model.arm_kernels import TCP
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact, PhysicsTruth
from motm_twin.model.scene import Point
from motm_twin.sim.actuators import Arm, Base
from motm_twin.sim.gripper import Gripper
from motm_twin.sim.layout import Scenery
from motm_twin.sim.objects import ObjectWorld
from motm_twin.sim.plant_state import PlantState

NO_SLIDES: Mapping[str, Point] = MappingProxyType({})
Frames = Callable[[Array, Array], Array]  # pose (3,), q (7,) -> transforms of `ARM_FRAMES` in the world (11, 4, 4)


class Told(NamedTuple):
    """Command of the drives for a substep, with what is wrong with them."""

    twist: Array  # forward speed and yaw rate, shape (2,)
    more_lag: float  # [s] of the base
    grip: float  # share of the wheels' motion that moves the base
    rates: Array  # of the joints [rad/s], shape (7,)
    stuck: bool  # the fingers are


@dataclass(frozen=True, kw_only=True)
class Moved:
    """Result of a substep, beside what it left in the state."""

    frames: Array  # of the arm in the world, shape (11, 4, 4)
    mean_twist: tuple[float, float]  # by the wheels, over the substep
    twist: Array  # true forward speed and yaw rate of the base at its end, shape (2,)
    slides: Mapping[str, Point] = field(default_factory=lambda: NO_SLIDES)  # velocities [m/s] of thrown bodies
    riding: tuple[str, ...] = ()  # objects on them
    links: Mapping[str, Array] | None = None  # transforms of the links in the world; None: those of a level base
    faults: tuple[tuple[str, str], ...] = ()  # kind and text of what the simulation itself broke


class Surroundings(Protocol):
    """Bodies that move by themselves, or because a person threw them."""

    def slide(self) -> tuple[Mapping[str, Point], tuple[str, ...]]:
        """Move thrown bodies; their velocities [m/s], and the objects carried along."""
        ...

    def drive_agents(self, frames: Array, slides: Mapping[str, Point]) -> None:
        """Let the agents go on, given the frames of the arm."""
        ...

    @property
    def scenery(self) -> Scenery:
        """Everything that does not move by itself."""
        ...


class Mechanics(Protocol):
    """Motion of everything."""

    solid: bool  # bodies press on each other, and may rest against each other

    def begin(self, state: PlantState, scenery: Scenery) -> tuple[Array, Mapping[str, Array] | None]:
        """Bring the state to rest at the start; the frames of the arm and the links."""
        ...

    def grip(self, state: PlantState, now: float, frames: Array) -> None:
        """Take the gripper's command, which has just changed [s]."""
        ...

    def frames(self, state: PlantState) -> Array:
        """Frames of the arm as the state has them."""
        ...

    def substep(self, state: PlantState, told: Told, around: Surroundings) -> Moved:
        """Move everything on; ``state.substep`` counts up when robot and objects have moved."""
        ...

    def prepare(self, state: PlantState, scenery: Scenery) -> None:
        """Another state comes, which was restored."""
        ...

    def felt(self, state: PlantState, judged: Sequence[Contact]) -> PhysicsTruth | None:
        """Forces so far, beside the referee's contacts; None without any."""
        ...

    def edited(self, state: PlantState, scenery: Scenery) -> Mapping[str, Array] | None:
        """A person has changed the state; the links as they are now."""
        ...


class Kinematics:
    """The robot follows its commands; nothing in the world stops or pushes it. Objects obey rules of `grasp`."""

    solid = False

    def __init__(self, base: Base, arm: Arm, gripper: Gripper, objects: ObjectWorld, frames: Frames) -> None:
        self._base, self._arm, self._gripper, self._objects, self._frames = base, arm, gripper, objects, frames
        self._dt = base.dt

    def begin(self, state: PlantState, scenery: Scenery) -> tuple[Array, Mapping[str, Array] | None]:
        """The state is at rest already."""
        return self.frames(state), None

    def frames(self, state: PlantState) -> Array:
        """Frames of the arm as the state has them."""
        return self._frames(state.base.pose, state.arm.q)

    def grip(self, state: PlantState, now: float, frames: Array) -> None:
        """Take the gripper's changed command."""
        tcp, rotation = frames[TCP, :3, 3], frames[TCP, :3, :3]
        self._gripper.command(state.gripper, state.gripper_command, now, tcp, rotation, state.objects)

    def substep(self, state: PlantState, told: Told, around: Surroundings) -> Moved:
        """Move everything on."""
        s = state
        old_v, old_w, old_tcp = s.base.v, s.base.w, s.tcp
        self._base.step(s.base, told.twist, more_lag=told.more_lag, grip=told.grip)
        self._arm.step(s.arm, told.rates)
        s.path_length += told.grip * abs(0.5 * (old_v + s.base.v)) * self._dt
        s.substep += 1
        frames = self._frames(s.base.pose, s.arm.q)
        s.tcp = frames[TCP, :3, 3].copy()
        slides, riding = around.slide() if s.slides else (NO_SLIDES, ())
        solids = around.scenery.solids
        now, velocity = s.substep * self._dt, (s.tcp - old_tcp) / self._dt
        self._gripper.step(s.gripper, now, frames, velocity, s.objects, solids, stuck=told.stuck)
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
        """Nothing beside the state has to fit it."""

    def felt(self, state: PlantState, judged: Sequence[Contact]) -> PhysicsTruth | None:
        """Kinematics have no forces."""
        return None

    def edited(self, state: PlantState, scenery: Scenery) -> Mapping[str, Array] | None:
        """Nothing beside the state knows of it."""
        return None
