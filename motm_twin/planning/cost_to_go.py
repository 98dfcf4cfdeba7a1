"""PathRTR cost from any pose to a set of goal poses, over the directed edges of the visibility graph, as kernels.

The cost of a path with turning depends on the direction from which a corner is reached, so the state of the search is
the directed edge (u -> v), not the vertex. `Table` holds, for every directed edge, the least time from the start of
the edge to a goal, forwards and in reverse, with all turns and the turn to the goal heading.
"""

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.heap import heap_pop, heap_push
from motm_twin.planning.kernel import inlined, kernel, length_of
from motm_twin.planning.rtr import turn
from motm_twin.planning.visibility import Graph, push_out, segment_free, tangential, visible_vertices

IntArray = NDArray[np.int32]
BESIDE = 0.10  # [m] a point this little inside a grown polygon is treated as if it were outside
FAR = 1e9  # [s] no path


class Rates(NamedTuple):
    """Seconds per metre forwards and in reverse, seconds per radian (0: turning is free)."""

    front: float
    back: float
    turn: float


class Table(NamedTuple):
    """Costs of all directed edges to the goals, which stand at sites (places with one or more headings)."""

    site: Array  # (s, 2) [m], where the path ends (outside the grown polygons)
    seen: Array  # (s, 2) [m], the point from which sight is tested
    extra: Array  # (s,) [m] from there to the true position
    goal_start: IntArray  # (s + 1,)
    goal_heading: Array  # (goals,) [rad], nan: free
    goal_offset: Array  # (goals,) [s] added to the cost of ending there
    exit_start: IntArray  # (n + 1,) straight lines from vertex v to sites
    exit_site: IntArray
    exit_angle: Array
    exit_front: Array  # [s] drive and final turn
    exit_back: Array
    front: Array  # (e,) [s] from the start of each directed edge to a goal
    back: Array
    next_front: IntArray  # (e,) edge that follows, or -1 - k for exit k
    next_back: IntArray
    bound: Array  # (n,) [s] no way on from a vertex is cheaper than this
    rates: Rates


@inlined
def final_cost(site: int, angle: float, back: bool, table: Table) -> float:
    """Least turn and offset [s] at a site that is reached in direction `angle`."""
    best = FAR
    for j in range(table.goal_start[site], table.goal_start[site + 1]):
        spin = 0.0
        if not math.isnan(table.goal_heading[j]):
            spin = turn(angle, table.goal_heading[j])
            if back:
                spin = math.pi - spin
        best = min(best, spin * table.rates.turn + table.goal_offset[j])
    return best


@njit(cache=True)
def _settle(graph: Graph, first: Array, first_exit: IntArray, rate: float, turn_rate: float, cost: Array) -> IntArray:
    """Dijkstra over directed edges, backwards from the goals; fills `cost`, returns what follows each edge."""
    n_edges = graph.edge_to.shape[0]
    follow = first_exit.copy()
    key = np.empty(4 * n_edges + 16 * n_edges)
    item = np.empty(20 * n_edges, np.int32)
    size = 0
    for e in range(n_edges):
        cost[e] = first[e] + graph.edge_length[e] * rate
        if cost[e] < FAR:
            size = heap_push(key, item, size, cost[e], e)
    while size > 0:
        reached, e = key[0], item[0]
        size = heap_pop(key, item, size)
        if reached > cost[e]:
            continue
        u = graph.edge_from[e]
        for k in range(graph.in_start[u], graph.in_start[u + 1]):
            d = graph.in_edge[k]
            if graph.edge_from[d] == graph.edge_to[e]:
                continue
            through = graph.edge_length[d] * rate + turn(graph.edge_angle[d], graph.edge_angle[e]) * turn_rate + reached
            if through < cost[d] - 1e-12 and size < key.shape[0]:
                cost[d] = through
                follow[d] = e
                size = heap_push(key, item, size, through, d)
    return follow


