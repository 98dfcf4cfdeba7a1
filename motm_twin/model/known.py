"""What the robot knows before it starts: the pre-made map, the task, and a rough idea of where objects are.

Control reads this, never the `Scene`: unmapped furniture and true object positions are not in it.
"""

import msgspec
import numpy as np

from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Bin, PlanarPose, Scene, SceneObject, Solid, Task
from motm_twin.model.scene_shapes import bin_solid


class KnownWorld(msgspec.Struct, frozen=True, kw_only=True):
    """The robot's prior knowledge of a scene."""

    robot: RobotProfile
    start: PlanarPose
    solids: tuple[Solid, ...]  # mapped furniture with true heights
    objects: tuple[SceneObject, ...]  # believed positions, wrong by slot_error_until_seen
    object_sd: float  # [m] per axis
    bins: tuple[Bin, ...]
    tasks: tuple[Task, ...]
    bounds: tuple[float, float, float, float]


def known_solids(known: KnownWorld) -> tuple[Solid, ...]:
    """Everything solid that the robot knows of, bins included: the one list that every map of it is made from."""
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
    return KnownWorld(
        robot=scene.robot,
        start=scene.start,
        solids=tuple(solid for solid in scene.solids if solid.mapped),
        objects=tuple(believed),
        object_sd=sd,
        bins=scene.bins,
        tasks=scene.tasks,
        bounds=scene.bounds,
    )
