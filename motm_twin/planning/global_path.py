"""Global paths (Paper, Sec. III-B): visibility graphs, cached while polygons do not change; costs from and to poses.

PathRTR is the same for a path and for its reverse with all headings turned by pi. One table with the robot as its goal
therefore gives the cost from the robot to every candidate ("forward"), and one table with the target as its goal the
cost from every search node ("backward"), with the same code.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import dot
from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.model.profile import BaseLimits
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import Field, field_of
from motm_twin.planning.cost_to_go import FAR, Rates, Table, cheapest, make_table, trace
from motm_twin.planning.visibility import Graph, build_graph, push_out, visible_vertices

NEVER = 1e6  # [s/m] small beside `FAR`, the cost of no path: costs stay finite
KEPT = 8  # remembered tables of costs to goals: in most periods neither the goal nor the next targets change


class GraphCache:
    """Builds visibility graph and field, and remembers the newest: pure functions of their arguments, so no state."""

    def __init__(self) -> None:
        self._key: tuple[bytes, float, tuple[float, ...]] | None = None
        self._graph: Graph | None = None
        self._field: tuple[Array, Array, Field] | None = None
        self._tables: dict[tuple[bytes, bytes, Rates], Table] = {}  # of the newest graph

    def graph(self, world: WorldMap, g: float) -> Graph:
        """The graph of the map's polygons grown by g [m]; the same object while nothing changed."""
        (x, y), (rows, columns) = world.origin.tolist(), world.distance.shape
        bounds = (x, y, x + columns * world.resolution, y + rows * world.resolution)
        key = (b"|".join(p.tobytes() for p in world.polygons), g, bounds)
        if self._graph is None or key != self._key:
            self._graph, self._key = build_graph(world.polygons, g, bounds), key
            self._tables.clear()
        return self._graph

    def table(self, graph: Graph, poses: Array, rates: Rates, offsets: Array | None = None) -> Table:
        """`goal_table`; the same object for recent arguments on the same graph."""
        if graph is not self._graph:
            return goal_table(graph, poses, rates, offsets)
        key = (poses.tobytes(), b"" if offsets is None else offsets.tobytes(), rates)
        found = self._tables.pop(key, None) or goal_table(graph, poses, rates, offsets)
        self._tables[key] = found  # the newest at the end
        if len(self._tables) > KEPT:
            del self._tables[next(iter(self._tables))]
        return found

    def field(self, world: WorldMap) -> Field:
        """The distance field of the map; the same object while nothing changed."""
        known = self._field
        if known is None or known[0] is not world.distance or known[1] is not world.origin:
            known = self._field = (world.distance, world.origin, field_of(world))
        return known[2]


def rates_of(limits: BaseLimits, *, rotation_cost: bool = True) -> Rates:
    """Seconds per metre and radian at the speed limits; without rotation cost turning is free (STAA*).

    A base that cannot reverse needs `NEVER` seconds per metre: it turns instead.
    """
    turn_rate = 1.0 / limits.yaw_rate if rotation_cost else 0.0
    return Rates(1.0 / limits.forward_speed, min(1.0 / max(limits.reverse_speed, 1e-9), NEVER), turn_rate)


class Visibility(NamedTuple):
    """Visibility from places: points outside the grown polygons (m, 3: x, y, distance), vertices in compressed rows."""

    point: Array
    start: NDArray[np.int32]
    vertex: NDArray[np.int32]


@kernel
def _look(place: Array, graph: Graph, visibility: Visibility) -> int:
    count = 0
    for i in range(place.shape[0]):
        qx, qy, pushed = push_out(place[i, 0], place[i, 1], graph.outline, graph.solids)
        visibility.point[i, 0], visibility.point[i, 1], visibility.point[i, 2] = qx, qy, pushed
        count += visible_vertices(qx, qy, graph, visibility.vertex[count:])
        visibility.start[i + 1] = count
    return count


def visibility_of(place: Array, graph: Graph) -> Visibility:
    """The vertices seen from places, shape (m, 2)."""
    m, n = len(place), len(graph.vertex)
    visibility = Visibility(np.empty((m, 3)), np.zeros(m + 1, np.int32), np.empty(m * n, np.int32))
    _look(place, graph, visibility)
    return visibility


@kernel
def _costs(
    poses: Array, place_of: NDArray[np.int32], visibility: Visibility, graph: Graph, table: Table, result: Array
) -> None:
    for i in range(poses.shape[0]):
        p = place_of[i]
        seen = visibility.vertex[visibility.start[p] : visibility.start[p + 1]]
        x, y, pushed = visibility.point[p, 0], visibility.point[p, 1], visibility.point[p, 2]
        cost = cheapest(poses[i, 0], poses[i, 1], poses[i, 2], x, y, pushed, seen, graph, table)[0]
        result[i] = cost if cost < FAR else math.inf


