"""One attempt at a generated scene: a room, its furniture, the start, agents; and the proof that it is solvable.

Everything is drawn at random, placed where it fits, and then proved solvable; an attempt that fails is discarded. The
proof is a path for the robot between all poses that it needs, with room to spare.

The robot is taken as the disc round its footprint, grown by the margins that it needs (`DISC`). Where the middle
of that disc is free, the robot is clear at any heading and can turn on the spot. Between two places of one
connected part of that free space it can therefore drive, turning on the spot at the corners. A doorway is
narrower than the disc: the strip of places on its axis, along which the robot drives straight with `BESIDE` to spare on
either side, joins the parts that its ends lie in.

A target is served from a standing pose in the part of the start: the robot faces it there, and the arm's mount is then
at most `STAND` less the mount's distance away, less than any pick or release needs. Heights of targets are those at
which the arm reaches that far (`HIGHEST`, `LOWEST`).
"""

import dataclasses
import math
from typing import Any

from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.generate import pieces
from motm_twin.generate.pieces import Dial, Entry, Maker, Piece, Pose, Rng
from motm_twin.model.profile import RobotProfile

DISC = 0.50  # [m] 0.43 m round the footprint, 0.05 m that the search keeps, 0.02 m of localisation (2 sigma)
BESIDE = 0.12  # [m] of room on either side of the footprint in a doorway
STAND = 0.80  # [m] from the middle of the base to a target: 0.65 m from the mount
NEAREST = 0.55  # [m] the same: the arm does not fold up closer
LOWEST, HIGHEST = 0.55, 0.90  # [m] targets for which `STAND` is in reach
FOOTPRINT = RobotProfile().footprint
Place = tuple[float, float]
Door = tuple[Place, Place]  # ends of the strip on a doorway's axis


def free_parts(room: BaseGeometry, bodies: list[BaseGeometry]) -> list[BaseGeometry]:
    """Connected parts of the places at which the robot can turn on the spot."""
    free = room.buffer(-DISC).difference(unary_union(bodies).buffer(DISC))
    return [part for part in getattr(free, "geoms", [free]) if not part.is_empty]


def reachable(start: Place, parts: list[BaseGeometry], doors: list[Door]) -> BaseGeometry:
    """All places that the robot can get to from its start; empty when it cannot turn there."""
    inside = _parts_at(start, parts)
    joined = [_parts_at(one, parts) | _parts_at(other, parts) for one, other in doors]
    for _ in joined:  # as often as a path may pass through doorways
        for both in joined:
            inside |= both if inside & both else set()
    return unary_union([parts[index] for index in sorted(inside)])


def _parts_at(place: Place, parts: list[BaseGeometry]) -> set[int]:
    return {index for index, part in enumerate(parts) if part.covers(Point(place))}


def passable(door: Door, bodies: list[BaseGeometry]) -> bool:
    """The footprint, driven straight from one end of the strip to the other, keeps `BESIDE` from everything."""
    way = LineString(door).buffer(0.5 * FOOTPRINT.width + BESIDE, cap_style="square")
    return not any(body.intersects(way) for body in bodies)


def can_stand(target: Place, ground: BaseGeometry) -> bool:
    """A standing robot can serve the target from some reachable place."""
    around = Point(target).buffer(STAND, quad_segs=32).difference(Point(target).buffer(NEAREST))
    return bool(around.intersects(ground))


FLOOR, RIM = 0.02, 0.12  # [m] of a bin above what it stands on
START_ROOM = 0.9  # [m] of everything from the start: the arm begins with the hand 0.66 m before the base
TRIES = 60  # places tried for a piece
WALL, WALL_HEIGHT = 0.12, 2.0  # [m]
BACK = 0.02  # [m] between a wall and what stands with its back to it
DOOR_ROOM = 1.3  # [m] kept free before and behind a doorway
AGENT_RADIUS, AGENT_SPARE = 0.25, 0.12  # [m] of an agent, and what its way keeps from furniture
AGENT_START = 1.3  # [m] of an agent from the robot and from the others at the start


class Unfit(Exception):
    """This attempt yields no scene."""


