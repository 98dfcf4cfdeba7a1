"""Announcements to the robot during a run: parameters, and where pieces of furniture stand."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld, known_world
from motm_twin.model.names import hint
from motm_twin.model.plant import Truth
from motm_twin.model.scene import PlanarPose, Scene
from motm_twin.model.scene_shapes import moved_scene, pieces, relative, rigid
from motm_twin.model.state import LATER, Stateful
from motm_twin.perception.footprints import distance_to_shape

BESIDE = 0.03  # [m] beyond the border of a table at which the centre of a cube may be believed
BELOW = 0.05  # [m] below a table top at which it may be believed to stand on it
ABOVE = 0.40  # [m] above: in a bin, or on another cube


@dataclass
class AnnouncementsState:
    """Announcements so far."""

    parameters: dict[str, ParameterValue] = field(default_factory=dict)  # that differ from the shipped ones
    furniture: dict[str, PlanarPose] = field(default_factory=dict)  # announced pieces
    gone: tuple[str, ...] = ()  # announced pieces that were taken away
    lag: float = field(default=0.0, metadata=LATER)  # [s] of the base beyond its profile: estimated, not announced


class Announcements(Stateful[AnnouncementsState]):
    """Announcements in one run of a scene, and the robot's knowledge after them."""

    def __init__(self, scene: Scene, parameters: dict[str, ParameterValue]) -> None:
        self.scene = scene
        self._state = AnnouncementsState(parameters=dict(parameters))

    @property
    def parameters(self) -> dict[str, ParameterValue]:
        """Parameters that differ from the shipped ones."""
        return dict(self._state.parameters)

    @property
    def map(self) -> tuple[dict[str, PlanarPose], tuple[str, ...]]:
        """Poses of announced pieces, and those that are gone."""
        return dict(self._state.furniture), self._state.gone

    def known(self) -> KnownWorld:
        """The robot's prior knowledge, with the announcements and the estimated lag of its base."""
        known, lag = known_world(moved_scene(self.scene, self._state.furniture, self._state.gone)), self._state.lag
        if not lag:
            return known
        base = msgspec.structs.replace(known.robot.base, velocity_lag=known.robot.base.velocity_lag + lag)
        return msgspec.structs.replace(known, robot=msgspec.structs.replace(known.robot, base=base))

    @property
    def lag(self) -> float:
        """Lag of the base beyond its profile [s]."""
        return self._state.lag

    @lag.setter
    def lag(self, lag: float) -> None:
        self._state.lag = lag

    def set_parameter(self, name: str, value: ParameterValue, default: ParameterValue) -> bool:
        """Keep a parameter; True if that changes anything."""
        state = self._state
        if state.parameters.get(name, default) == value:
            return False
        state.parameters.pop(name, None)
        if value != default:
            state.parameters[name] = value
        return True

    def place_piece(self, name: str, truth: Truth) -> Array | None:
        """Take in the pose of a piece; returns its motion (x, y, turn) in the world, or None when nothing is new."""
        state, piece = self._state, pieces(self.scene)[name]
        if name in truth.removed:
            if name in state.gone:
                return None
            state.gone = (*state.gone, name)
            return np.zeros(3)
        pose = next(
            ((body.position[0], body.position[1], body.yaw) for body in truth.furniture if body.name == name),
            (*piece.centre, 0.0),
        )
        before = state.furniture.get(name, (*piece.centre, 0.0))
        back = name in state.gone
        if not back and math.dist(before, pose) == 0.0:
            return None
        state.gone = tuple(gone for gone in state.gone if gone != name)
        state.furniture[name] = pose
        return relative(rigid(piece, before), rigid(piece, pose))

    def on_piece(self, name: str) -> Callable[[Array], bool]:
        """A test that a point (3,) [m], world, is on a piece as the robot knows it, or in a bin on it."""
        piece = pieces(self.scene)[name]
        now = moved_scene(self.scene, self._state.furniture, ())
        solids = [solid for solid in now.solids if solid.name in piece.solids]

        def stands(point: Array) -> bool:
            return any(
                -BELOW <= point[2] - solid.z_max <= ABOVE and float(distance_to_shape(solid.shape, point[:2])) <= BESIDE
                for solid in solids
            )

        return stands


def check_announce(scene: Scene, name: str) -> None:
    """Raise ValueError unless the map has a piece of furniture of that name."""
    known = {piece.name for piece in pieces(scene).values() if piece.mapped}
    if name in known:
        return
    if name in {solid.name for solid in scene.solids} | {solid.group for solid in scene.solids}:
        raise ValueError(f"{name!r} is not a piece of furniture of the map: the robot sees it with its lidar only")
    raise ValueError(
        f"{name!r} is not a piece of furniture, and only furniture is announced; {hint(name, sorted(known))}"
    )
