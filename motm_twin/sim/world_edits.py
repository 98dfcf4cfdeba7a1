"""Edits of the simulated world: checked, then applied between substeps; waiting edits are tried on a copy."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.model import bounds, edits
from motm_twin.model.arm_kernels import HAND, TCP
from motm_twin.model.edits import (
    AddObstacle,
    FreezeBody,
    MoveBody,
    MoveObject,
    PushRobot,
    SendAgent,
    SetBehaviour,
    WorldEdit,
)
from motm_twin.model.geometry import wrap_angle
from motm_twin.model.names import hint
from motm_twin.model.rvo import require_pyrvo
from motm_twin.model.scene import Agent
from motm_twin.sim.agents import AgentState, start_agent
from motm_twin.sim.bodies import (
    FASTEST,
    Obstruction,
    Outline,
    added_agent,
    capped,
    disc_outline,
    placed,
    robot_outline,
    square_outline,
)
from motm_twin.sim.faults import inject
from motm_twin.sim.gripper import Gripper
from motm_twin.sim.kernels import entered, gaps
from motm_twin.sim.mechanics import Frames
from motm_twin.sim.objects import ObjectState, ObjectWorld, carry, put_down, riders
from motm_twin.sim.plant_state import PlantState
from motm_twin.sim.responsibility import Shift
from motm_twin.sim.sensors import Localisation
from motm_twin.sim.solids import NOTHING, STILL, STILL_TURN, Furnishings, Scenery, as_obstacle, build_scenery, same_pose

MOST_BODIES = 100  # bodies that persons may add
_PUSH_LOOKS = 10  # poses checked along a push
_TOUCHED = 0.01  # [m] about a point that must be free of others
_QUOTED = 40  # characters of a wrong name that are quoted


class EditError(ValueError):
    """An edit that the world refuses; tells the reason and a remedy."""


def check_edit(furnishings: Furnishings, state: PlantState, scenery: Scenery, edit: WorldEdit) -> None:
    """Raise `EditError` unless the world in its present state accepts the edit; ``scenery``: of the state's layout."""
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
    """Raise `EditError` for an unknown name; names the similar ones, or all."""
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


SLOWEST_THROW = 0.05  # [m/s] below which a released body just stands


@dataclass
class Effect:
    """Effect of an edit, for the referee."""

    moved: dict[str, Shift] = field(default_factory=dict)  # solids, bins and agents moved by more than jitter
    disturbed: tuple[str, ...] = ()  # objects that lie or fall because of a person
    pushed: bool = False  # the robot was pushed


