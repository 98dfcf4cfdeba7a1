"""Costs of leaving a place where the robot cannot turn on the spot, on a lattice of poses round it.

PathRTR turns on the spot wherever it has to. Where an obstacle is nearer to the axle than a corner of the footprint is,
that is impossible: the robot has to back out first. A short search does not find that, since every motion that begins
so seems longer than one that cannot be driven. Here the costs of all poses round the robot are computed on a lattice of
16 headings on which the footprint must be free, out to poses where it can turn on the spot, or to the edge of the
lattice: there PathRTR holds.
"""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import angle_of
from motm_twin.model.geometry import Array
from motm_twin.planning.collision import Body, Field, clearance, clearance_from, distance_at
from motm_twin.planning.cost_to_go import FAR
from motm_twin.planning.kernels import heap_pop, heap_push, kernel
from motm_twin.planning.rtr import TWO_PI, turn
from motm_twin.planning.search_memory import CellVisibility, LatticeCosts, Settings, World, cost_at

IntArray = NDArray[np.int32]
CELL = 0.1  # [m] of the lattice
ROUND = 0.5  # [m] of the lattice beyond the longer side of the base, each way: 25 x 25 cells for Frankie
BLUR = 0.02  # [m] by which a pose, rounded to the lattice, may be nearer to an obstacle than the search allows
STEPS = np.array(
    [(1, 0), (2, 1), (1, 1), (1, 2), (0, 1), (-1, 2), (-1, 1), (-2, 1),
     (-1, 0), (-2, -1), (-1, -1), (-1, -2), (0, -1), (1, -2), (1, -1), (2, -1)], np.int32,
)  # fmt: skip  # cells that the robot drives in one step at each heading
HEADINGS = len(STEPS)
ANGLES = angle_of(STEPS[:, 1], STEPS[:, 0]).astype(np.float64)
LENGTHS = CELL * np.hypot(STEPS[:, 0], STEPS[:, 1])
WIDE, NARROW, TAKEN = 0, 1, 2  # kinds of cells: where the robot turns on the spot, where it does not, obstacles
NO_LATTICE = LatticeCosts(np.empty((0, 0, HEADINGS)), 0.0, 0.0)


def swept_radius(body: Body) -> float:
    """Radius [m] of the circle about the axle's middle that the footprint sweeps when it turns on the spot."""
    return float(np.hypot(body.corner[:, 0], body.corner[:, 1]).max())


def cells_of(body: Body) -> int:
    """Cells of the lattice each way, the robot in the middle."""
    across = body.corner[3] - body.corner[0]
    return 1 + 2 * math.ceil((float(across.max()) + ROUND) / CELL - 1e-9)


def half_width(body: Body) -> float:
    """Half of the lattice [m]."""
    return 0.5 * CELL * cells_of(body)


def cannot_turn(pose: Array, s: Settings, world: World) -> bool:
    """Test that the robot cannot turn on the spot at a pose (3,), unless the goal is in such a place beside it."""
    wide = swept_radius(world.body) + s.margin
    here = distance_at(float(pose[0]), float(pose[1]), world.field)
    goal = distance_at(s.goal_x, s.goal_y, world.field)
    beside = max(abs(s.goal_x - pose[0]), abs(s.goal_y - pose[1])) < half_width(world.body)
    return here < wide and not (beside and goal < wide)


def settle_lattice(pose: Array, s: Settings, world: World, cells: CellVisibility, scratch: IntArray) -> LatticeCosts:
    """The costs round a pose (3,)."""
    cells_each, half = cells_of(world.body), half_width(world.body)
    count = cells_each * cells_each * HEADINGS
    costs = LatticeCosts(np.full((cells_each, cells_each, HEADINGS), FAR), float(pose[0]) - half, float(pose[1]) - half)
    kind = np.zeros((cells_each, cells_each), np.int32)
    key, item = np.empty(6 * count), np.empty(6 * count, np.int32)
    root = clearance(float(pose[0]), float(pose[1]), float(pose[2]), 1.0, world.field, world.body)
    allowed = (s.margin if root >= s.margin else min(s.margin_floor, root)) - BLUR
    _fill(swept_radius(world.body) + s.margin, allowed, world, cells, scratch, costs, kind, key, item)
    return costs


