"""Checks of every edit of the simulated world, before it is applied."""

import math
from collections.abc import Iterable, Sequence

import numpy as np

from motm_twin.model import bounds
from motm_twin.model.edits import (
    AddObstacle,
    FreezeBody,
    MoveBody,
    MoveObject,
    PushRobot,
    ReleaseBody,
    RemoveBody,
    SendAgent,
    SetBehaviour,
    WorldEdit,
)
from motm_twin.model.geometry import wrap_angle
from motm_twin.model.names import hint
from motm_twin.model.rvo import require_pyrvo
from motm_twin.sim.bodies import Outline, disc_outline, put_down, robot_outline, square_outline
from motm_twin.sim.kernels import entered, gaps
from motm_twin.sim.layout import STILL, STILL_TURN, Furnishings, Scenery
from motm_twin.sim.objects import riders
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
    names = Names(furnishings, state)
    match edit:
        case AddObstacle():
            _check_new(furnishings, state, edit)
        case MoveBody() | ReleaseBody():
            names.require(edit.name, names.bodies)
        case FreezeBody():
            names.require(edit.name, names.agents, "an agent")
        case SendAgent():
            names.require(edit.name, names.agents, "an agent")
            _check_goal(state, scenery, edit)
        case SetBehaviour():
            names.require(edit.name, names.agents, "an agent")
            if edit.behaviour == "orca":
                require_pyrvo(EditError)
        case RemoveBody():
            names.require(edit.name, names.bodies)
            if edit.name in furnishings.pieces:
                _check_unburdened(furnishings, state, scenery, edit.name)
        case MoveObject():
            names.require(edit.name, [item.name for item in state.objects], "an object")
            _check_free(furnishings, state, scenery, edit)
        case PushRobot():
            _check_push(furnishings, state, scenery, edit)


class Names:
    """Names of the bodies in the world now."""

    def __init__(self, furnishings: Furnishings, state: PlantState) -> None:
        """Agents, obstacles, loose solids and pieces that are there."""
        layout = state.layout
        self.agents = [item.agent.name for item in state.agents]
        obstacles = [item.name for item in layout.obstacles]
        pieces = furnishings.present_pieces(layout)
        self.bodies = [*self.agents, *obstacles, *furnishings.present_loose(layout), *pieces]

    @staticmethod
    def require(
        name: str, names: Iterable[str], kind: str = "an agent, a loose obstacle or a piece of furniture"
    ) -> None:
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
    agent = next(item.agent for item in state.agents if item.agent.name == edit.name)
    world = Obstruction(scenery.solids, (), height=agent.height)
    found = world.gaps(disc_outline(edit.x, edit.y, _TOUCHED, agent.height))
    if len(found) and found.min() < 0.0:
        inside = world.names[int(found.argmin())]
        raise EditError(f"{edit.name!r} cannot go to ({edit.x:.2f}, {edit.y:.2f}): {inside!r} stands there")


def _check_unburdened(furnishings: Furnishings, state: PlantState, scenery: Scenery, name: str) -> None:
    piece = furnishings.pieces[name]
    cubes = [item.name for item in riders(state.objects, scenery.solids, {*piece.solids, *piece.bins})]
    burden = [*piece.bins, *cubes]
    if burden:
        verb = "stands" if len(burden) == 1 else "stand"
        raise EditError(f"{name!r} cannot be removed: {_listed(burden)} {verb} on it; furniture must be empty to go")


def _listed(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"


def _check_free(furnishings: Furnishings, state: PlantState, scenery: Scenery, edit: MoveObject) -> None:
    item, _ = put_down(state.objects, scenery.solids, edit)
    body, bottom = square_outline(item), item.bottom
    others = [other for other in state.objects if other.name != edit.name]
    touching = [
        other for other in others if abs(other.position[2] - item.position[2]) < _overlap(other.side, item.side)
    ]
    corners = np.vstack([np.zeros((0, 2)), *(square_outline(other).corners for other in touching)])
    in_a_cube = _first_inside(body, corners, [other.name for other in touching])
    if in_a_cube:
        raise EditError(f"{edit.name!r} would be inside {in_a_cube!r}: choose a free place")
    agents = [other for other in state.agents if other.agent.height > bottom]
    world = Obstruction(NOTHING, agents, height=0.0)
    found = world.gaps(body)
    if len(found) and found.min() < 0.0:
        raise EditError(f"{edit.name!r} would be inside {world.names[int(found.argmin())]!r}: choose a free place")
    foot = furnishings.scene.robot.footprint
    if bottom < foot.height and _first_inside(body, robot_outline(foot, state.base.pose).corners, ["robot"]):
        raise EditError(f"{edit.name!r} would be inside the robot's base: choose a free place")


def _overlap(side: float, other: float) -> float:
    return 0.5 * (side + other) - 1e-6


def _first_inside(body: Outline, corners: np.ndarray, names: Sequence[str]) -> str:
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
