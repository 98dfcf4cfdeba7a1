"""The cost alone of the cheapest path from a pose: what the local search and base placement ask thousands of times."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.cost_to_go import BESIDE, FAR, Table, final_costs, way_out
from motm_twin.planning.kernel import inlined, kernel, length_of
from motm_twin.planning.rtr import turn
from motm_twin.planning.visibility import Graph, push_out, segment_free, visible_vertices

IntArray = NDArray[np.int32]


@inlined
def least_outside(
    px: float, py: float, heading: float, sx: float, sy: float, visible: IntArray, graph: Graph, table: Table
) -> float:
    """The cost of `cost_outside` alone. What cannot be less than the best so far is left out, the likeliest is first.

    A sum of rounded numbers never falls when a number is added that is not negative: the same minimum, to the bit.
    """
    best, rates = FAR, table.rates
    for s in range(table.site.shape[0]):
        dx, dy = table.site[s, 0] - px, table.site[s, 1] - py
        length = length_of(dx, dy)
        total = length + table.site[s, 4]
        if total * rates.front >= best:
            continue
        straight = length >= 1e-6
        angle = math.atan2(dy, dx) if straight else heading
        front, back = final_costs(s, angle, table)
        if straight:
            a_0 = turn(heading, angle)
            front += a_0 * rates.turn + total * rates.front
            back += (math.pi - a_0) * rates.turn + total * rates.back
        else:
            front += total * rates.front
            back = FAR
        cost = min(front, back)
        if cost < best and segment_free(sx, sy, table.site[s, 2], table.site[s, 3], graph.walls):
            best = cost
    likeliest, lowest = -1, best
    for i in range(visible.shape[0]):
        v = visible[i]
        low = length_of(graph.vertex[v, 0] - px, graph.vertex[v, 1] - py) * rates.front + table.bound[v]
        if low < lowest:
            likeliest, lowest = i, low
    if likeliest < 0:
        return best
    for k in range(-1, visible.shape[0]):
        if k == likeliest:
            continue
        v = visible[likeliest if k < 0 else k]
        dx, dy = graph.vertex[v, 0] - px, graph.vertex[v, 1] - py
        length = length_of(dx, dy)
        if length * rates.front + table.bound[v] < best:
            best = _through(v, length, dx, dy, heading, best, graph, table)
    return best


@inlined
def _through(
    v: int, length: float, dx: float, dy: float, heading: float, best: float, graph: Graph, table: Table
) -> float:
    """The best cost [s] so far, or that through vertex v, (dx, dy) away, when it is less."""
    rates = table.rates
    angle = math.atan2(dy, dx) if length > 1e-6 else heading
    a_0 = turn(heading, angle)
    front_0 = a_0 * rates.turn + length * rates.front
    back_0 = (math.pi - a_0) * rates.turn + length * rates.back
    if front_0 + table.bound[v] >= best and back_0 + table.bound[v] >= best:
        return best
    for k in range(table.exit_start[v], table.exit_start[v + 1]):
        if front_0 + table.exit[k, 1] >= best and back_0 + table.exit[k, 2] >= best:
            continue
        spin = turn(angle, table.exit[k, 0]) * rates.turn
        best = min(best, front_0 + spin + table.exit[k, 1], back_0 + spin + table.exit[k, 2])
    for e in range(graph.out_start[v], graph.out_start[v + 1]):
        if front_0 + table.way[e, 0] >= best and back_0 + table.way[e, 1] >= best:
            continue
        spin = turn(angle, graph.edge[e, 1]) * rates.turn
        best = min(best, front_0 + spin + table.way[e, 0], back_0 + spin + table.way[e, 1])
    return best


@inlined
def cost_from(
    px: float, py: float, heading: float, sx: float, sy: float, pushed: float, visible: IntArray, graph: Graph,
    table: Table,
) -> float:  # fmt: skip
    """Cost [s] from any pose; (sx, sy) is its point outside the grown polygons, `pushed` [m] away.

    From deep inside (a pocket, a gap narrower than the growth) the way leads to that point, forwards or in reverse,
    and on from there in whichever direction is best.
    """
    best = FAR
    for way in range(2):
        x, y, facing, spent = px, py, heading, 0.0
        if pushed > BESIDE:
            x, y, facing, spent = way_out(px, py, heading, sx, sy, pushed, way == 1, table.rates)
        best = min(best, spent + least_outside(x, y, facing, sx, sy, visible, graph, table))
        if pushed <= BESIDE:
            break
    return best


class Sights(NamedTuple):
    """What is seen from a list of places: point outside (m, 3 with how far), vertices in compressed rows."""

    point: Array
    start: IntArray
    vertex: IntArray


@kernel
def _look(place: Array, graph: Graph, sights: Sights) -> int:
    count = 0
    for i in range(place.shape[0]):
        qx, qy, pushed = push_out(place[i, 0], place[i, 1], graph.outline, graph.solids)
        sights.point[i, 0], sights.point[i, 1], sights.point[i, 2] = qx, qy, pushed
        count += visible_vertices(qx, qy, graph, sights.vertex[count:])
        sights.start[i + 1] = count
    return count


def sights_of(place: Array, graph: Graph) -> Sights:
    """The vertices seen from places, shape (m, 2)."""
    m, n = len(place), len(graph.vertex)
    sights = Sights(np.empty((m, 3)), np.zeros(m + 1, np.int32), np.empty(m * n, np.int32))
    _look(place, graph, sights)
    return sights


@kernel
def _costs(poses: Array, place_of: IntArray, sights: Sights, graph: Graph, table: Table, result: Array) -> None:
    for i in range(poses.shape[0]):
        p = place_of[i]
        seen = sights.vertex[sights.start[p] : sights.start[p + 1]]
        x, y, pushed = sights.point[p, 0], sights.point[p, 1], sights.point[p, 2]
        cost = cost_from(poses[i, 0], poses[i, 1], poses[i, 2], x, y, pushed, seen, graph, table)
        result[i] = cost if cost < FAR else math.inf


def costs_from(poses: Array, place_of: IntArray, sights: Sights, graph: Graph, table: Table) -> Array:
    """Costs [s] of poses (m, 3), pose i standing at place place_of[i] of `sights`; inf: no path."""
    result = np.empty(len(poses))
    _costs(poses, place_of, sights, graph, table, result)
    return result