class Effects:
    """Applies edits to the state of one plant."""

    def __init__(self, furnishings: Furnishings, objects: ObjectWorld, frames: Frames, substep: float) -> None:
        """Furniture of the scene, support of objects, kinematics; substep [s]."""
        self.furnishings, self.frames, self.substep = furnishings, frames, substep
        self.objects = objects

    def apply(self, state: PlantState, scenery: Scenery, edit: edits.WorldEdit) -> tuple[Effect, Scenery]:
        """Apply a checked edit to the state; returns its effect and the new scenery."""
        effect = Effect()
        match edit:
            case AddObstacle():
                kind = self._add(state, edit)
                effect.moved = {edit.name: Shift(None, (edit.x, edit.y, edit.heading), kind)}
            case MoveBody():
                effect.moved = self._move(state, scenery, edit)
            case edits.ReleaseBody():
                self._release(state, edit)
            case FreezeBody() | SendAgent() | SetBehaviour():
                _direct(state.agent(edit.name), edit)
            case edits.RemoveBody():
                effect.moved = self._remove(state, edit.name)
            case MoveObject():
                self._put(state, scenery, edit)
                effect.disturbed = (edit.name,)
            case PushRobot():
                self._push(state, edit)
                effect.pushed = True
            case edits.InjectFault():
                inject(state.faults, edit, state.substep, self.substep, self.furnishings.scene.seed)
        scenery = self.scenery(state, scenery)
        effect.disturbed += self._fall(state, scenery)
        return effect, scenery

    def scenery(self, state: PlantState, known: Scenery | None = None) -> Scenery:
        """The scenery of a state; ``known`` while it is still valid."""
        tallest = max((item.agent.height for item in state.agents), default=0.0)
        if known is not None and known.tallest == tallest and known.layout == state.layout:
            return known
        return build_scenery(self.furnishings, state.layout, tallest)

    def _fall(self, state: PlantState, scenery: Scenery) -> tuple[str, ...]:
        """Let unsupported objects fall."""
        loose = [item for item in state.objects if item.state not in ("held", "falling")]
        for item in loose:
            self.objects.check_support(item, state.objects, scenery.solids)
        return tuple(item.name for item in loose if item.state == "falling")

    @staticmethod
    def _add(state: PlantState, edit: AddObstacle) -> tuple[float | str, ...]:
        """Add an obstacle or agent; returns its shape and size."""
        agent = added_agent(edit)
        if agent is None:
            state.layout = state.layout.with_obstacle(edit)
            return (edit.shape, *edit.size)
        ranks = {item.rank for item in state.agents}
        rank = next(k for k in range(len(ranks) + 1) if k not in ranks)
        state.agents.append(start_agent(agent, rank, added=True))
        return _kind(agent)

    def _move(self, state: PlantState, scenery: Scenery, edit: MoveBody) -> dict[str, Shift]:
        """Move a body; returns the displacements of its solids and bins, or of the agent."""
        state.slides.pop(edit.name, None)
        agent, name, item = state.agent(edit.name), edit.name, None
        if agent is not None:
            before = tuple(agent.pose.tolist())
        elif name in self.furnishings.pieces:
            before = self.furnishings.pose(state.layout, name)
        else:
            item = self.loosened(state, name)
            before = (item.x, item.y, item.heading)
        after = (edit.x, edit.y, before[2] if edit.heading is None else wrap_angle(edit.heading))
        if agent is not None:
            agent.pose, agent.held = np.array(after, dtype=float), edit.held
            agent.stop()
        elif item is not None:
            state.layout = state.layout.with_obstacle(placed(item, *after))
        elif before != after:
            state.layout = self.furnishings.moved(state.layout, name, after)
        if agent is None and before != after:
            riding = riders(state.objects, scenery.solids, self.furnishings.parts(name))
            carry(riding, np.array(before, dtype=float), np.array(after, dtype=float))
        here, there = _floats(before), _floats(after)
        parts = () if same_pose(here, there) else self.furnishings.parts(name)
        return dict.fromkeys(parts, Shift(here, there))

    def loosened(self, state: PlantState, name: str) -> AddObstacle:
        """The obstacle of this name; a loose solid of the scene is turned into one."""
        item = state.layout.obstacle(name)
        if item is None:
            item = as_obstacle(self.furnishings.loose[name])
            state.layout = msgspec.structs.replace(state.layout.with_obstacle(item), taken=(*state.layout.taken, name))
        return item

    def _release(self, state: PlantState, edit: edits.ReleaseBody) -> None:
        agent = state.agent(edit.name)
        if agent is not None:
            agent.held = False
            agent.stop()
        if edit.name in self.furnishings.pieces or math.hypot(*edit.velocity) < SLOWEST_THROW:
            return  # furniture is too heavy to be thrown
        if agent is None:
            self.loosened(state, edit.name)
        state.slides[edit.name] = capped(edit.velocity, FASTEST)

    def _remove(self, state: PlantState, name: str) -> dict[str, Shift]:
        """Remove a body; returns the displacement of an agent or obstacle, which a person may add again."""
        layout, agent, gone = state.layout, state.agent(name), {}
        if agent is not None:
            gone[name] = Shift(_floats(agent.pose), None, _kind(agent.agent))
        item = layout.obstacle(name)
        if item is not None:
            gone[name] = Shift((item.x, item.y, item.heading), None, (item.shape, *item.size))
        state.slides.pop(name, None)
        added = [item.agent.name for item in state.agents if item.added]
        added += [item.name for item in layout.obstacles if item.name not in layout.taken]
        state.agents = [item for item in state.agents if item.agent.name != name]
        state.layout = msgspec.structs.replace(
            layout,
            obstacles=tuple(item for item in layout.obstacles if item.name != name),
            removed=layout.removed if name in added else (*layout.removed, name),
        )
        return gone

    @staticmethod
    def _put(state: PlantState, scenery: Scenery, edit: MoveObject) -> None:
        item, _ = put_down(state.objects, scenery.solids, edit)
        state.objects = [item if old.name == item.name else old for old in state.objects]
        Gripper.lose(state.gripper, edit.name)

    def _push(self, state: PlantState, edit: PushRobot) -> None:
        state.base.pose = pushed_pose(state, edit)
        frames = self.frames(state.base.pose, state.arm.q)
        state.tcp = frames[TCP, :3, 3].copy()
        for item in state.objects:
            if item.name == state.gripper.held:
                Gripper.hold(state.gripper, frames[TCP, :3, :3], frames[HAND, :3, 3], item)
        Localisation.relocate(state.localisation, state.base.pose)


def _kind(agent: Agent) -> tuple[float | str, ...]:
    return ("agent", agent.radius, agent.height)


def _floats(pose: Iterable[float]) -> tuple[float, float, float]:
    x, y, heading = (float(value) for value in pose)
    return x, y, heading


def _direct(agent: AgentState | None, edit: FreezeBody | SendAgent | SetBehaviour) -> None:
    """Give an agent an order; it stands still until its next look."""
    assert agent is not None
    match edit:
        case FreezeBody(frozen=frozen):
            agent.frozen = frozen
        case SendAgent(x=x, y=y):
            agent.errand, agent.frozen = (x, y), False
        case SetBehaviour(behaviour=behaviour):
            agent.agent = msgspec.structs.replace(agent.agent, behaviour=behaviour)
    agent.stop()


class Rehearsal:
    """Accepted edits tried on a copy of a paused world. Invalid once that world has changed or moved on."""

    def __init__(self, effects: Effects, state: PlantState, scenery: Scenery) -> None:
        """The state is copied when the first edit is tried."""
        self._effects, self._state, self._scenery = effects, state, scenery
        self._copied = False
        self._due: edits.WorldEdit | None = None  # accepted last: tried only when another one follows

    def accept(self, edit: edits.WorldEdit) -> None:
        """Accept an edit after the earlier ones. Raises ValueError when the world refuses it."""
        self._catch_up()
        check_edit(self._effects.furnishings, self._state, self._scenery, edit)
        self._due = edit

    def _catch_up(self) -> None:
        if self._due is None:
            return
        if not self._copied:
            self._state, self._copied = self._state.rehearsal(), True
        edit, self._due = self._due, None
        _, self._scenery = self._effects.apply(self._state, self._scenery, edit)