@kernel
def lattice_cost(x: float, y: float, heading: float, turn_rate: float, costs: LatticeCosts) -> float:
    """Cost [s] of a pose, with the turn to the better heading of the lattice; `FAR` where the lattice has none."""
    i = int(math.floor((x - costs.x) / CELL))
    j = int(math.floor((y - costs.y) / CELL))
    if i < 0 or j < 0 or i >= costs.value.shape[1] or j >= costs.value.shape[0]:
        return FAR
    turns = heading / TWO_PI
    k = int((turns - math.floor(turns)) * HEADINGS)  # headings of the lattice are less than one place off equal parts
    best = FAR
    for c in range(k - 1, k + 3):
        value = costs.value[j, i, c % HEADINGS]
        if value < FAR:
            best = min(best, value + turn(heading, ANGLES[c % HEADINGS]) * turn_rate)
    return best


@kernel
def _fill(
    wide: float, allowed: float, world: World, cells: CellVisibility, scratch: IntArray, costs: LatticeCosts,
    kind: IntArray, key: Array, item: IntArray,
) -> None:  # fmt: skip
    """Compute the costs of all poses with a way to one that can turn on the spot, or to the edge."""
    n, value = costs.value.shape[0], costs.value
    for j in range(n):
        for i in range(n):
            d = distance_at(costs.x + (i + 0.5) * CELL, costs.y + (j + 0.5) * CELL, world.field)
            kind[j, i] = WIDE if d >= wide else TAKEN if d < world.body.inner + allowed else NARROW
    size = n - n  # a plain int, not the literal 0: one compilation of the heap is enough
    for j in range(n):
        for i in range(n):
            edge = kind[j, i] == NARROW and (i < 2 or j < 2 or i >= n - 2 or j >= n - 2)
            if not edge and (kind[j, i] != WIDE or not _beside_narrow(i, j, kind)):
                continue
            x, y = costs.x + (i + 0.5) * CELL, costs.y + (j + 0.5) * CELL
            for k in range(HEADINGS):
                if edge and not _is_free(i, j, k, allowed, costs, world.field, world.body):
                    continue
                cost = cost_at(x, y, ANGLES[k], world.table, world, cells, scratch)
                if cost < FAR:
                    value[j, i, k] = cost
                    size = heap_push(key, item, size, cost, (j * n + i) * HEADINGS + k)
    rates = world.table.rates
    while size > 0:
        reached, at = key[0], item[0]
        size = heap_pop(key, item, size)
        k, i, j = at % HEADINGS, at // HEADINGS % n, at // (HEADINGS * n)
        if reached > value[j, i, k]:
            continue
        for move in range(4):
            if move < 2:  # from a pose that drives here, forwards or in reverse
                way = -1 if move == 0 else 1
                a, b, c = i + way * STEPS[k, 0], j + way * STEPS[k, 1], k
                cost = reached + LENGTHS[k] * (rates.front if move == 0 else rates.back)
            else:
                a, b, c = i, j, (k + (1 if move == 2 else HEADINGS - 1)) % HEADINGS
                cost = reached + turn(ANGLES[k], ANGLES[c]) * rates.turn
            if a < 0 or b < 0 or a >= n or b >= n or kind[b, a] != NARROW or cost >= value[b, a, c]:
                continue
            if _is_free(a, b, c, allowed, costs, world.field, world.body):
                value[b, a, c] = cost
                size = heap_push(key, item, size, cost, (b * n + a) * HEADINGS + c)
    for j in range(n):
        for i in range(n):
            if kind[j, i] == WIDE:
                for k in range(HEADINGS):
                    value[j, i, k] = FAR


@kernel
def _beside_narrow(i: int, j: int, kind: IntArray) -> bool:
    """Test that a step from the cell may lead to a narrow one."""
    n = kind.shape[0]
    for b in range(max(0, j - 2), min(n, j + 3)):
        for a in range(max(0, i - 2), min(n, i + 3)):
            if kind[b, a] == NARROW:
                return True
    return False


@kernel
def _is_free(i: int, j: int, k: int, allowed: float, costs: LatticeCosts, field: Field, body: Body) -> bool:
    x, y = costs.x + (i + 0.5) * CELL, costs.y + (j + 0.5) * CELL
    c, s = math.cos(ANGLES[k]), math.sin(ANGLES[k])
    return clearance_from(x, y, c, s, allowed + 0.01, allowed, field, body) >= allowed