@njit(cache=True)
def make_table(graph: Graph, place: Array, goal_start: IntArray, heading: Array, offset: Array, rates: Rates) -> Table:
    """The costs to goals at places (s, 2), each with headings goal_start[s] .. goal_start[s + 1] - 1."""
    n, n_sites, n_edges = graph.vertex.shape[0], place.shape[0], graph.edge_to.shape[0]
    site, seen, extra = place.copy(), place.copy(), np.zeros(n_sites)
    for s in range(n_sites):
        qx, qy, pushed = push_out(place[s, 0], place[s, 1], graph.outline, graph.solids)
        seen[s, 0], seen[s, 1] = qx, qy
        if pushed > BESIDE:
            site[s, 0], site[s, 1], extra[s] = qx, qy, pushed
    none = np.zeros(0)
    nothing = np.zeros(0, np.int32)
    goals = Table(
        site, seen, extra, goal_start, heading, offset, nothing, nothing, none, none, none, none, none,
        nothing, nothing, none, rates,
    )  # fmt: skip
    exit_start = np.zeros(n + 1, np.int32)
    exit_site = np.empty(n * n_sites, np.int32)
    exit_angle, exit_front, exit_back = np.empty(n * n_sites), np.empty(n * n_sites), np.empty(n * n_sites)
    count = 0
    for v in range(n):
        vx, vy = graph.vertex[v, 0], graph.vertex[v, 1]
        for s in range(n_sites):
            dx, dy = site[s, 0] - vx, site[s, 1] - vy
            if not tangential(v, seen[s, 0] - vx, seen[s, 1] - vy, graph.before, graph.after, graph.vertex):
                continue
            if not segment_free(vx, vy, seen[s, 0], seen[s, 1], graph.walls):
                continue
            length = length_of(dx, dy) + extra[s]
            angle = math.atan2(dy, dx)
            exit_site[count], exit_angle[count] = s, angle
            exit_front[count] = length * rates.front + final_cost(s, angle, False, goals)
            exit_back[count] = length * rates.back + final_cost(s, angle, True, goals)
            count += 1
        exit_start[v + 1] = count
    front, back = np.full(n_edges, FAR), np.full(n_edges, FAR)
    first_front, first_back = np.full(n_edges, FAR), np.full(n_edges, FAR)
    by_front, by_back = np.zeros(n_edges, np.int32), np.zeros(n_edges, np.int32)
    for e in range(n_edges):
        v = graph.edge_to[e]
        for k in range(exit_start[v], exit_start[v + 1]):
            spin = turn(graph.edge_angle[e], exit_angle[k]) * rates.turn
            if spin + exit_front[k] < first_front[e]:
                first_front[e], by_front[e] = spin + exit_front[k], -1 - k
            if spin + exit_back[k] < first_back[e]:
                first_back[e], by_back[e] = spin + exit_back[k], -1 - k
    next_front = _settle(graph, first_front, by_front, rates.front, rates.turn, front)
    next_back = _settle(graph, first_back, by_back, rates.back, rates.turn, back)
    bound = np.full(n, FAR)
    for v in range(n):
        for k in range(exit_start[v], exit_start[v + 1]):
            bound[v] = min(bound[v], exit_front[k], exit_back[k])
        for e in range(graph.out_start[v], graph.out_start[v + 1]):
            bound[v] = min(bound[v], front[e], back[e])
    return Table(
        site, seen, extra, goal_start, heading, offset, exit_start, exit_site[:count].copy(),
        exit_angle[:count].copy(), exit_front[:count].copy(), exit_back[:count].copy(), front, back,
        next_front, next_back, bound, rates,
    )  # fmt: skip


