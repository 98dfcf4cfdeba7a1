"""Scenes like those of published challenges from a seed: ``barn:17``, ``circle:17``, ``square:17``, ``dynabarn:17``.

The same seed gives the same text. BARN is rewritten from the published description (Perille, Truong, Xiao, Stone:
Benchmarking Metric Ground Navigation, 2020), not from its files: a lane 4.5 m wide, on 4.5 m of which a cellular
automaton puts cylinders of radius 0.075 m. A cell of 0.15 m is filled at first with a probability of 0.15 to 0.30. It
is then filled when at least 5 of its 8 neighbours are, and cleared when at most 1 is, 2 to 4 times over. Seed k has
the (k mod 12)th of these 12 settings. A world without a path for a square of 5 x 5 cells is drawn again, with 2 in
1,000 less filled at first. The robot is the nominal Jackal; it has 10 m to go, and its map is empty.

CrowdNav (Chen et al., Crowd-Robot Interaction, ICRA 2019): five persons of radius 0.3 m at 1 m/s, by ORCA, cross a
circle of radius 4 m, or a square of 10 m; the robot crosses from (0, -4) to (0, 4) in at most 25 s. The robot is
Frankie at 1 m/s, with its true footprint. The draws differ from those of the same seed in CrowdNav, which draws all
from one global generator. DynaBARN follows its description: cylinders move along polynomials.
"""

import math
import re
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.bounds import SEED
from motm_twin.model.names import SceneError
from motm_twin.model.scene_format import FORMAT

PREFIX = "barn:"
CELL = 0.15  # [m]
RADIUS = 0.075  # [m] of a cylinder
ROWS, COLUMNS = 30, 30  # of the field, the outermost columns are the side walls
FIRST_ROW = 5.175  # [m] y of the middle of the first row
FILLS, SMOOTHINGS = (0.15, 0.20, 0.25, 0.30), (2, 3, 4)
FILLED_FROM, CLEARED_TO = 5, 1  # of 8 neighbours
HALF_ROBOT = 2  # cells that the robot takes on either side of its own
ATTEMPTS = 1000
THINNER = 0.998  # factor of the initial fill, per attempt: in the end there is a path
STREAM = 0xBA24  # keeps these draws apart from other uses of a seed
START, GOAL, TOLERANCE = (-2.25, 3.0), (-2.25, 13.0), 1.0  # [m]
LIMIT = 100.0  # [s] counted once the robot has moved 0.1 m
NOMINAL = {
    "forward_speed_mps": 2.0, "reverse_speed_mps": 1.0, "yaw_rate_dps": 180, "linear_acceleration_mps2": 3.0,
    "yaw_acceleration_dps2": 573, "velocity_lag": 0.1,
}  # fmt: skip
CONTROLLER = {
    "forward_speed_mps": 2.0, "reverse_speed_mps": 2.0, "yaw_rate_dps": 229, "linear_acceleration_mps2": 20.0,
    "yaw_acceleration_dps2": 1432, "velocity_lag": 0.05,
}  # fmt: skip
_NAME = re.compile(r"(barn:|circle:|square:|dynabarn:)([0-9]{1,19})")
Cells = NDArray[np.bool_]


def made(asked: str) -> tuple[str, str]:
    """Name and text of the scene for a name such as ``barn:17``. Raises SceneError."""
    match = _NAME.fullmatch(asked)
    if match is None or SEED.refusal("seed", int(match[2])):
        kind = asked.partition(":")[0]
        raise SceneError(f"{asked[:60]!r} is not a scene: write {kind}:SEED, as in {kind}:17, with a seed below 2^63")
    prefix, seed = match[1], int(match[2])
    if prefix == PREFIX:
        return f"{prefix}{seed}", barn(seed)
    rng = np.random.default_rng([seed, STREAMS[prefix]])
    return f"{prefix}{seed}", _dynabarn(seed, rng) if prefix == "dynabarn:" else _crowd(prefix, seed, rng)


