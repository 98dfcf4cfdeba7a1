"""Scenes from a seed: ``generated:17`` or ``generated:17@0.6``, the same text for the same seed and difficulty.

A generated scene is always solvable; `layout` says why. Nothing was tuned on it.
"""

import math
import re
from typing import Any

import numpy as np
import yaml
from shapely.geometry import Point

from motm_twin.generate.layout import FLOOR, RIM, Layout, Place, Unfit, attempt, serviceable
from motm_twin.generate.pieces import Dial, dial
from motm_twin.model.bounds import SEED
from motm_twin.model.names import SceneError
from motm_twin.model.scene_format import FORMAT

PREFIX = "generated:"
DIFFICULTY = 0.5  # unless said
DIGITS = 4  # of the difficulty after the point
ATTEMPTS = 400
GROWTH = 1.01  # of the floor, per attempt: in the end everything fits
COLOURS = ("red", "green", "blue", "yellow", "orange")
WALL_ROUND = 0.14  # [m] of map round the floor, for the walls
_STREAM = 0x5CE7E  # keeps the draws apart from other uses of a seed
_NAME = re.compile(r"generated:([0-9]{1,19})(?:@([0-9]+(?:\.[0-9]*)?|\.[0-9]+))?")


def is_generated(name: str) -> bool:
    """The name asks for a generated scene."""
    return name.startswith(PREFIX)


def name_of(seed: int, difficulty: float = DIFFICULTY) -> str:
    """The name of a generated scene. Raises SceneError for a seed or a difficulty that is none."""
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
    """The text of a scene file. Raises SceneError for a seed or a difficulty that is none."""
    numbers = dial(_checked(seed, difficulty))
    for number in range(ATTEMPTS):
        try:
            layout = attempt(np.random.default_rng([seed, _STREAM, number]), numbers, GROWTH**number)
            return _text(seed, numbers, layout, _work(layout))
        except Unfit:
            continue
    raise RuntimeError(f"no scene in {ATTEMPTS} attempts for seed {seed} and difficulty {difficulty:g}")


def made(asked: str) -> tuple[str, str]:
    """Name and text of the scene that a name asks for. Raises SceneError."""
    seed, difficulty = parse_name(asked)
    return name_of(seed, difficulty), generate(seed, difficulty)


def _checked(seed: int, difficulty: float) -> float:
    """The difficulty as it is written in a name: with four digits. Raises SceneError."""
    if SEED.refusal("seed", seed):
        raise SceneError(f"the seed of a generated scene is a whole number from 0 to 2^63 - 1, got {seed}")
    if not (math.isfinite(difficulty) and 0.0 <= difficulty <= 1.0):
        raise SceneError(f"the difficulty of a generated scene is from 0 (easy) to 1 (hard), got {difficulty:g}")
    return round(difficulty, DIGITS)


def _work(layout: Layout) -> dict[str, Any]:
    """Cubes, bins and tasks: every cube into one of the bins, places to drive to between them."""
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
    """Cubes on places that can be served, some on every surface, in the order in which they are fetched."""
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
    """The scene file: one line for each entry, as in the shipped ones."""
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
