"""Checks of every edit of the simulated world, before it is applied."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from motm_twin.model import bounds, edits
from motm_twin.model.edits import AddObstacle, MoveObject, PushRobot, SendAgent, WorldEdit
from motm_twin.model.geometry import wrap_angle
from motm_twin.model.names import hint
from motm_twin.model.rvo import require_pyrvo
from motm_twin.sim.bodies import Outline, disc_outline, put_down, robot_outline, square_outline
from motm_twin.sim.kernels import entered, gaps
from motm_twin.sim.layout import STILL, STILL_TURN, Furnishings, Scenery
from motm_twin.sim.objects import ObjectState, riders
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.slides import Obstruction
from motm_twin.sim.solids import NOTHING

MOST_BODIES = 100  # that persons may add
_PUSH_LOOKS = 10  # poses checked along a push
_TOUCHED = 0.01  # [m] about a point that must be free of others
_QUOTED = 40  # characters of a wrong name that are quoted


class EditError(ValueError):
    """An edit that the world cannot take; says why and what would do."""


def check_edit(furnishings: Furnishings, state: PlantState, scenery: Scenery, edit: WorldEdit) -> None:
    """Raise `EditError` unless the world can take the edit as it stands; ``scenery`` is that of the state's layout."""
    if problem := bounds.problem(edit):
        raise EditError(problem)
    agents = [item.agent.name for item in state.agents]
    match edit:
        case edits.MoveBody() | edits.ReleaseBody() | edits.RemoveBody():
            bodies = [*agents, *(item.name for item in state.layout.obstacles), *furnishings.present(state.layout)]
            _require(edit.name, bodies, "an agent, a loose obstacle or a piece of furniture")
        case edits.FreezeBody() | edits.SendAgent() | edits.SetBehaviour():
            _require(edit.name, agents, "an agent")
        case MoveObject():
            _require(edit.name, [item.name for item in state.objects], "an object")
    match edit:
        case AddObstacle():
            _check_new(furnishings, state, edit)
        case SendAgent():
            _check_goal(state, scenery, edit)
        case edits.SetBehaviour(behaviour="orca"):
            require_pyrvo(EditError)
        case edits.RemoveBody() if edit.name in furnishings.pieces:
            _check_unburdened(furnishings, state, scenery, edit.name)
        case MoveObject():
            _check_free(furnishings, state, scenery, edit)
        case PushRobot():
            _check_push(furnishings, state, scenery, edit)


def _require(name: str, names: Iterable[str], kind: str) -> None:
    """Raise `EditError` for an unknown name; says which were meant, or all."""
    known = sorted(names)
    if name not in known:
        raise EditError(f"{_quoted(name)} is not {kind} here; {hint(name, known)}")


def _quoted(name: str) -> str:
    return repr(name if len(name) <= _QUOTED else name[:_QUOTED] + "...")


def _check_new(furnishings: Furnishings, state: PlantState, edit: AddObstacle) -> None:
    scene, layout = furnishings.scene, state.layout
    groups = (scene.solids, scene.objects, scene.bins, scene.agents, layout.obstacles)
    taken = {item.name for group in groups for item in group} | {item.agent.name for item in state.agents}
    if edit.name in taken | {*furnishings.pieces, "base", "floor"}:
        raise EditError(f"name {_quoted(edit.name)} is taken: choose another")
    if len(layout.obstacles) + sum(item.added for item in state.agents) >= MOST_BODIES:
        raise EditError(f"there are {MOST_BODIES} added bodies already: remove one first")


def _check_goal(state: PlantState, scenery: Scenery, edit: SendAgent) -> None:
    agent = state.agent(edit.name)
    assert agent is not None
    height = agent.agent.height
    body = disc_outline(edit.x, edit.y, _TOUCHED, height)
    if inside := Obstruction(scenery.solids, (), height=height).inside(body):
        raise EditError(f"{edit.name!r} cannot go to ({edit.x:.2f}, {edit.y:.2f}): {inside!r} stands there")


def _check_unburdened(furnishings: Furnishings, state: PlantState, scenery: Scenery, name: str) -> None:
    piece = furnishings.pieces[name]
    cubes = [item.name for item in riders(state.objects, scenery.solids, {*piece.solids, *piece.bins})]
    burden = [*piece.bins, *cubes]
    if burden:
        *others, last = burden
        standing = f"{', '.join(others)} and {last} stand" if others else f"{last} stands"
        raise EditError(f"{name!r} cannot be removed: {standing} on it; furniture must be empty to go")


def _check_free(furnishings: Furnishings, state: PlantState, scenery: Scenery, edit: MoveObject) -> None:
    item, _ = put_down(state.objects, scenery.solids, edit)
    body, bottom = square_outline(item), item.bottom
    others = [other for other in state.objects if other.name != edit.name and _level(other, item)]
    in_a_cube = _first_inside(body, [square_outline(other) for other in others], [other.name for other in others])
    if in_a_cube:
        raise EditError(f"{edit.name!r} would be inside {in_a_cube!r}: choose a free place")
    agents = [other for other in state.agents if other.agent.height > bottom]
    if inside := Obstruction(NOTHING, agents, height=0.0).inside(body):
        raise EditError(f"{edit.name!r} would be inside {inside!r}: choose a free place")
    foot = furnishings.scene.robot.footprint
    if bottom < foot.height and _first_inside(body, [robot_outline(foot, state.base.pose)], ["robot"]):
        raise EditError(f"{edit.name!r} would be inside the robot's base: choose a free place")


def _level(other: ObjectState, item: ObjectState) -> bool:
    return abs(other.position[2] - item.position[2]) < 0.5 * (other.side + item.side) - 1e-6


def _first_inside(body: Outline, rectangles: Sequence[Outline], names: Sequence[str]) -> str:
    corners = np.vstack([np.zeros((0, 2)), *(one.corners for one in rectangles)])
    first = 4 * np.arange(len(names) + 1)
    inside = np.flatnonzero(gaps(body.corners, body.radius, corners, first, np.zeros((0, 3))) < -1e-9)
    return names[int(inside[0])] if len(inside) else ""


def _check_push(furnishings: Furnishings, state: PlantState, scenery: Scenery, edit: PushRobot) -> None:
    if math.hypot(edit.dx, edit.dy) < STILL and abs(edit.turn) < STILL_TURN:
        raise EditError(
            f"push of {1000.0 * math.hypot(edit.dx, edit.dy):g} mm and {edit.turn:g} rad moves nothing: "
            f"a push needs at least {1000.0 * STILL:g} mm or {STILL_TURN:g} rad"
        )
    foot = furnishings.scene.robot.footprint
    world = Obstruction(scenery.solids, state.agents, height=foot.height)
    before = world.gaps(robot_outline(foot, state.base.pose))
    for k in range(1, _PUSH_LOOKS + 1):
        after = world.gaps(robot_outline(foot, pushed_pose(state, edit, k / _PUSH_LOOKS)))
        hit = entered(before, after)
        if len(hit):
            name = world.names[int(hit[after[hit].argmin()])]
            raise EditError(f"the push would drive the base into {name!r}: push it less far or another way")
        before = after


def pushed_pose(state: PlantState, edit: PushRobot, share: float = 1.0) -> np.ndarray:
    """Pose of the base after a share of a push, shape (3,)."""
    x, y, heading = state.base.pose
    return np.array([x + share * edit.dx, y + share * edit.dy, wrap_angle(heading + share * edit.turn)])
