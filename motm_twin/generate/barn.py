"""Worlds like those of the BARN challenge from a seed: ``barn:17``, the same text for the same seed.

Rewritten from the published description (Perille, Truong, Xiao, Stone: Benchmarking Metric Ground Navigation, 2020),
not from its files: a lane 4.5 m wide, on 4.5 m of which a cellular automaton puts cylinders of radius 0.075 m. A cell
of 0.15 m is filled at first with a probability of 0.15 to 0.30. It is then filled when at least 5 of its 8 neighbours
are, and cleared when at most 1 is, 2 to 4 times over. Seed k has the (k mod 12)th of these 12 settings. A world without
a way for a square of 5 x 5 cells is drawn again, with 2 in 1,000 less filled at first. The robot is the nominal Jackal;
it has 10 m to go, and its map shows nothing.
"""

import re

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
THINNER = 0.998  # of the initial fill, per attempt: in the end there is a path
STREAM = 0xBA24  # keeps these draws apart from other uses of a seed
START, GOAL, TOLERANCE = (-2.25, 3.0), (-2.25, 13.0), 1.0  # [m]
LIMIT = 100.0  # [s] from the first 0.1 m on
NOMINAL = {
    "forward_speed_mps": 2.0, "reverse_speed_mps": 1.0, "yaw_rate_dps": 180, "linear_acceleration_mps2": 3.0,
    "yaw_acceleration_dps2": 573, "velocity_lag": 0.1,
}  # fmt: skip
CONTROLLER = {
    "forward_speed_mps": 2.0, "reverse_speed_mps": 2.0, "yaw_rate_dps": 229, "linear_acceleration_mps2": 20.0,
    "yaw_acceleration_dps2": 1432, "velocity_lag": 0.05,
}  # fmt: skip
_NAME = re.compile(r"barn:([0-9]{1,19})")
Cells = NDArray[np.bool_]


def made(asked: str) -> tuple[str, str]:
    """Name and text of the world that a name asks for. Raises SceneError."""
    match = _NAME.fullmatch(asked)
    if match is None or SEED.refusal("seed", int(match[1])):
        raise SceneError(f"{asked[:60]!r} is no world like those of BARN: write barn:SEED, as barn:17, up to 2^63 - 1")
    seed = int(match[1])
    return f"{PREFIX}{seed}", barn(seed)


def barn(seed: int) -> str:
    """The text of a scene file for a seed from 0 on."""
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
    """The robot's square of cells can cross the field, diagonal steps included."""
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
    """The scene file, as the converted worlds of the challenge are written."""
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