def costs_from(poses: Array, place_of: NDArray[np.int32], visibility: Visibility, graph: Graph, table: Table) -> Array:
    """Costs [s] of poses (m, 3), pose i standing at place place_of[i] of `visibility`; inf: no path."""
    result = np.empty(len(poses))
    _costs(poses, place_of, visibility, graph, table, result)
    return result


class Poses(NamedTuple):
    """Poses (m, 3) that share places, and what is seen from the places."""

    pose: Array
    place_of: NDArray[np.int32]
    visibility: Visibility


def poses_at(graph: Graph, poses: Array, places: Array, place_of: NDArray[np.int32]) -> Poses:
    """Poses (m, 3) at places (p, 2), with the graph vertices that each place sees."""
    return Poses(np.ascontiguousarray(poses), place_of, visibility_of(np.ascontiguousarray(places), graph))


def goal_table(graph: Graph, poses: Array, rates: Rates, offsets: Array | None = None) -> Table:
    """Costs to the cheapest of goal poses (m, 3), a heading of nan is free; offsets (m,) [s] are added at the goals.

    Poses with equal positions must follow each other.
    """
    poses = np.ascontiguousarray(poses, dtype=np.float64).reshape(-1, 3)
    goal = np.zeros((len(poses), 2))
    goal[:, 0] = poses[:, 2]
    if offsets is not None:
        goal[:, 1] = offsets
    place, start = grouped(poses)
    return make_table(graph, place, start, goal, rates)


def grouped(poses: Array) -> tuple[Array, NDArray[np.int32]]:
    """Places (p, 2) of poses (m, 3), equal ones following each other, and the first pose of each, then m: (p + 1,)."""
    place, start = np.empty((len(poses), 2)), np.empty(len(poses) + 1, np.int32)
    count = _group(poses, place, start)
    return place[:count], start[: count + 1]


@kernel
def _group(poses: Array, place: Array, start: NDArray[np.int32]) -> int:
    count = 0
    for i in range(poses.shape[0]):
        if count == 0 or poses[i, 0] != poses[i - 1, 0] or poses[i, 1] != poses[i - 1, 1]:
            place[count, 0], place[count, 1], start[count] = poses[i, 0], poses[i, 1], i
            count += 1
    start[count] = poses.shape[0]
    return count


def robot_table(graph: Graph, pose: Array, rates: Rates) -> Table:
    """The table that gives costs from the robot at `pose` (3,) to candidates whose headings are turned by pi."""
    return goal_table(graph, np.array([[pose[0], pose[1], pose[2] + math.pi]]), rates)


def costs_to(graph: Graph, table: Table, poses: Poses) -> Array:
    """Cost [s] from the robot of `robot_table` to each pose, shape (m,); inf: no path."""
    turned = poses.pose + np.array([0.0, 0.0, math.pi])
    return costs_from(turned, poses.place_of, poses.visibility, graph, table)


def costs_on(graph: Graph, table: Table, poses: Poses) -> Array:
    """Cost [s] from each pose to the cheapest goal of `table`, shape (m,); inf: no path."""
    return costs_from(poses.pose, poses.place_of, poses.visibility, graph, table)


def path_to_goal(graph: Graph, table: Table, pose: Array) -> tuple[Array, bool]:
    """Cheapest path (m, 2) [m] from a pose (3,) to a goal of the table, and whether it is driven in reverse."""
    path, in_reverse, site = trace(float(pose[0]), float(pose[1]), float(pose[2]), graph, table)
    return (path if site >= 0 else path[:1]), in_reverse


def shortest_path(graph: Graph, start: Array, goal: Array, limits: BaseLimits) -> Array:
    """The path of unmodified STAA*: shortest, with no regard to headings and turning; shape (m, 2) [m]."""
    rates = rates_of(limits, rotation_cost=False)
    table = goal_table(graph, np.array([[goal[0], goal[1], math.nan]]), rates)
    return path_to_goal(graph, table, np.asarray(start, dtype=np.float64))[0]


def leaves_disc(path: Array, radius: float) -> tuple[int, Array] | None:
    """Segment and point at which a path (m, 2) first leaves the disc of `radius` [m] about its start."""
    start = path[0]
    for i in range(len(path) - 1):
        if math.hypot(*(path[i + 1] - start)) <= radius:
            continue
        a, d = path[i] - start, path[i + 1] - path[i]
        dd, ad, aa = dot(d, d), dot(a, d), dot(a, a)
        t = (-ad + math.sqrt(max(0.0, ad * ad - dd * (aa - radius * radius)))) / dd
        return i, path[i] + min(1.0, max(0.0, t)) * d
    return None