@dataclasses.dataclass
class Layout:
    """Room, furniture, start and agents of an attempt."""

    rng: Rng
    dial: Dial
    size: Place  # [m] of the room
    walls: dict[str, Entry] = dataclasses.field(default_factory=dict)
    doors: list[Door] = dataclasses.field(default_factory=list)
    kept_free: list[BaseGeometry] = dataclasses.field(default_factory=list)
    pieces: list[Piece] = dataclasses.field(default_factory=list)
    start: Pose = (0.0, 0.0, 0.0)
    agents: dict[str, Entry] = dataclasses.field(default_factory=dict)
    ground: BaseGeometry = dataclasses.field(default_factory=Polygon)  # where the robot can get to and turn

    @property
    def room(self) -> BaseGeometry:
        """The floor."""
        return box(0.0, 0.0, *self.size)

    def bodies(self) -> list[BaseGeometry]:
        """Outlines of all that stands on the floor."""
        return [pieces.area_of(wall) for wall in self.walls.values()] + [piece.area for piece in self.pieces]


def attempt(rng: Rng, dial: Dial, scale: float) -> Layout:
    """A layout in which everything that can carry a task can be served. Raises Unfit."""
    layout = Layout(rng, dial, _room(rng, dial, scale))
    parted = dial.doors and rng.random() < 0.5
    if rng.random() < 0.6 or parted:
        _walls(layout)
    if parted:
        _partition(layout)
    for name, maker in _wanted(rng, dial):
        layout.pieces.append(_placed(layout, name, maker))
    _start(layout)
    for index in range(dial.agents):
        layout.agents[f"agent_{index + 1}"] = _agent(layout)
    return layout


def serviceable(layout: Layout, places: tuple[Place, ...]) -> list[Place]:
    """Those of the places that the robot can serve."""
    return [place for place in places if can_stand(place, layout.ground)]


def _room(rng: Rng, dial: Dial, scale: float) -> Place:
    """A floor sized for the pieces and the space round each."""
    count = dial.surfaces + dial.bins + dial.clutter + dial.boxes
    area = scale * (12.0 + count * (1.2 + dial.gap) ** 2)
    aspect = float(rng.uniform(0.6, 1.0))
    return round(math.sqrt(area / aspect), 1), round(math.sqrt(area * aspect), 1)


def _walls(layout: Layout) -> None:
    """Four walls round the room, outside its floor."""
    (width, depth), half = layout.size, 0.5 * WALL
    layout.walls["wall_south"] = _wall((0.5 * width, -half), (width, WALL))
    layout.walls["wall_north"] = _wall((0.5 * width, depth + half), (width, WALL))
    layout.walls["wall_west"] = _wall((-half, 0.5 * depth), (WALL, depth + 2.0 * WALL))
    layout.walls["wall_east"] = _wall((width + half, 0.5 * depth), (WALL, depth + 2.0 * WALL))


def _wall(centre: Place, size: Place) -> Entry:
    at, extent = ([round(value, 3) for value in pair] for pair in (centre, size))
    return {"shape": "box", "centre": at, "size": extent, "z": [0.0, WALL_HEIGHT], "style": "wall"}


def _partition(layout: Layout) -> None:
    """A wall across the room with a doorway in it."""
    (width, depth), gap = layout.size, round(layout.dial.doorway, 2)
    x = round(float(layout.rng.uniform(0.42, 0.58)) * width, 2)
    y = round(float(layout.rng.uniform(1.2, depth - 1.2)), 2)
    low, high = round(y - 0.5 * gap, 3), round(y + 0.5 * gap, 3)
    layout.walls["partition_1"] = _wall((x, 0.5 * low), (WALL, low))
    layout.walls["partition_2"] = _wall((x, 0.5 * (high + depth)), (WALL, depth - high))
    reach = 0.5 * WALL + DISC + 0.1
    layout.doors.append(((x - reach, y), (x + reach, y)))
    layout.kept_free.append(box(x - DOOR_ROOM, y - 0.9, x + DOOR_ROOM, y + 0.9))
    if not passable(layout.doors[-1], layout.bodies()):
        raise Unfit("the doorway is too narrow")


def _wanted(rng: Rng, dial: Dial) -> list[tuple[str, Maker]]:
    """Names and kinds of all pieces: those with tasks first, which need the most room."""
    kinds: list[tuple[str, Maker]] = []
    for name, count, makers in (
        ("surface", dial.surfaces, (pieces.table, pieces.shelf)),
        ("station", dial.bins, (pieces.desk, pieces.stand)),
        ("clutter", dial.clutter, (pieces.cabinet, pieces.column, pieces.corner)),
    ):
        kinds += [(f"{name}_{index + 1}", makers[int(rng.integers(len(makers)))]) for index in range(count)]
    return kinds + [(f"box_{index + 1}", pieces.box) for index in range(dial.boxes)]


