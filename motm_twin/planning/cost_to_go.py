"""PathRTR cost from any pose to goal poses, over the directed edges of the visibility graph (Paper, Sec. III-B).

The cost of a path with turning depends on the direction from which a corner is reached, so the state of the search is
the directed edge (u -> v), not the vertex. `Table` holds, for every directed edge, the least time from the start of
the edge to a goal, forwards and in reverse, with all turns and the turn to the goal heading.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.kernels import heap_pop, heap_push, inlined, kernel, length_of
from motm_twin.planning.rtr import turn
from motm_twin.planning.visibility import FAR, Graph, push_out, segment_free, tangential, visible_vertices

IntArray = NDArray[np.int32]
BESIDE = 0.10  # [m] a point at most this deep inside a grown polygon is treated as if it were outside
Cheapest = tuple[float, bool, int, int]  # cost [s], in reverse, first vertex (-1: straight), `Table.follow` after it


class Rates(NamedTuple):
    """Seconds per metre forwards and in reverse, seconds per radian (0: turning is free)."""

    front: float
    back: float
    turn: float


class Table(NamedTuple):
    """Costs of all directed edges to the goals, which stand at sites (places with one or more headings)."""

    site: Array  # (s, 5) end of the path x, y; point from which sight is tested x, y; [m] from the end to the place
    goal_start: IntArray  # (s + 1,)
    goal: Array  # (goals, 2) heading [rad], nan: free; offset [s] added to the cost of ending there
    exit_start: IntArray  # (n + 1,) straight lines from vertex v to sites
    exit_site: IntArray
    exit: Array  # (m, 3) direction, [s] drive and final turn forwards and in reverse
    way: Array  # (e, 2) [s] from the start of each directed edge to a goal, forwards and in reverse
    follow: IntArray  # (e, 2) edge that follows, or -1 - k for exit k
    bound: Array  # (n,) [s] lower bound of the cost from each vertex on
    rates: Rates


@inlined
def final_costs(site: int, angle: float, table: Table) -> tuple[float, float]:
    """Least turn and offset [s] at a site that is reached in direction `angle`, forwards and in reverse."""
    front, back = FAR, FAR
    for j in range(table.goal_start[site], table.goal_start[site + 1]):
        spin, spin_back = 0.0, 0.0
        if not math.isnan(table.goal[j, 0]):
            spin = turn(angle, table.goal[j, 0])
            spin_back = math.pi - spin
        front = min(front, spin * table.rates.turn + table.goal[j, 1])
        back = min(back, spin_back * table.rates.turn + table.goal[j, 1])
    return front, back


@kernel
def _settle(
    graph: Graph, side: int, rate: float, turn_rate: float, way: Array, follow: IntArray, key: Array, item: IntArray
) -> None:
    """Dijkstra over directed edges, backwards from the goals.

    Column `side` of way (e, 2): cost [s] to a goal, on entry from the end of each edge, on return from its start.
    """
    n_edges = graph.ends.shape[0]
    size = key.shape[0] - key.shape[0]  # a plain int, not the literal 0: one compilation of the heap is enough
    for e in range(n_edges):
        way[e, side] += graph.edge[e, 0] * rate
        if way[e, side] < FAR:
            size = heap_push(key, item, size, way[e, side], e)
    while size > 0:
        reached, e = key[0], item[0]
        size = heap_pop(key, item, size)
        if reached > way[e, side]:
            continue
        u = graph.ends[e, 0]
        for k in range(graph.in_start[u], graph.in_start[u + 1]):
            d = graph.in_edge[k]
            if graph.ends[d, 0] == graph.ends[e, 1]:
                continue
            spin = turn(graph.edge[d, 1], graph.edge[e, 1]) * turn_rate
            through = graph.edge[d, 0] * rate + spin + reached
            if through < way[d, side] - 1e-12 and size < key.shape[0]:
                way[d, side] = through
                follow[d, side] = e
                size = heap_push(key, item, size, through, d)


@kernel
def _fill(graph: Graph, place: Array, table: Table, key: Array, item: IntArray) -> None:
    """Compute the arrays of a table, allocated but empty; key and item are buffers for a queue."""
    n, n_sites, n_edges = graph.vertex.shape[0], place.shape[0], graph.ends.shape[0]
    site = table.site
    for s in range(n_sites):
        qx, qy, pushed = push_out(place[s, 0], place[s, 1], graph.outline, graph.solids)
        site[s, 0], site[s, 1], site[s, 2], site[s, 3] = place[s, 0], place[s, 1], qx, qy
        if pushed > BESIDE:
            site[s, 0], site[s, 1], site[s, 4] = qx, qy, pushed
    count = 0
    for v in range(n):
        vx, vy = graph.vertex[v, 0], graph.vertex[v, 1]
        for s in range(n_sites):
            if not tangential(v, site[s, 2] - vx, site[s, 3] - vy, graph.vertex):
                continue
            if not segment_free(vx, vy, site[s, 2], site[s, 3], graph.walls):
                continue
            dx, dy = site[s, 0] - vx, site[s, 1] - vy
            length = length_of(dx, dy) + site[s, 4]
            angle = math.atan2(dy, dx)
            front, back = final_costs(s, angle, table)
            table.exit_site[count] = s
            table.exit[count, 0] = angle
            table.exit[count, 1], table.exit[count, 2] = (
                length * table.rates.front + front,
                length * table.rates.back + back,
            )
            count += 1
        table.exit_start[v + 1] = count
    for e in range(n_edges):
        v = graph.ends[e, 1]
        for k in range(table.exit_start[v], table.exit_start[v + 1]):
            spin = turn(graph.edge[e, 1], table.exit[k, 0]) * table.rates.turn
            for side in range(2):
                if spin + table.exit[k, 1 + side] < table.way[e, side]:
                    table.way[e, side], table.follow[e, side] = spin + table.exit[k, 1 + side], -1 - k
    for side in range(2):
        _settle(
            graph,
            side,
            table.rates.back if side == 1 else table.rates.front,
            table.rates.turn,
            table.way,
            table.follow,
            key,
            item,
        )
    for v in range(n):
        for k in range(table.exit_start[v], table.exit_start[v + 1]):
            table.bound[v] = min(table.bound[v], table.exit[k, 1], table.exit[k, 2])
        for e in range(graph.out_start[v], graph.out_start[v + 1]):
            table.bound[v] = min(table.bound[v], table.way[e, 0], table.way[e, 1])


def make_table(graph: Graph, place: Array, goal_start: IntArray, goal: Array, rates: Rates) -> Table:
    """The costs to goals (heading, offset) at places (s, 2), whose goals are goal_start[s] .. goal_start[s + 1] - 1."""
    n, n_sites, n_edges = len(graph.vertex), len(place), len(graph.ends)
    table = Table(
        site=np.zeros((n_sites, 5)),
        goal_start=goal_start,
        goal=goal,
        exit_start=np.zeros(n + 1, np.int32),
        exit_site=np.zeros(n * n_sites, np.int32),
        exit=np.zeros((n * n_sites, 3)),
        way=np.full((n_edges, 2), FAR),
        follow=np.zeros((n_edges, 2), np.int32),
        bound=np.full(n, FAR),
        rates=rates,
    )
    _fill(graph, place, table, np.empty(20 * n_edges), np.empty(20 * n_edges, np.int32))
    return table


@inlined
def cheapest_outside(
    px: float, py: float, heading: float, sx: float, sy: float, visible: IntArray, graph: Graph, table: Table
) -> Cheapest:
    """The cheapest path from a pose outside the grown polygons.

    (sx, sy) is the point from which sight is tested, and from which the vertices `visible` are seen. Sites and vertices
    that cannot improve on the best path so far are skipped; the most promising vertex comes first. The order changes no
    bit of the result, since adding a non-negative number never lowers a rounded sum.
    """
    found, rates = (FAR, False, -1, 0), table.rates
    for s in range(table.site.shape[0]):
        dx, dy = table.site[s, 0] - px, table.site[s, 1] - py
        length = length_of(dx, dy)
        total = length + table.site[s, 4]
        if total * rates.front >= found[0]:
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
        if cost < found[0] and segment_free(sx, sy, table.site[s, 2], table.site[s, 3], graph.walls):
            found = (cost, back < front, -1, -1 - s)
    likeliest, lowest = -1, found[0]
    for i in range(visible.shape[0]):
        v = visible[i]
        low = length_of(graph.vertex[v, 0] - px, graph.vertex[v, 1] - py) * rates.front + table.bound[v]
        if low < lowest:
            likeliest, lowest = i, low
    if likeliest < 0:
        return found
    for k in range(-1, visible.shape[0]):
        if k == likeliest:
            continue
        v = visible[likeliest if k < 0 else k]
        dx, dy = graph.vertex[v, 0] - px, graph.vertex[v, 1] - py
        length = length_of(dx, dy)
        if length * rates.front + table.bound[v] < found[0]:
            found = _through(v, length, math.atan2(dy, dx) if length > 1e-6 else heading, heading, found, graph, table)
    return found


@inlined
def _through(
    v: int, length: float, angle: float, heading: float, found: Cheapest, graph: Graph, table: Table
) -> Cheapest:
    """The cheapest path so far, or that through vertex v, `length` [m] away in direction `angle`, if cheaper."""
    rates = table.rates
    best, in_reverse, via, follow = found
    a_0 = turn(heading, angle)
    front_0 = a_0 * rates.turn + length * rates.front
    back_0 = (math.pi - a_0) * rates.turn + length * rates.back
    if front_0 + table.bound[v] >= best and back_0 + table.bound[v] >= best:
        return found
    for k in range(table.exit_start[v], table.exit_start[v + 1]):
        if front_0 + table.exit[k, 1] >= best and back_0 + table.exit[k, 2] >= best:
            continue
        spin = turn(angle, table.exit[k, 0]) * rates.turn
        front, back = front_0 + spin + table.exit[k, 1], back_0 + spin + table.exit[k, 2]
        if min(front, back) < best:
            best, in_reverse, via, follow = min(front, back), back < front, v, -1 - k
    for e in range(graph.out_start[v], graph.out_start[v + 1]):
        if front_0 + table.way[e, 0] >= best and back_0 + table.way[e, 1] >= best:
            continue
        spin = turn(angle, graph.edge[e, 1]) * rates.turn
        front, back = front_0 + spin + table.way[e, 0], back_0 + spin + table.way[e, 1]
        if min(front, back) < best:
            best, in_reverse, via, follow = min(front, back), back < front, v, e
    return (best, in_reverse, via, follow)


@kernel
def way_out(
    px: float, py: float, heading: float, sx: float, sy: float, pushed: float, back: bool, rates: Rates
) -> tuple[float, float, float, float]:
    """Pose on arrival at the point outside, driven to forwards or in reverse, and the time [s] until then."""
    out = math.atan2(sy - py, sx - px)
    a_0 = turn(heading, out)
    if back:
        return sx, sy, out + math.pi, (math.pi - a_0) * rates.turn + pushed * rates.back
    return sx, sy, out, a_0 * rates.turn + pushed * rates.front


@inlined
def cheapest(
    px: float, py: float, heading: float, sx: float, sy: float, pushed: float, visible: IntArray, graph: Graph,
    table: Table,
) -> Cheapest:  # fmt: skip
    """The cheapest path from any pose; (sx, sy) is its point outside the grown polygons, `pushed` [m] away.

    From deep inside (a pocket, a gap narrower than the growth) the way leads to that point, forwards or in reverse,
    and on from there in whichever direction is best.
    """
    best = (FAR, False, -1, 0)
    for way in range(2):
        x, y, facing, spent = px, py, heading, 0.0
        if pushed > BESIDE:
            x, y, facing, spent = way_out(px, py, heading, sx, sy, pushed, way == 1, table.rates)
        found = cheapest_outside(x, y, facing, sx, sy, visible, graph, table)
        if spent + found[0] < best[0]:
            best = (spent + found[0], found[1], found[2], found[3])
        if pushed <= BESIDE:
            break
    return best


@kernel
def _trace(
    px: float, py: float, heading: float, graph: Graph, table: Table, scratch: IntArray, path: Array
) -> tuple[int, bool, int]:
    """Write the path; returns its size, True if it is driven in reverse, and the site (-1: no path)."""
    path[0, 0], path[0, 1] = px, py
    size = 1
    sx, sy, pushed = push_out(px, py, graph.outline, graph.solids)
    visible = scratch[: visible_vertices(sx, sy, graph, scratch)]
    cost, in_reverse, via, follow = cheapest(px, py, heading, sx, sy, pushed, visible, graph, table)
    if cost >= FAR:
        return 1, False, -1
    if pushed > BESIDE:
        path[1, 0], path[1, 1] = sx, sy
        size = 2
    site = -1 - follow
    if via >= 0:
        path[size, 0], path[size, 1] = graph.vertex[via, 0], graph.vertex[via, 1]
        size += 1
        while follow >= 0 and size < path.shape[0] - 1:
            v = graph.ends[follow, 1]
            path[size, 0], path[size, 1] = graph.vertex[v, 0], graph.vertex[v, 1]
            size += 1
            follow = table.follow[follow, 1 if in_reverse else 0]
        site = table.exit_site[-1 - follow] if follow < 0 else -1
    if site >= 0:
        path[size, 0], path[size, 1] = table.site[site, 0], table.site[site, 1]
        size += 1
    return size, in_reverse, site


def trace(px: float, py: float, heading: float, graph: Graph, table: Table) -> tuple[Array, bool, int]:
    """Cheapest path from a pose: points (m, 2), True if it is driven in reverse, site (-1: no path)."""
    n = len(graph.vertex)
    path = np.empty((n + 4, 2))
    size, in_reverse, site = _trace(px, py, heading, graph, table, np.empty(n + 1, np.int32), path)
    return path[:size].copy(), in_reverse, site
