"""The PathRTR cost at any pose, with what is seen from the cells of the map found when first asked for."""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.planning.collision import Field
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.kernel import inlined, kernel
from motm_twin.planning.least_cost import cost_from
from motm_twin.planning.search_memory import CellSights, World
from motm_twin.planning.visibility import Graph, push_out, visible_vertices

IntArray = NDArray[np.int32]


@kernel
def _look_round(c: int, field: Field, graph: Graph, cells: CellSights, scratch: IntArray) -> None:
    """Find what is seen from the middle of map cell c. A store that is full starts anew."""
    px = field.x + (c % cells.shape[1] + 0.5) / field.inverse_cell
    py = field.y + (c // cells.shape[1] + 0.5) / field.inverse_cell
    qx, qy, pushed = push_out(px, py, graph.outline, graph.solids)
    found = visible_vertices(qx, qy, graph, scratch)
    if cells.used[0] + found > cells.pool.shape[0]:
        cells.used[0] = 0
        cells.newest[0] += 1
    first = cells.used[0]
    for k in range(found):
        cells.pool[first + k] = scratch[k]
    cells.point[c, 0], cells.point[c, 1], cells.point[c, 2] = qx, qy, pushed
    cells.start[c], cells.count[c], cells.age[c] = first, found, cells.newest[0]
    cells.used[0] = first + found


@inlined
def cost_at(
    x: float, y: float, heading: float, table: Table, world: World, cells: CellSights, scratch: IntArray
) -> float:
    """PathRTR cost [s] from a pose to the goals of a table."""
    i = int(math.floor((x - world.field.x) * world.field.inverse_cell))
    j = int(math.floor((y - world.field.y) * world.field.inverse_cell))
    i, j = min(max(i, 0), cells.shape[1] - 1), min(max(j, 0), cells.shape[0] - 1)
    c = j * cells.shape[1] + i
    if cells.age[c] != cells.newest[0]:
        _look_round(c, world.field, world.graph, cells, scratch)
    first = cells.start[c]
    sx, sy, pushed = cells.point[c, 0], cells.point[c, 1], cells.point[c, 2]
    if pushed == 0.0:
        sx, sy = x, y
    seen = cells.pool[first : first + cells.count[c]]
    return cost_from(x, y, heading, sx, sy, pushed, seen, world.graph, table)
