"""Picking: things under the pointer, and the meaning of a click on them.

The first thing along a ray from the eye is found by geometry, so small things can be hit too. Viser could tell which
node is clicked, but then outlines every clickable one in yellow, reports a click on a body to the ground as well, and
needs a hit on the pixel, which a finger misses.
"""

import asyncio
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
import viser
from numpy.typing import NDArray

from motm_twin.bus.commands import Command
from motm_twin.bus.messages import BodyMessage, PlacementMessage, TaskMessage, TickMessage
from motm_twin.control.task_list import name_of
from motm_twin.model.edits import InsertTask, MoveBody, RemoveTask, SendAgent
from motm_twin.model.geometry import Array
from motm_twin.model.scene import DriveTo, Pick, Place, PlanarPose, Scene
from motm_twin.model.scene_shapes import moved_scene, outline, pieces, rectangle
from motm_twin.ui.hub import PLACES, Hub, Visitor

SELECTABLE = ("object", "bin", "body", "piece")
SLACK, SLACK_LEAST = 0.006, 0.015  # [rad], [m] by which a click may miss a small thing: some seven pixels on a laptop
CANDIDATE_HEIGHT = 0.035  # [m]
CANDIDATES, RING = 192, 72  # most that are drawn; of these on the smallest ring, drawn even when rejected
SAME_PLACE = 0.4  # [m] a second click this near to the proposed place confirms it
_ROBOT = ((0.36, 0.0, 0.4), (0.2, 0.4, 1.0))  # radius, lower and upper end [m] of base and arm
_NO_HIT = math.inf
_Prism = tuple[str, str, shapely.Polygon, float, float]  # kind, name, outline [m], lower and upper end [m]


@dataclass(frozen=True)
class Ray:
    """A ray from the eye through the pointer; ``direction`` has length 1."""

    origin: Array
    direction: Array

    @classmethod
    def through(cls, eye: Iterable[float], point: Iterable[float]) -> "Ray":
        """The ray from the eye through a point."""
        origin = np.asarray(tuple(eye), dtype=float)
        direction = np.asarray(tuple(point), dtype=float) - origin
        return cls(origin, direction / np.linalg.norm(direction))

    def at(self, distance: float) -> Array:
        """The point [m] at a distance."""
        return self.origin + distance * self.direction


@dataclass(frozen=True)
class Hit:
    """The first thing along a ray."""

    kind: str  # candidate | object | bin | body | piece | robot | fixed | floor
    name: str
    point: Array  # [m]
    distance: float  # [m]
    index: int = -1  # of a candidate


class Surroundings:
    """A scene with its furniture at the places of a tick."""

    def __init__(self, scene: Scene) -> None:
        self._scene, self.pieces = scene, pieces(scene)
        self._owner = {part: piece.name for piece in self.pieces.values() for part in piece.solids}
        self._key: tuple | None = None
        self.now = scene

    def update(self, tick: TickMessage) -> None:
        """Take the places of furniture from a tick."""
        moved = furniture_poses(tick)
        gone = tuple(name for name in tick.removed if name in self.pieces)
        key = (tuple(moved.items()), gone)
        if key != self._key:
            self._key = key
            self.now = moved_scene(self._scene, moved, gone)
            self._prisms: list[_Prism] = []
            for box in self.now.bins:
                shape = rectangle((*box.centre, box.yaw), (box.side, box.side))
                self._prisms.append(("bin", box.name, shape, box.floor_z, box.rim_z))
            for solid in self.now.solids:
                owner = self._owner.get(solid.name, "")
                kind = "piece" if owner else "fixed"
                self._prisms.append((kind, owner, outline(solid.shape), solid.z_min, solid.z_max))

    def first(self, ray: Ray, tick: TickMessage, *, candidates: bool) -> Hit | None:
        """The first thing along a ray; candidates only when they are shown."""
        solid = self.solid(ray, tick)
        behind = self.solid(ray, tick, bins=False)  # bins are open: their contents are visible
        limit = _NO_HIT if behind is None else behind.distance
        small = [_object(ray, item) for item in tick.objects]
        if candidates:
            small.append(_candidate(ray, tick))
        near = [hit for hit in small if hit is not None and hit.distance < limit + 0.08]
        return min(near, key=lambda hit: hit.distance) if near else solid

    def solid(self, ray: Ray, tick: TickMessage, *, bins: bool = True) -> Hit | None:
        """The first body, piece, fixed solid or floor along a ray; small things are left out."""
        prisms = [prism for prism in self._prisms if bins or prism[0] != "bin"]
        for body in (*tick.agents, *tick.obstacles):
            prisms.append(("body", body.name, body_outline(body), 0.0, body.size[2] or 1.0))
        place = shapely.Point(tick.robot.true_pose[:2])
        for radius, low, high in _ROBOT:
            prisms.append(("robot", "", place.buffer(radius, quad_segs=6), low, high))
        found = [(_distance(ray, shape, low, high), kind, name) for kind, name, shape, low, high in prisms]
        found.append((_plane(ray, 0.0), "floor", ""))
        distance, kind, name = min(found, key=lambda entry: entry[0])
        return None if distance == _NO_HIT else Hit(kind, name, ray.at(distance), distance)

    def surface(self, ray: Ray) -> Array | None:
        """Point [m] for a cube: where a ray meets furniture, a bin's floor or the ground from above."""
        best = _plane(ray, 0.0)
        for kind, _, shape, low, high in self._prisms:
            best = min(best, _plate(ray, shape, low if kind == "bin" else high))
        return None if best == _NO_HIT else ray.at(best)


