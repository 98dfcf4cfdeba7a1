"""Scenes from a seed: ``generated:17`` or ``generated:17@0.6``, the same text for the same seed and difficulty.

An attempt draws a room, its furniture, the start and agents at random, places them where they fit, and then proves that
the scene is solvable; one that fails is discarded. The proof is a path for the robot between all poses that it needs,
with room to spare. Nothing was tuned on these scenes.

The robot is taken as the disc round its footprint, grown by the margins that it needs (`DISC`). Where the middle
of that disc is free, the robot is clear at any heading and can turn on the spot. Between two places of one
connected part of that free space it can therefore drive, turning on the spot at the corners. A doorway is
narrower than the disc: the strip of places on its axis, along which the robot drives straight with `BESIDE` to spare on
either side, joins the parts that its ends lie in.

A target is served from a standing pose in the part that contains the start: the robot faces it there, and the arm's
mount is then at most `STAND` less the mount's distance away, within the reach of every pick and release. Heights of
targets are those at which the arm reaches that far (`HIGHEST`, `LOWEST`).
"""

import dataclasses
import math
import re
from typing import Any

import numpy as np
import yaml
from shapely.geometry import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.generate import pieces
from motm_twin.generate.pieces import Dial, Entry, Maker, Piece, Pose, Rng, dial
from motm_twin.model.bounds import SEED
from motm_twin.model.names import SceneError
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene_format import FORMAT

DISC = 0.50  # [m] 0.43 m round the footprint, 0.05 m that the search keeps, 0.02 m of localisation (2 sigma)
BESIDE = 0.12  # [m] of room on either side of the footprint in a doorway
STAND = 0.80  # [m] from the middle of the base to a target: 0.65 m from the mount
NEAREST = 0.55  # [m] least such distance: the arm does not fold up closer
LOWEST, HIGHEST = 0.55, 0.90  # [m] targets for which `STAND` is in reach
FOOTPRINT = RobotProfile().footprint
Place = tuple[float, float]
Door = tuple[Place, Place]  # ends of the strip on a doorway's axis


def free_parts(room: BaseGeometry, bodies: list[BaseGeometry]) -> list[BaseGeometry]:
    """Connected parts of the area in which the robot can turn on the spot."""
    free = room.buffer(-DISC).difference(unary_union(bodies).buffer(DISC))
    return [part for part in getattr(free, "geoms", [free]) if not part.is_empty]


def reachable(start: Place, parts: list[BaseGeometry], doors: list[Door]) -> BaseGeometry:
    """Area that the robot can reach from its start; empty when it cannot turn there."""
    inside = _parts_at(start, parts)
    joined = [_parts_at(one, parts) | _parts_at(other, parts) for one, other in doors]
    for _ in joined:  # as often as a path may pass through doorways
        for both in joined:
            inside |= both if inside & both else set()
    return unary_union([parts[index] for index in sorted(inside)])


def _parts_at(place: Place, parts: list[BaseGeometry]) -> set[int]:
    return {index for index, part in enumerate(parts) if part.covers(Point(place))}


def passable(door: Door, bodies: list[BaseGeometry]) -> bool:
    """True when the footprint, driven straight along the strip, keeps `BESIDE` from everything."""
    way = LineString(door).buffer(0.5 * FOOTPRINT.width + BESIDE, cap_style="square")
    return not any(body.intersects(way) for body in bodies)


def can_stand(target: Place, ground: BaseGeometry) -> bool:
    """True when the robot, standing at some place of its reachable ``ground``, can serve the target."""
    around = Point(target).buffer(STAND, quad_segs=32).difference(Point(target).buffer(NEAREST))
    return bool(around.intersects(ground))


FLOOR, RIM = 0.02, 0.12  # [m] of a bin above what it stands on
START_ROOM = 0.9  # [m] from the start to everything: the arm begins with the hand 0.66 m before the base
TRIES = 60  # places tried for a piece
WALL, WALL_HEIGHT = 0.12, 2.0  # [m]
BACK = 0.02  # [m] between a wall and a piece with its back to it
DOOR_ROOM = 1.3  # [m] kept free before and behind a doorway
AGENT_RADIUS, AGENT_SPARE = 0.25, 0.12  # [m] of an agent, and between its path and furniture
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
    ground: BaseGeometry = dataclasses.field(default_factory=Polygon)  # area that the robot can reach and turn in

    @property
    def room(self) -> BaseGeometry:
        """Outline of the floor."""
        return box(0.0, 0.0, *self.size)

    def bodies(self) -> list[BaseGeometry]:
        """Outlines of walls and furniture."""
        return [pieces.area_of(wall) for wall in self.walls.values()] + [piece.area for piece in self.pieces]


