"""Crowds from a seed: ``circle:17`` and ``square:17`` as CrowdNav draws them, ``dynabarn:17`` as DynaBARN is described.

CrowdNav (Chen et al., Crowd-Robot Interaction, ICRA 2019): five persons of radius 0.3 m at 1 m/s, by ORCA, cross a
circle of radius 4 m, or a square of 10 m; the robot crosses from (0, -4) to (0, 4) in at most 25 s. The robot is
Frankie at 1 m/s, with its true footprint. The draws differ from those of the same seed in CrowdNav, which draws all
from one global generator.
"""

import math
import re
from collections.abc import Callable

import numpy as np

from motm_twin.model.bounds import SEED
from motm_twin.model.names import SceneError
from motm_twin.model.scene_format import FORMAT

PEOPLE, RADIUS, SPEED = 5, 0.3, 1.0  # [m], [m/s]
CIRCLE, SQUARE = 4.0, 10.0  # [m] radius, side
DISCOMFORT = 0.2  # [m] between bodies at start and goal
ROBOT_RADIUS = 0.44  # [m] of the circle round Frankie's footprint; CrowdNav's robot has 0.3
LIMIT = 25.0  # [s]
STEP_ACCELERATION = 4.0  # [m/s^2]: in CrowdNav a person stops from 1 m/s in one step of 0.25 s
ATTEMPTS = 10_000
STREAMS = {"circle:": 0xC1AC1E, "square:": 0x50A8E, "dynabarn:": 0xD7BA24}  # keep draws apart from other uses of a seed
ROBOT = "robot: {name: frankie, base: {forward_speed_mps: 1.0, reverse_speed_mps: 0.5, linear_acceleration_mps2: 1.0}}"

CYLINDERS, CYLINDER_RADIUS = 8, 0.5  # [m]
LEVELS = {"easy": (0.5, 0.9), "medium": (1.05, 1.4), "hard": (1.5, 1.85)}  # [m/s] mean speeds
LANE = (-4.0, -4.0, 4.0, 4.0)  # [m] x_min, y_min, x_max, y_max in which the cylinders move
ORDER = 3  # of the polynomials, both of x and of y
BEND = 12  # points of a way
Point = tuple[float, float]
_NAME = re.compile(r"(circle:|square:|dynabarn:)([0-9]{1,19})")


def made(asked: str) -> tuple[str, str]:
    """Name and text of the scene that a name asks for. Raises SceneError."""
    match = _NAME.fullmatch(asked)
    if match is None or SEED.refusal("seed", int(match[2])):
        raise SceneError(f"{asked[:60]!r} is no crowd: write circle:SEED, square:SEED or dynabarn:SEED, as circle:17")
    prefix, seed = match[1], int(match[2])
    rng = np.random.default_rng([seed, STREAMS[prefix]])
    text = _dynabarn(seed, rng) if prefix == "dynabarn:" else _crowd(prefix, seed, rng)
    return f"{prefix}{seed}", text


def crossings(
    rng: np.random.Generator, draw: Callable[[np.random.Generator], tuple[Point, Point]]
) -> list[tuple[Point, Point]]:
    """Starts and goals of the persons, each apart from all others and from the robot's."""
    found: list[tuple[Point, Point]] = []
    kept = [((0.0, -CIRCLE), (0.0, CIRCLE), RADIUS + ROBOT_RADIUS + DISCOMFORT)]
    for _ in range(ATTEMPTS):
        start, goal = draw(rng)
        apart = (min(math.dist(start, s), math.dist(start, g), math.dist(goal, g)) >= gap for s, g, gap in kept)
        if all(apart):
            found.append((start, goal))
            kept.append((start, goal, 2.0 * RADIUS + DISCOMFORT))
            if len(found) == PEOPLE:
                return found
    raise RuntimeError(f"no places for {PEOPLE} persons in {ATTEMPTS} attempts")


def across_circle(rng: np.random.Generator) -> tuple[Point, Point]:
    """Start on the circle, moved by up to half a metre a second each way, and the goal opposite."""
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
    """The scene file of a circle or square, with a robot that they see and one that they do not."""
    ways = crossings(rng, across_circle if prefix == "circle:" else across_square)
    what = "circle of radius 4 m" if prefix == "circle:" else "square of 10 m"
    lines = [
        *_head(f"CrowdNav, {what}, seed {seed}", start=(0.0, -CIRCLE), goal=(0.0, CIRCLE), limit=LIMIT, reach=7.0),
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
    """The scene file of cylinders on polynomials, blind, in three levels of speed: the same ways in each."""
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
    """Points of a way there and back: x and y are polynomials over [-1, 1], scaled into the lane."""
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
        f"speed_mps: {SPEED:g}, radius: {RADIUS:g}, kind: person, behaviour: orca, {more}"
        f"acceleration_mps2: {STEP_ACCELERATION:g}}}"
    )


def _cylinder(way: list[Point], speed: float) -> str:
    points = ", ".join(f"[{x:.3f}, {y:.3f}]" for x, y in way)
    return (
        f"{{waypoints: [{points}], speed_mps: {speed:.3f}, radius: {CYLINDER_RADIUS:g}, height: 1.0, behaviour: blind, "
        "acceleration_mps2: 10}"
    )