def drawn_candidates(placement: PlacementMessage) -> NDArray[np.int64]:
    """Indices of the candidates that are drawn and can be clicked: possible ones, and all of the smallest ring."""
    possible = np.array([not reason for reason in placement.rejected], dtype=bool)
    shown = np.flatnonzero(possible | (np.arange(len(possible)) < RING))
    return shown if len(shown) <= CANDIDATES else np.union1d(shown[: CANDIDATES - 1], [max(placement.chosen, 0)])


def _candidate(ray: Ray, tick: TickMessage) -> Hit | None:
    if not tick.placement.poses:
        return None
    drawn = drawn_candidates(tick.placement)
    places = np.asarray(tick.placement.poses)[drawn, :2]
    centres = np.column_stack([places, np.full(len(drawn), CANDIDATE_HEIGHT)])
    along = (centres - ray.origin) @ ray.direction
    aside = np.linalg.norm(centres - ray.origin - along[:, None] * ray.direction, axis=1)
    missed = aside - 0.03 - np.maximum(SLACK_LEAST, SLACK * along)
    index = int(np.argmin(np.where(along > 0.0, missed, _NO_HIT)))
    if along[index] <= 0.0 or missed[index] > 0.0:
        return None
    return Hit("candidate", "", centres[index], float(along[index]), int(drawn[index]))


def _object(ray: Ray, item: BodyMessage) -> Hit | None:
    centre = np.asarray(item.position)
    along = float((centre - ray.origin) @ ray.direction)
    aside = float(np.linalg.norm(centre - ray.at(along)))
    if along <= 0.0 or aside > 0.6 * item.size[0] + max(SLACK_LEAST, SLACK * along):
        return None
    return Hit("object", item.name, centre, along - 0.6 * item.size[0])


def _plane(ray: Ray, height: float) -> float:
    if ray.direction[2] > -1e-6:
        return _NO_HIT
    return max(0.0, float((height - ray.origin[2]) / ray.direction[2]))


def _plate(ray: Ray, shape: shapely.Polygon, height: float) -> float:
    distance = _plane(ray, height)
    if distance == _NO_HIT or ray.origin[2] <= height:
        return _NO_HIT
    return distance if shapely.contains_xy(shape, *ray.at(distance)[:2]) else _NO_HIT