def attempt(rng: Rng, dial: Dial, scale: float) -> Layout:
    """A layout in which everything that can carry a task can be served. Raises Unfit."""
    layout = Layout(rng, dial, _room(rng, dial, scale))
    parted = dial.doors and rng.random() < 0.5
    if rng.random() < 0.6 or parted:
        _walls(layout)
    if parted:
        _partition(layout)
    for name, maker in _pieces_to_place(rng, dial):
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


def _pieces_to_place(rng: Rng, dial: Dial) -> list[tuple[str, Maker]]:
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
    """Pose with the back (+y of the piece) to one of the four sides of the room."""
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
    """True when every bin, and some place on every surface, can be served."""
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


PREFIX = "generated:"
DIFFICULTY = 0.5  # default
DIGITS = 4  # of the difficulty after the point
ATTEMPTS = 400
GROWTH = 1.01  # factor of the floor's area, per attempt: in the end everything fits
COLOURS = ("red", "green", "blue", "yellow", "orange")
WALL_ROUND = 0.14  # [m] of map round the floor, for the walls
_STREAM = 0x5CE7E  # keeps the draws apart from other uses of a seed
_NAME = re.compile(r"generated:([0-9]{1,19})(?:@([0-9]+(?:\.[0-9]*)?|\.[0-9]+))?")


def is_generated(name: str) -> bool:
    """True for the name of a generated scene."""
    return name.startswith(PREFIX)


def name_of(seed: int, difficulty: float = DIFFICULTY) -> str:
    """The name of a generated scene. Raises SceneError for a seed or difficulty out of range."""
    return f"{PREFIX}{seed}@{_checked(seed, difficulty):g}"


def parse_name(name: str) -> tuple[int, float]:
    """Seed and difficulty of ``generated:SEED`` or ``generated:SEED@DIFFICULTY``. Raises SceneError."""
    match = _NAME.fullmatch(name)
    if match is None:
        raise SceneError(
            f"{name[:60]!r} is not a generated scene: write generated:SEED or generated:SEED@DIFFICULTY, "
            "as generated:17@0.6"
        )
    seed, difficulty = int(match[1]), DIFFICULTY if match[2] is None else float(match[2])
    return seed, _checked(seed, difficulty)


def generate(seed: int, difficulty: float = DIFFICULTY) -> str:
    """The text of a scene file. Raises SceneError for a seed or difficulty out of range."""
    numbers = dial(_checked(seed, difficulty))
    for number in range(ATTEMPTS):
        try:
            layout = attempt(np.random.default_rng([seed, _STREAM, number]), numbers, GROWTH**number)
            return _text(seed, numbers, layout, _work(layout))
        except Unfit:
            continue
    raise RuntimeError(f"no scene in {ATTEMPTS} attempts for seed {seed} and difficulty {difficulty:g}")


def made(asked: str) -> tuple[str, str]:
    """Full name and text of the scene for a name such as ``generated:17``. Raises SceneError."""
    seed, difficulty = parse_name(asked)
    return name_of(seed, difficulty), generate(seed, difficulty)


def _checked(seed: int, difficulty: float) -> float:
    """The difficulty rounded to four digits, as in a name. Raises SceneError."""
    if SEED.refusal("seed", seed):
        raise SceneError(f"the seed of a generated scene is a whole number from 0 to 2^63 - 1, got {seed}")
    if not (math.isfinite(difficulty) and 0.0 <= difficulty <= 1.0):
        raise SceneError(f"the difficulty of a generated scene is from 0 (easy) to 1 (hard), got {difficulty:g}")
    return round(difficulty, DIGITS)