def _placed(layout: Layout, name: str, maker: Maker) -> Piece:
    """The piece at the first place drawn that keeps the gap to all others."""
    rng = layout.rng
    backed = maker in (pieces.table, pieces.shelf, pieces.desk, pieces.cabinet) and rng.random() < 0.4
    draft = maker(rng, layout.dial, backed)
    for _ in range(TRIES):
        pose = _against_a_wall(layout, draft) if backed else _anywhere(layout)
        piece = pieces.put(draft, name, pose)
        if _fits(layout, piece, backed):
            return piece
    raise Unfit(f"no room for {name}")


def _anywhere(layout: Layout) -> Pose:
    rng, (width, depth) = layout.rng, layout.size
    turned = rng.random() < layout.dial.difficulty
    yaw = float(rng.integers(-180, 180)) if turned else 90.0 * float(rng.integers(-1, 3))
    return round(float(rng.uniform(0.0, width)), 2), round(float(rng.uniform(0.0, depth)), 2), yaw


def _against_a_wall(layout: Layout, draft: pieces.Draft) -> Pose:
    """Its back, +y of its own frame, to one of the four sides of the room."""
    rng, (width, depth) = layout.rng, layout.size
    side, along = int(rng.integers(4)), float(rng.random())
    away, across, up = BACK + 0.5 * draft.width, along * width, along * depth
    x, y = ((across, depth - away), (away, up), (across, away), (width - away, up))[side]
    return round(x, 3), round(y, 3), (0.0, 90.0, 180.0, -90.0)[side]


def _fits(layout: Layout, piece: Piece, backed: bool) -> bool:
    gap, area = layout.dial.gap, piece.area
    if not layout.room.covers(area) or any(area.intersects(zone) for zone in layout.kept_free):
        return False
    width, depth = layout.size
    x_min, y_min, x_max, y_max = area.bounds
    to_sides = sorted((x_min, y_min, width - x_max, depth - y_max))
    inner = [pieces.area_of(wall) for name, wall in layout.walls.items() if name.startswith("partition")]
    others = [other.area for other in layout.pieces] + inner
    return to_sides[int(backed)] >= gap and all(area.distance(other) >= gap for other in others)


def _start(layout: Layout) -> None:
    """A start where the robot can turn and from which every piece with a task on it is served."""
    rng, (width, depth) = layout.rng, layout.size
    parts = free_parts(layout.room, layout.bodies())
    for _ in range(TRIES):
        x, y = round(float(rng.uniform(0.6, width - 0.6)), 2), round(float(rng.uniform(0.6, depth - 0.6)), 2)
        if any(body.distance(Point(x, y)) < START_ROOM for body in layout.bodies()):
            continue
        layout.ground = reachable((x, y), parts, layout.doors)
        if not layout.ground.is_empty and _all_served(layout):
            layout.start = (x, y, 45.0 * float(rng.integers(-3, 5)))
            return
    raise Unfit("something cannot be reached")


def _all_served(layout: Layout) -> bool:
    """Every bin, and some place on every surface."""
    for piece in layout.pieces:
        target = piece.top if piece.spots else piece.top + RIM
        if not LOWEST <= target <= HIGHEST and (piece.spots or piece.bins):
            return False
        if piece.spots and not serviceable(layout, piece.spots):
            return False
        if len(serviceable(layout, piece.bins)) < len(piece.bins):
            return False
    return True


def _agent(layout: Layout) -> dict[str, Any]:
    """An agent on a closed path clear of furniture and doorways, starting well away from all others."""
    rng, (width, depth) = layout.rng, layout.size
    begun = [layout.start[:2], *(tuple(agent["waypoints"][0]) for agent in layout.agents.values())]
    for _ in range(4 * TRIES):
        middle = rng.uniform(0.5, width - 0.5), rng.uniform(0.5, depth - 0.5)
        half, yaw = (rng.uniform(0.6, 2.0), rng.uniform(0.3, 0.8)), rng.uniform(-math.pi, math.pi)
        c, s = math.cos(yaw), math.sin(yaw)
        ways = [(a * half[0], b * half[1]) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
        points = [[round(middle[0] + c * x - s * y, 2), round(middle[1] + s * x + c * y, 2)] for x, y in ways]
        if all(math.dist(points[0], other) >= AGENT_START for other in begun) and _way_is_free(layout, points):
            return {"waypoints": points, "speed_mps": round(float(rng.uniform(0.25, 0.45)), 2)}
    raise Unfit("no way for an agent")


def _way_is_free(layout: Layout, points: list[list[float]]) -> bool:
    way = LineString([*points, points[0]]).buffer(AGENT_RADIUS + AGENT_SPARE)
    blocked = [*layout.bodies(), *layout.kept_free, Point(layout.start[:2]).buffer(0.6)]
    return layout.room.covers(way) and not any(way.intersects(body) for body in blocked)