def _distance(ray: Ray, shape: shapely.Polygon, low: float, high: float) -> float:
    """Distance [m] to an upright prism, infinite when it is missed."""
    best = _plate(ray, shape, high)
    corners = shapely.get_coordinates(shape.exterior)
    start, edge = corners[:-1], np.diff(corners, axis=0)
    offset, flat = start - ray.origin[:2], ray.direction[:2]
    cross = flat[0] * edge[:, 1] - flat[1] * edge[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        along = (offset[:, 0] * edge[:, 1] - offset[:, 1] * edge[:, 0]) / cross
        part = (offset[:, 0] * flat[1] - offset[:, 1] * flat[0]) / cross
    height = ray.origin[2] + along * ray.direction[2]
    met = (np.abs(cross) > 1e-12) & (along > 0.0) & (part >= 0.0) & (part <= 1.0) & (height >= low) & (height <= high)
    return min(best, float(along[met].min())) if met.any() else best


def furniture_poses(tick: TickMessage) -> dict[str, PlanarPose]:
    """Poses x, y [m] and heading [rad] of the pieces that are not at home, by name."""
    return {body.name: (body.position[0], body.position[1], body.yaw) for body in tick.furniture}


def body_outline(body: BodyMessage) -> shapely.Polygon:
    """Outline [m] of a body on the floor."""
    x, y = body.position[:2]
    if body.kind == "box":
        return rectangle((x, y, body.yaw), (body.size[0], body.size[1]))
    return shapely.Point(x, y).buffer(body.size[0] / 2, quad_segs=6)


class Clicks:
    """Turns clicks into choices and commands. An orbit drag is no click: the page tells them apart by motion.

    A click on a candidate shows its costs and paths, or hides them. A click on a body, a piece of furniture, a bin or a
    cube selects it, or deselects it; a cube stays selected, because a click on a bin after a cube delivers the cube
    there. A click on the floor puts a body that was just added there, sends an agent there, or deselects. Otherwise it
    proposes a drive there, which a second click confirms. Any click takes the lease if it is free.
    """

    def __init__(self, server: viser.ViserServer, hub: Hub) -> None:
        self._hub = hub
        self.surroundings: Surroundings | None = None
        self.tick: TickMessage | None = None
        server.scene.on_click()(hub.watching(self._click))

    async def _click(self, event: viser.SceneClickEvent, visitor: Visitor) -> None:
        if self.surroundings is None or self.tick is None:
            return
        hub, view, tick = self._hub, self._hub.view, self.tick
        if not hub.drives(visitor):
            hub.tell(visitor, hub.refusal(visitor), "Only looking")
            return
        hub.keep_wheel(visitor)
        ray = Ray.through(event.ray_origin, np.add(event.ray_origin, event.ray_direction))
        aiming = bool(view.sending or view.placing)  # at the floor: candidates there are ignored
        hit = self.surroundings.first(ray, tick, candidates=PLACES not in visitor.hidden and not aiming)
        kind = "" if hit is None else hit.kind
        if kind != "floor":
            view.aim_at_nothing()
        if hit is None or kind in ("robot", "fixed"):
            view.selected = ""
        elif kind == "candidate":
            view.picked = None if view.picked == hit.index else hit.index
            hub.inspect()
        elif kind == "bin" and any(item.name == view.selected for item in tick.objects):
            await self._deliver(visitor, tick, view.selected, hit.name)
        elif kind in SELECTABLE:
            view.selected = "" if view.selected == hit.name and kind != "object" else hit.name
        else:
            await self._floor(visitor, round(float(hit.point[0]), 3), round(float(hit.point[1]), 3))

    async def _deliver(self, visitor: Visitor, tick: TickMessage, cube: str, box: str) -> None:
        before = (waiting_job(tick.tasks, cube) or (0, ""))[1]
        for command in delivery(tick.tasks, cube, box):
            if not await self._order(visitor, command):
                return
        self._hub.view.selected = ""
        if before == box:
            self._hub.tell(visitor, f"{cube} goes to {box} already", "Task")
        else:
            end = f", not to {before}" if before else " added"
            self._hub.tell(visitor, f"{cube} \N{RIGHTWARDS ARROW} {box}{end}", "Task", "green")

    async def _floor(self, visitor: Visitor, x: float, y: float) -> None:
        view = self._hub.view
        if view.sending:
            if await self._order(visitor, SendAgent(name=view.sending, x=x, y=y)):
                view.sending = ""
        elif view.placing and view.placing == view.selected:
            if await self._order(visitor, MoveBody(name=view.selected, x=x, y=y, held=False)):
                view.placing = ""
        elif view.selected:
            view.selected = view.placing = ""
        elif view.going is not None and math.dist(view.going, (x, y)) < SAME_PLACE:
            await self.drive(visitor)
        elif reason := self._hub.refusal(visitor):
            self._hub.tell(visitor, reason)
        else:
            view.going = (x, y)

    async def drive(self, visitor: Visitor) -> None:
        """Send the robot to the proposed place, before any other task."""
        view, tick = self._hub.view, self.tick
        if view.going is None or tick is None:
            return
        task, index = DriveTo(point=view.going), min(tick.task_index, len(tick.tasks))
        if await self._order(visitor, InsertTask(tasks=(task,), index=index)):
            view.going, view.sent_to = None, name_of(task)
            if tick.preview:
                self._hub.tell(visitor, f"drive to {view.sent_to} is added when time goes on", "Task", "green")

    async def _order(self, visitor: Visitor, command: Command) -> bool:
        """Send a command and return its success; the hub tells the visitor of a refusal."""
        if reason := self._hub.refusal(visitor):
            self._hub.tell(visitor, reason)
            return False
        return (await asyncio.to_thread(self._hub.command, visitor, command)).ok


def delivery(tasks: Sequence[TaskMessage], cube: str, box: str) -> list[Command]:
    """Commands that add a pick and its place at the end of the list.

    If the cube already waits in the list, its job is redirected to this bin; no command when that is its bin already.
    """
    added, planned = (Pick(object=cube), Place(bin=box)), waiting_job(tasks, cube)
    if planned is None:
        return [InsertTask(tasks=added)]
    index, before = planned
    return [] if before == box else [RemoveTask(index=index), InsertTask(tasks=added, index=index)]


def waiting_job(tasks: Sequence[TaskMessage], cube: str) -> tuple[int, str] | None:
    """Index of a waiting pick of this cube, and the bin of its place task; None when there is none."""
    for index, task in enumerate(tasks):
        if task.kind == "pick" and task.target == cube and task.status == "waiting":
            place = next((later for later in tasks[index:] if later.kind == "place"), None)
            return index, "" if place is None else place.target
    return None