def _work(layout: Layout) -> dict[str, Any]:
    """Cubes, bins and tasks: every cube into one of the bins, with drives in between."""
    bins = {
        f"bin_{index + 1}": _bin(layout, piece.bins[0], piece.top, piece.yaw)
        for index, piece in enumerate(piece for piece in layout.pieces if piece.bins)
    }
    cubes = _cubes(layout)
    tasks: list[dict[str, Any]] = []
    for name in cubes:
        tasks += [{"pick": name}, {"place": list(bins)[int(layout.rng.integers(len(bins)))]}]
    for goal in _goals(layout):
        tasks.insert(2 * int(layout.rng.integers(1, len(cubes) + 1)), {"drive_to": goal})
    return {"objects": cubes, "bins": bins, "tasks": tasks}


def _bin(layout: Layout, at: Place, top: float, yaw: float) -> dict[str, Any]:
    side = round(0.4 - 0.08 * layout.dial.difficulty * float(layout.rng.random()), 2)
    entry = {"at": list(at), "side": side, "rim_z": round(top + RIM, 3), "floor_z": round(top + FLOOR, 3)}
    return entry if yaw == 0.0 else {**entry, "yaw_deg": yaw}


def _cubes(layout: Layout) -> dict[str, Any]:
    """Cubes on places that can be served, in the order in which they are fetched; surfaces take turns."""
    rng, dial = layout.rng, layout.dial
    surfaces = [piece for piece in layout.pieces if piece.spots]
    free = [[piece, serviceable(layout, piece.spots)] for piece in surfaces]
    if sum(len(places) for _, places in free) < dial.cubes:
        raise Unfit("too few places for cubes")
    chosen = []
    while len(chosen) < dial.cubes:
        piece, places = free[len(chosen) % len(free)]
        if places:
            chosen.append((piece, places.pop(int(rng.integers(len(places))))))
        else:
            free.remove([piece, places])
    cubes = {}
    for index, which in enumerate(rng.permutation(len(chosen))):
        piece, place = chosen[int(which)]
        spread = 0.012 * dial.difficulty
        cubes[f"cube_{index + 1}"] = {
            "surface": piece.name,
            "at": list(place),
            "yaw_deg": float(rng.integers(-45, 46)),
            "side": round(float(rng.uniform(0.04 - spread, 0.04 + spread)), 3),
            "colour": COLOURS[int(rng.integers(len(COLOURS)))],
        }
    return cubes


def _goals(layout: Layout) -> list[dict[str, Any]]:
    """Places to drive to, where the robot can turn; half of them with a heading."""
    rng, (width, depth) = layout.rng, layout.size
    goals: list[dict[str, Any]] = []
    while len(goals) < layout.dial.drives:
        place = round(float(rng.uniform(0.0, width)), 2), round(float(rng.uniform(0.0, depth)), 2)
        if not layout.ground.covers(Point(place)):
            continue
        goal = {"x": place[0], "y": place[1], "tolerance": 0.2}
        goals.append({**goal, "heading_deg": 45.0 * float(rng.integers(-3, 5))} if rng.random() < 0.5 else goal)
    return goals


def _text(seed: int, dial: Dial, layout: Layout, work: dict[str, Any]) -> str:
    """Text of the scene file: one line for each entry, as in the shipped scenes."""
    furniture = dict(layout.walls)
    for piece in layout.pieces:
        furniture |= piece.furniture
    x, y, heading = layout.start
    room = WALL_ROUND if layout.walls else 0.0
    lines = [
        f"# Made by: motm-twin scene generate --seed {seed} --difficulty {dial.difficulty:g}",
        f"format: {FORMAT}",
        f'title: "Generated scene, seed {seed}, difficulty {dial.difficulty:g}"',
        "robot: frankie",
        f"start: {_flow({'x': x, 'y': y, 'heading_deg': heading})}",
        *_section("furniture", furniture),
        *_section("objects", work["objects"]),
        *_section("bins", work["bins"]),
        *_section("agents", layout.agents),
        "tasks:",
        *(f"  - {_flow(task)}" for task in work["tasks"]),
        f"seed: {seed}",
        f"time_limit: {60 + 30 * len(work['tasks'])}",
        f"bounds: {_flow([-room, -room, *(round(side + room, 2) for side in layout.size)])}",
    ]
    return "\n".join(lines) + "\n"


def _section(name: str, entries: dict[str, Any]) -> list[str]:
    return [f"{name}:", *(f"  {key}: {_flow(entry)}" for key, entry in entries.items())] if entries else []


def _flow(value: Any) -> str:
    return yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000).removesuffix("\n")