def barn(seed: int) -> str:
    """Text of a scene file like a BARN world, for a seed from 0 on."""
    fill, smoothings = FILLS[seed % 12 % 4], SMOOTHINGS[seed % 12 // 4]
    for attempt in range(ATTEMPTS):
        cells = field(np.random.default_rng([seed, attempt, STREAM]), fill * THINNER**attempt, smoothings)
        if has_way(cells):
            return _text(seed, fill, smoothings, cells)
    raise RuntimeError(f"no world with a way in {ATTEMPTS} attempts for seed {seed}")


def field(rng: np.random.Generator, fill: float, smoothings: int) -> Cells:
    """Filled cells of the field, shape (ROWS, COLUMNS): row 0 is the first that the robot meets."""
    cells = rng.random((ROWS, COLUMNS)) < fill
    for _ in range(smoothings):
        beside = np.pad(cells, ((1, 1), (1, 1))).astype(int)
        beside[:, [0, -1]] = 1  # the lane is walled, and open at both ends
        around = sum(np.roll(beside, (i, k), (0, 1)) for i in (-1, 0, 1) for k in (-1, 0, 1)) - beside
        around = around[1:-1, 1:-1]
        cells = (cells | (around >= FILLED_FROM)) & (around > CLEARED_TO)
    cells[:, [0, -1]] = True
    return cells


def has_way(cells: Cells) -> bool:
    """True when the robot's square of cells can cross the field, with diagonal steps."""
    rows, columns = cells.shape
    taken, beside = np.zeros_like(cells), np.pad(cells, HALF_ROBOT)
    for i in range(2 * HALF_ROBOT + 1):
        for k in range(2 * HALF_ROBOT + 1):
            taken |= beside[i : i + rows, k : k + columns]
    free = [int("".join("01"[not cell] for cell in row), 2) for row in taken]  # a bit for each cell of a row
    reached = [free[0], *([0] * (rows - 1))]
    before: list[int] = []
    while reached != before:
        before = list(reached)
        for row in (*range(rows), *range(rows - 2, -1, -1)):
            near = reached[row] | (reached[row - 1] if row > 0 else 0) | (reached[row + 1] if row + 1 < rows else 0)
            reached[row] |= (near | near << 1 | near >> 1) & free[row]
    return reached[-1] != 0


def _text(seed: int, fill: float, smoothings: int, cells: Cells) -> str:
    """Text of the scene file, laid out like the converted worlds of the challenge."""
    base = ", ".join(f"{key}: {value}" for key, value in NOMINAL.items())
    height = "z: [0.0, 0.32], mapped: false"
    lines = [
        f"# Like the worlds of BARN: seed {seed}, {fill:.0%} filled at first, smoothed {smoothings} times",
        f"format: {FORMAT}",
        f'title: "World like those of BARN, seed {seed}"',
        "robot:",
        "  name: jackal",
        "  footprint: {length: 0.508, width: 0.43, height: 0.25}",
        f"  base: {{{base}}}",
        "  arm: none",
        "  lidar: {x: 0.12, field_of_view_deg: 270, beams: 720, range_min: 0.1, range_max: 30.0, rate_hz: 40}",
        f"start: {{x: {START[0]}, y: {START[1]}, heading_deg: 90}}",
        "bounds: [-7.0, -1.5, 2.5, 15.5]",
        "furniture:",
        f"  wall_left: {{shape: box, centre: [-4.425, 4.8], size: [0.15, 9.6], {height}}}",
        f"  wall_right: {{shape: box, centre: [-0.075, 4.8], size: [0.15, 9.6], {height}}}",
        f"  wall_back: {{shape: box, centre: [-2.25, 0.075], size: [4.2, 0.15], {height}}}",
    ]
    for number, (row, column) in enumerate(np.argwhere(cells[:, 1:-1])):
        x, y = -4.275 + CELL * column, FIRST_ROW + CELL * row
        lines.append(f"  c_{number}: {{shape: cylinder, centre: [{x:.3f}, {y:.3f}], radius: {RADIUS}, {height}}}")
    lines += [
        "tasks:",
        f"  - drive_to: {{x: {GOAL[0]}, y: {GOAL[1]}, tolerance: {TOLERANCE}}}",
        f"seed: {seed}",
        f"time_limit: {LIMIT + 2.0:g}",
    ]
    return "\n".join(lines) + "\n"


PEOPLE, PERSON_RADIUS, SPEED = 5, 0.3, 1.0  # [m], [m/s]
CIRCLE, SQUARE = 4.0, 10.0  # [m] radius, side
DISCOMFORT = 0.2  # [m] between bodies at start and goal
ROBOT_RADIUS = 0.44  # [m] of the circle round Frankie's footprint; CrowdNav's robot has 0.3
CROWD_LIMIT = 25.0  # [s]
STEP_ACCELERATION = 4.0  # [m/s^2]: in CrowdNav a person stops from 1 m/s in one step of 0.25 s
DRAWS = 10_000
STREAMS = {"circle:": 0xC1AC1E, "square:": 0x50A8E, "dynabarn:": 0xD7BA24}  # keep draws apart from other uses of a seed
ROBOT = "robot: {name: frankie, base: {forward_speed_mps: 1.0, reverse_speed_mps: 0.5, linear_acceleration_mps2: 1.0}}"

CYLINDERS, CYLINDER_RADIUS = 8, 0.5  # [m]
LEVELS = {"easy": (0.5, 0.9), "medium": (1.05, 1.4), "hard": (1.5, 1.85)}  # [m/s] mean speeds
LANE = (-4.0, -4.0, 4.0, 4.0)  # [m] x_min, y_min, x_max, y_max in which the cylinders move
ORDER = 3  # of the polynomials, both of x and of y
BEND = 12  # points of a path
Point = tuple[float, float]


def crossings(
    rng: np.random.Generator, draw: Callable[[np.random.Generator], tuple[Point, Point]]
) -> list[tuple[Point, Point]]:
    """Starts and goals of the persons, each apart from all others and from the robot's."""
    found: list[tuple[Point, Point]] = []
    kept = [((0.0, -CIRCLE), (0.0, CIRCLE), PERSON_RADIUS + ROBOT_RADIUS + DISCOMFORT)]
    for _ in range(DRAWS):
        start, goal = draw(rng)
        apart = (min(math.dist(start, s), math.dist(start, g), math.dist(goal, g)) >= gap for s, g, gap in kept)
        if all(apart):
            found.append((start, goal))
            kept.append((start, goal, 2.0 * PERSON_RADIUS + DISCOMFORT))
            if len(found) == PEOPLE:
                return found
    raise RuntimeError(f"no places for {PEOPLE} persons in {DRAWS} attempts")


def across_circle(rng: np.random.Generator) -> tuple[Point, Point]:
    """Start on the circle, moved by up to 0.5 m along x and y, and the goal opposite."""
    angle = 2.0 * math.pi * rng.random()
    x = CIRCLE * math.cos(angle) + (rng.random() - 0.5) * SPEED
    y = CIRCLE * math.sin(angle) + (rng.random() - 0.5) * SPEED
    return (x, y), (-x, -y)


def across_square(rng: np.random.Generator) -> tuple[Point, Point]:
    """Start in one half of the square, goal in the other."""
    side = -1.0 if rng.random() > 0.5 else 1.0
    start = (rng.random() * 0.5 * SQUARE * side, (rng.random() - 0.5) * SQUARE)
    return start, (rng.random() * 0.5 * SQUARE * -side, (rng.random() - 0.5) * SQUARE)


def _crowd(prefix: str, seed: int, rng: np.random.Generator) -> str:
    """Text of the scene file of a circle or square, in two variants: the persons see the robot, or do not."""
    ways = crossings(rng, across_circle if prefix == "circle:" else across_square)
    what = "circle of radius 4 m" if prefix == "circle:" else "square of 10 m"
    lines = [
        *_head(
            f"CrowdNav, {what}, seed {seed}", start=(0.0, -CIRCLE), goal=(0.0, CIRCLE), limit=CROWD_LIMIT, reach=7.0
        ),
        *_agents("", [_person(start, goal) for start, goal in ways]),
        f"seed: {seed}",
        "default_variant: visible",
        "variants:",
        "  visible: {}",
        "  invisible:  # they do not see the robot",
        *_agents("    ", [_person(start, goal, "sees_robot: false, ") for start, goal in ways]),
    ]
    return "\n".join(lines) + "\n"


def _dynabarn(seed: int, rng: np.random.Generator) -> str:
    """Text of the scene file of blind cylinders: the same polynomial paths at three levels of speed."""
    ways = [_polynomial(rng) for _ in range(CYLINDERS)]
    shares = rng.random(CYLINDERS)
    lines = [
        *_head(f"Like DynaBARN, seed {seed}", start=(0.0, -7.0), goal=(0.0, 7.0), limit=60.0, reach=8.5),
        f"seed: {seed}",
        "default_variant: easy",
        "variants:",
    ]
    for level, (slow, quick) in LEVELS.items():
        speeds = slow + (quick - slow) * shares
        lines += [f"  {level}:", *_agents("    ", [_cylinder(*one) for one in zip(ways, speeds, strict=True)])]
    return "\n".join(lines) + "\n"


def _polynomial(rng: np.random.Generator) -> list[Point]:
    """Points of a path there and back: x and y are polynomials over [-1, 1], scaled into the lane."""
    s = np.linspace(-1.0, 1.0, BEND)
    columns = []
    for low, high in ((LANE[0], LANE[2]), (LANE[1], LANE[3])):
        values = np.polynomial.Polynomial(rng.normal(size=ORDER + 1))(s)
        span = float(np.ptp(values))
        share = rng.uniform(0.4, 1.0) * (high - low) / max(span, 1e-6)
        middle = rng.uniform(low + 0.5 * share * span, high - 0.5 * share * span)
        columns.append(middle + share * (values - 0.5 * (values.max() + values.min())))
    way = [(float(x), float(y)) for x, y in zip(*columns, strict=True)]
    return [*way, *way[-2:0:-1]]


def _head(title: str, *, start: Point, goal: Point, limit: float, reach: float) -> list[str]:
    return [
        f"format: {FORMAT}",
        f'title: "{title}"',
        ROBOT,
        f"start: {{x: {start[0]:g}, y: {start[1]:g}, heading_deg: 90}}",
        f"bounds: [{-reach:g}, {-reach:g}, {reach:g}, {reach:g}]",
        "tasks:",
        f"  - drive_to: {{x: {goal[0]:g}, y: {goal[1]:g}, tolerance: 0.3}}",
        f"time_limit: {limit:g}",
    ]


def _agents(indent: str, entries: list[str]) -> list[str]:
    return [f"{indent}agents:", *(f"{indent}  p_{number}: {entry}" for number, entry in enumerate(entries, 1))]


def _person(start: Point, goal: Point, more: str = "") -> str:
    heading = math.degrees(math.atan2(goal[1] - start[1], goal[0] - start[0]))
    return (
        f"{{start: {{x: {start[0]:.4f}, y: {start[1]:.4f}, heading_deg: {heading:.3f}}}, "
        f"waypoints: [[{goal[0]:.4f}, {goal[1]:.4f}]], "
        f"speed_mps: {SPEED:g}, radius: {PERSON_RADIUS:g}, kind: person, behaviour: orca, {more}"
        f"acceleration_mps2: {STEP_ACCELERATION:g}}}"
    )


def _cylinder(way: list[Point], speed: float) -> str:
    points = ", ".join(f"[{x:.3f}, {y:.3f}]" for x, y in way)
    return (
        f"{{waypoints: [{points}], speed_mps: {speed:.3f}, radius: {CYLINDER_RADIUS:g}, height: 1.0, behaviour: blind, "
        "acceleration_mps2: 10}"
    )