@inlined
def cost_outside(
    px: float, py: float, heading: float, sx: float, sy: float, visible: IntArray, count: int, graph: Graph,
    table: Table,
) -> tuple[float, bool, int, int]:  # fmt: skip
    """Cost [s] from a pose outside the grown polygons: cost, in reverse?, first vertex (-1: straight), what follows.

    (sx, sy) is the point from which sight is tested and from which the first `count` of `visible` are seen.
    """
    best, in_reverse, via, follow = FAR, False, -1, 0
    rates = table.rates
    for s in range(table.site.shape[0]):
        dx, dy = table.site[s, 0] - px, table.site[s, 1] - py
        length = length_of(dx, dy)
        total = length + table.extra[s]
        if total * rates.front >= best or not segment_free(sx, sy, table.seen[s, 0], table.seen[s, 1], graph.walls):
            continue
        if length < 1e-6:
            front = final_cost(s, heading, False, table) + total * rates.front
            back = front
        else:
            angle = math.atan2(dy, dx)
            a_0 = turn(heading, angle)
            front = a_0 * rates.turn + total * rates.front + final_cost(s, angle, False, table)
            back = (math.pi - a_0) * rates.turn + total * rates.back + final_cost(s, angle, True, table)
        if front < best:
            best, in_reverse, via, follow = front, False, -1, -1 - s
        if back < best:
            best, in_reverse, via, follow = back, True, -1, -1 - s
    for i in range(count):
        v = visible[i]
        dx, dy = graph.vertex[v, 0] - px, graph.vertex[v, 1] - py
        length = length_of(dx, dy)
        if length * rates.front + table.bound[v] >= best:
            continue
        angle = math.atan2(dy, dx) if length > 1e-6 else heading
        a_0 = turn(heading, angle)
        front_0 = a_0 * rates.turn + length * rates.front
        back_0 = (math.pi - a_0) * rates.turn + length * rates.back
        for k in range(table.exit_start[v], table.exit_start[v + 1]):
            spin = turn(angle, table.exit_angle[k]) * rates.turn
            if front_0 + spin + table.exit_front[k] < best:
                best, in_reverse, via, follow = front_0 + spin + table.exit_front[k], False, v, -1 - k
            if back_0 + spin + table.exit_back[k] < best:
                best, in_reverse, via, follow = back_0 + spin + table.exit_back[k], True, v, -1 - k
        for e in range(graph.out_start[v], graph.out_start[v + 1]):
            if front_0 + table.front[e] >= best and back_0 + table.back[e] >= best:
                continue
            spin = turn(angle, graph.edge_angle[e]) * rates.turn
            if front_0 + spin + table.front[e] < best:
                best, in_reverse, via, follow = front_0 + spin + table.front[e], False, v, e
            if back_0 + spin + table.back[e] < best:
                best, in_reverse, via, follow = back_0 + spin + table.back[e], True, v, e
    return best, in_reverse, via, follow


@kernel
def _way_out(
    px: float, py: float, heading: float, sx: float, sy: float, pushed: float, back: bool, rates: Rates
) -> tuple[float, float, float, float]:
    """Pose at the point outside when it is driven to forwards or in reverse, and the time [s] until then."""
    out = math.atan2(sy - py, sx - px)
    a_0 = turn(heading, out)
    if back:
        return sx, sy, out + math.pi, (math.pi - a_0) * rates.turn + pushed * rates.back
    return sx, sy, out, a_0 * rates.turn + pushed * rates.front


@inlined
def cost_from(
    px: float, py: float, heading: float, sx: float, sy: float, pushed: float, visible: IntArray, count: int,
    graph: Graph, table: Table,
) -> float:  # fmt: skip
    """Cost [s] from any pose; (sx, sy) is its point outside the grown polygons, `pushed` [m] away.

    From deep inside (a pocket, a gap narrower than the growth) the way leads to that point, forwards or in reverse,
    and on from there in whichever direction is best.
    """
    best = FAR
    for way in range(2):
        x, y, facing, spent = px, py, heading, 0.0
        if pushed > BESIDE:
            x, y, facing, spent = _way_out(px, py, heading, sx, sy, pushed, way == 1, table.rates)
        best = min(best, spent + cost_outside(x, y, facing, sx, sy, visible, count, graph, table)[0])
        if pushed <= BESIDE:
            break
    return best


