"""What a person changes in the simulated world: checked first, then applied."""

import difflib
import math
from collections.abc import Iterable, Sequence

import msgspec
import numpy as np

from motm_twin.model.edits import AddObstacle, MoveBody, ReleaseBody, RemoveBody, WorldEdit
from motm_twin.model.scene import Box, Cylinder, Scene, Solid
from motm_twin.sim.agents import AgentState

SHAPES = ("box", "cylinder", "temi")
FARTHEST = 100.0  # [m] from the origin
LARGEST = 20.0  # [m] of an obstacle


class EditError(ValueError):
    """An edit that the world cannot take; says why and what would do."""


def movable(solid: Solid) -> bool:
    """Unmapped boxes and cylinders on the floor can be dragged and removed like added obstacles."""
    return not solid.mapped and solid.z_min <= 0.0 and isinstance(solid.shape, Box | Cylinder)


def as_obstacle(solid: Solid) -> AddObstacle:
    """A movable solid of the scene as an obstacle of the same name."""
    match solid.shape:
        case Box(centre=(x, y), size=size, yaw=yaw):
            return AddObstacle(name=solid.name, shape="box", x=x, y=y, heading=yaw, size=(*size, solid.z_max))
        case Cylinder(centre=(x, y), radius=radius):
            size = (2.0 * radius, 2.0 * radius, solid.z_max)
            return AddObstacle(name=solid.name, shape="cylinder", x=x, y=y, size=size)
    raise EditError(f"{solid.name!r} is not a box or cylinder")


def check_edit(scene: Scene, obstacles: Sequence[AddObstacle], taken: Sequence[str], edit: WorldEdit) -> None:
    """Raise `EditError` unless the edit fits this scene with these obstacles and without the solids ``taken``."""
    present = {item.name for item in obstacles}
    from_scene = {solid.name for solid in scene.solids if movable(solid) and solid.name not in taken}
    agents = {agent.name for agent in scene.agents}
    if isinstance(edit, AddObstacle):
        _check_new(scene, present, edit)
    elif isinstance(edit, MoveBody | ReleaseBody):
        _known(edit.name, present | from_scene | agents, "an agent or a loose obstacle")
    else:
        _known(edit.name, present | from_scene, "a loose obstacle")
    if isinstance(edit, AddObstacle | MoveBody):
        heading = 0.0 if edit.heading is None else edit.heading
        if not all(math.isfinite(value) for value in (edit.x, edit.y, heading)):
            raise EditError(f"pose of {edit.name!r} is not finite: ({edit.x}, {edit.y}, {edit.heading})")
        if max(abs(edit.x), abs(edit.y)) > FARTHEST:
            raise EditError(f"{edit.name!r} would be at ({edit.x}, {edit.y}): stay within {FARTHEST:.0f} m")


def _check_new(scene: Scene, present: set[str], edit: AddObstacle) -> None:
    groups = (scene.solids, scene.objects, scene.bins, scene.agents)
    taken = present | {item.name for group in groups for item in group} | {"base", "floor"}
    if not edit.name or edit.name in taken:
        raise EditError(f"name {edit.name!r} is taken or empty: choose another")
    if edit.shape not in SHAPES:
        raise EditError(f"shape {edit.shape!r} is unknown: use one of {', '.join(SHAPES)}")
    if not all(math.isfinite(value) and 0.0 < value <= LARGEST for value in edit.size):
        raise EditError(f"size {edit.size} of {edit.name!r}: each must be above 0 and at most {LARGEST:.0f} m")


def _known(name: str, names: Iterable[str], kind: str) -> None:
    known = sorted(names)
    if name not in known:
        near = difflib.get_close_matches(name, known, n=3) or known
        raise EditError(f"{name!r} is not {kind}: there is {', '.join(near) if near else 'none'}")


def apply_to_obstacles(
    scene: Scene, obstacles: tuple[AddObstacle, ...], taken: tuple[str, ...], edit: WorldEdit
) -> tuple[tuple[AddObstacle, ...], tuple[str, ...]]:
    """Obstacles, and names of the scene's solids that they replace or that are gone, after an edit."""
    if isinstance(edit, AddObstacle):
        return (*obstacles, edit), taken
    if edit.name not in {item.name for item in obstacles} and not isinstance(edit, ReleaseBody):
        loose = [solid for solid in scene.solids if solid.name == edit.name and movable(solid)]
        if loose and edit.name not in taken:
            obstacles, taken = (*obstacles, as_obstacle(loose[0])), (*taken, edit.name)
    if isinstance(edit, RemoveBody):
        return tuple(item for item in obstacles if item.name != edit.name), taken
    if isinstance(edit, MoveBody):
        return tuple(_moved(item, edit) if item.name == edit.name else item for item in obstacles), taken
    return obstacles, taken


def _moved(item: AddObstacle, edit: MoveBody) -> AddObstacle:
    heading = item.heading if edit.heading is None else edit.heading
    return msgspec.structs.replace(item, x=edit.x, y=edit.y, heading=heading)


def apply_to_agent(state: AgentState, edit: MoveBody | ReleaseBody) -> None:
    """Place an agent where a person holds it, or let it drive on."""
    state.v = state.w = 0.0
    state.waiting = 0.0
    state.detour = np.zeros((0, 2))
    if isinstance(edit, ReleaseBody):
        state.held = False
        return
    heading = float(state.pose[2]) if edit.heading is None else edit.heading
    state.pose = np.array([edit.x, edit.y, heading])
    state.held = edit.held
