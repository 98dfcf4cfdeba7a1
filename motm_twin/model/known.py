"""The robot's prior knowledge: the pre-made map, the task, and rough object positions.

Control reads this, never the `Scene`: unmapped furniture and true object positions are not in it.
"""

import math

import msgspec
import numpy as np

from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Bin, PlanarPose, Scene, SceneObject, Solid, Task
from motm_twin.model.scene_shapes import bin_solid, covers, moved_bin, moved_object, moved_solid

STANDS_WITHIN = 0.005  # [m] an object stands on a solid when its lower face is this near to the top
_RNG_MAP = 0x3A90FF


class KnownWorld(msgspec.Struct, frozen=True, kw_only=True):
    """The robot's prior knowledge of a scene."""

    robot: RobotProfile
    start: PlanarPose
    solids: tuple[Solid, ...]  # mapped furniture with true heights
    objects: tuple[SceneObject, ...]  # believed positions, with errors of slot_error_until_seen
    object_sd: float  # [m] per axis
    bins: tuple[Bin, ...]
    tasks: tuple[Task, ...]
    bounds: tuple[float, float, float, float]


def known_solids(known: KnownWorld) -> tuple[Solid, ...]:
    """All solids that the robot knows, bins included: every map of the robot is made from this list."""
    return (*known.solids, *(bin_solid(place) for place in known.bins))


def known_world(scene: Scene) -> KnownWorld:
    """The prior knowledge of a scene; belief errors are drawn from the scene's seed."""
    rng = np.random.default_rng([scene.seed, 0x0B7EC7])
    sd = scene.noise.slot_error_until_seen
    believed = []
    for item in scene.objects:
        dx, dy = np.clip(rng.normal(0.0, 1.0, 2), -2.5, 2.5) * sd
        x, y, z = item.position
        believed.append(msgspec.structs.replace(item, position=(x + dx, y + dy, z)))
    known = KnownWorld(
        robot=scene.robot,
        start=scene.start,
        solids=tuple(solid for solid in scene.solids if solid.mapped),
        objects=tuple(believed),
        object_sd=sd,
        bins=scene.bins,
        tasks=scene.tasks,
        bounds=scene.bounds,
    )
    if scene.mismatch.table_height:
        known = _tables_lower(known, scene)
    return _map_off(known, scene) if scene.mismatch.map_offset else known


def _tables_lower(known: KnownWorld, scene: Scene) -> KnownWorld:
    """Mismatch: supports of objects, and the objects, are lower in the map than in reality."""
    lower, replace = scene.mismatch.table_height, msgspec.structs.replace
    solids = [
        replace(one, z_max=one.z_max - lower, z_min=max(0.0, one.z_min - lower))
        if any(carries(one, item) for item in scene.objects)
        else one
        for one in known.solids
    ]
    objects = [replace(one, position=(*one.position[:2], one.position[2] - lower)) for one in known.objects]
    return replace(known, solids=tuple(solids), objects=tuple(objects))


def carries(solid: Solid, item: SceneObject) -> bool:
    """True when an object stands on this solid."""
    on_top = abs(item.position[2] - 0.5 * item.side - solid.z_max) < STANDS_WITHIN
    return on_top and covers(solid.shape, item.position[:2])


def _map_off(known: KnownWorld, scene: Scene) -> KnownWorld:
    """Mismatch: furniture, bins and believed objects are offset from reality by the same vector."""
    angle = np.random.default_rng([scene.seed, _RNG_MAP]).uniform(-math.pi, math.pi)
    off = scene.mismatch.map_offset * np.array([math.cos(angle), math.sin(angle), 0.0])
    return msgspec.structs.replace(
        known,
        solids=tuple(moved_solid(off, one) for one in known.solids),
        objects=tuple(moved_object(off, one) for one in known.objects),
        bins=tuple(moved_bin(off, one) for one in known.bins),
    )