class Sights(NamedTuple):
    """What is seen from a list of places: point outside (m, 3 with how far), vertices in compressed rows."""

    point: Array
    start: IntArray
    vertex: IntArray


@njit(cache=True)
def sights_of(place: Array, graph: Graph) -> Sights:
    """The vertices seen from places, shape (m, 2)."""
    m, n = place.shape[0], graph.vertex.shape[0]
    point, start = np.empty((m, 3)), np.zeros(m + 1, np.int32)
    vertex = np.empty(m * n, np.int32)
    count = 0
    for i in range(m):
        point[i, 0], point[i, 1], point[i, 2] = push_out(place[i, 0], place[i, 1], graph.outline, graph.solids)
        count += visible_vertices(point[i, 0], point[i, 1], graph, vertex[count:])
        start[i + 1] = count
    return Sights(point, start, vertex[:count].copy())


@njit(cache=True)
def costs_from(poses: Array, place_of: IntArray, sights: Sights, graph: Graph, table: Table) -> Array:
    """Costs [s] of poses (m, 3), pose i standing at place place_of[i] of `sights`; inf: no path."""
    result = np.empty(poses.shape[0])
    for i in range(poses.shape[0]):
        p = place_of[i]
        first, last = sights.start[p], sights.start[p + 1]
        result[i] = cost_from(
            poses[i, 0], poses[i, 1], poses[i, 2], sights.point[p, 0], sights.point[p, 1], sights.point[p, 2],
            sights.vertex[first:last], last - first, graph, table,
        )  # fmt: skip
        if result[i] >= FAR:
            result[i] = math.inf
    return result


@njit(cache=True)
def trace(px: float, py: float, heading: float, graph: Graph, table: Table) -> tuple[Array, bool, int]:
    """Cheapest path from a pose: points (m, 2), whether its last part is in reverse, site (-1: no path)."""
    path = np.empty((graph.vertex.shape[0] + 4, 2))
    path[0, 0], path[0, 1] = px, py
    size = 1
    sx, sy, pushed = push_out(px, py, graph.outline, graph.solids)
    visible = np.empty(graph.vertex.shape[0], np.int32)
    count = visible_vertices(sx, sy, graph, visible)
    cost, in_reverse, via, follow = FAR, False, -1, 0
    for way in range(2):
        x, y, facing, spent = px, py, heading, 0.0
        if pushed > BESIDE:
            x, y, facing, spent = _way_out(px, py, heading, sx, sy, pushed, way == 1, table.rates)
        found = cost_outside(x, y, facing, sx, sy, visible, count, graph, table)
        if spent + found[0] < cost:
            cost, in_reverse, via, follow = spent + found[0], found[1], found[2], found[3]
        if pushed <= BESIDE:
            break
    if cost >= FAR:
        return path[:1].copy(), False, -1
    if pushed > BESIDE:
        path[1, 0], path[1, 1] = sx, sy
        size = 2
    if via < 0:
        site = -1 - follow
    else:
        path[size, 0], path[size, 1] = graph.vertex[via, 0], graph.vertex[via, 1]
        size += 1
        while follow >= 0 and size < path.shape[0] - 1:
            v = graph.edge_to[follow]
            path[size, 0], path[size, 1] = graph.vertex[v, 0], graph.vertex[v, 1]
            size += 1
            follow = table.next_back[follow] if in_reverse else table.next_front[follow]
        site = table.exit_site[-1 - follow] if follow < 0 else -1
    path[size, 0], path[size, 1] = table.site[site, 0], table.site[site, 1]
    size += 1
    return path[:size].copy(), in_reverse, site
