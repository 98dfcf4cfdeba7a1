"""References for the comparison of trials: published times, each with its source, and the reference tour.

Paper: "Reactive Base Control for On-The-Move Mobile Manipulation in Dynamic Environments". Reister: Reister et al.,
"Combining Navigation and Manipulation Costs for Time-Efficient Robot Placement in Mobile Manipulation Tasks".
Experiment 1a is published as a box plot without numbers, and for the simulated Experiment 2 no time is given.

The reference tour is the time of the shortest tour of the base centre past all pick and drop places: start pose, then
in task order one point in the disc round every object and bin, outside all furniture grown by a margin; length divided
by the forward speed limit. No turning, no acceleration, no grasping: a reference, not a bound. Solved by dynamic
programming over points on the circles (a path enters a disc through its circle, unless it begins inside), with
exact shortest paths round the grown furniture between them. Published figures of this reference were made with 36
points per circle, as is the default here, for comparison; ``exact=True`` refines the points to the shortest tour:
0.05 to 0.6 s less in Experiments 1 and 1a.
"""

import math
from itertools import pairwise
from typing import NamedTuple

import msgspec
import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from motm_twin.model.compiler import njit
from motm_twin.model.geometry import Array
from motm_twin.model.known import KnownWorld
from motm_twin.model.scene import Cylinder, DriveTo, Pick, Scene, Solid
from motm_twin.perception.footprints import outline

_TABLE = "Paper, Table I"
_EXP2 = "Paper, Sec. VI-B, Experiment 2"
_GRASPING = "; 40 s of it for grasping"


class Published(NamedTuple):
    """A published time of a whole task."""

    what: str
    seconds: float
    success: str  # objects delivered of objects wanted, "" when not given
    source: str
    real: bool  # True: on the real robot, False: simulated


_OURS_TRIAL = Published("paper, this trial, simulated", 85.6, "", _TABLE, real=False)
_OURS_TRIAL_REAL = Published("paper, this trial, real robot", 91.0, "6/6", _TABLE, real=True)
_OURS_TEN = Published("paper, ten trials, simulated", 95.9, "", _TABLE, real=False)
_OURS_TEN_REAL = Published("paper, ten trials, real robot", 100.4, "58/60", _TABLE, real=True)
_SEQUENTIAL = Published("Reister, sequential, simulated", 172.3, "", f"{_TABLE}, from Reister; 40 s of it for grasping",
                        real=False)  # fmt: skip
_EXP2_TEMI_REAL = Published("paper, one Temi, real robot", 94.0, "", _EXP2, real=True)
_EXP2_ALONE_REAL = Published("paper, without the Temi, real robot", 91.0, "", _EXP2, real=True)

_RECOVERY = "Burgess-Limerick et al., Failure Recovery, arXiv 2305.08351, read off the chart; layout not published"
_RECOVERY_METHODS = ("Failure Recovery, on the move", "Failure Recovery, reactive rival of the TEB type")
FAILURE_RECOVERY: dict[str, dict[float, tuple[float, float]]] = {  # task: delay of the grasp [s]: both times [s]
    "line": {0.0: (9.4, 11.6), 10.0: (18.8, 21.9)},
    "turn": {0.0: (10.9, 10.7), 10.0: (20.3, 22.0)},
    "obstructed_turn": {0.0: (13.3, 17.4), 10.0: (20.1, 29.0)},
}
RECOVERY_PLANNED = "planned on-the-move manipulation fails beyond a delay of 1 s (obstructed turn: 5 s)"

SINGLE_TRIAL = "trial1"
REFERENCE_TOUR_NOTE = (
    "shortest tour of the base centre past all picks and drops (0.80 m reach, furniture grown by 0.25 m) at full "
    "speed, without turning, accelerating or grasping: a reference, not a bound"
)


def published(scene: str, variant: str) -> tuple[Published, ...]:
    """The published times for comparison with a run of this scene and variant; none for other scenes."""
    if scene == "exp1" and variant == SINGLE_TRIAL:
        return _OURS_TRIAL, _OURS_TRIAL_REAL, _OURS_TEN, _SEQUENTIAL
    if scene == "exp1":
        return _OURS_TEN, _OURS_TEN_REAL, _SEQUENTIAL
    if scene == "exp2":
        return _EXP2_TEMI_REAL, _EXP2_ALONE_REAL
    if scene in FAILURE_RECOVERY:
        return tuple(
            Published(f"{who}, grasps {delay:g} s late", seconds, "", _RECOVERY, real=False)
            for delay, times in FAILURE_RECOVERY[scene].items()
            for who, seconds in zip(_RECOVERY_METHODS, times, strict=True)
        )
    return ()


class TableRow(NamedTuple):
    """A row of the paper's table, with our comparable method."""

    experiment: str
    method: str
    like: str
    seconds: float
    success: str
    source: str
    real: bool
    single: bool = False  # one arrangement, like trial 1


def _row(method: str, like: str, simulated: float, real: float, success: str, from_: str, single: bool = False):
    arrangement = "1, trial 1" if single else "1"
    grasping = _GRASPING if from_ else ""
    return (
        TableRow(arrangement, method, like, simulated, "", f"{_TABLE}, simulated{from_}{grasping}", False, single),
        TableRow(
            f"{arrangement}, real robot", method, like, real, success, f"{_TABLE}, real robot{from_}", True, single
        ),
    )


TABLE_I: tuple[TableRow, ...] = (
    *_row("IRM, Reister et al.", "irm", 192.9, 202.0, "6/6", ", from Reister"),
    *_row("Sequential, Reister et al.", "sequential", 172.3, 176.0, "6/6", ", from Reister"),
    *_row("Paper, single trial", "motm", 85.6, 91.0, "6/6", "", single=True),
    *_row("Paper, ten trials", "motm", 95.9, 100.4, "58/60", ""),
)
REDUCTIONS = {  # published reductions of the task time against the sequential method of Reister et al.
    "exp1": (0.43, "Paper, Sec. VII-A, simulated, 50 trials"),
    "exp1a": (0.46, "Paper, Sec. VII-B, simulated, 50 trials"),
    "trial1": (0.48, "Paper, Sec. VII-A, real robot, one trial"),
}


REACH = 0.80  # [m] R, radius of the disc round every pick and drop
MARGIN = 0.25  # [m] g, margin by which furniture is grown
ARC_SEGMENTS = 8  # segments per quarter circle of a grown corner: 1.2 mm off the true arc
CIRCLE_POINTS = 36  # points on every circle, as in the published figures
EXACT_POINTS = 96  # points on every circle before refinement
FINE_POINTS = 9  # points round the best one in every refinement
ROUNDS = 2
INSET = 5e-4  # [m] a sight line may graze grown furniture by this, so that it can run along its border


class Stop(msgspec.Struct, frozen=True, kw_only=True):
    """A disc that the tour must touch."""

    centre: tuple[float, float]  # [m]
    radius: float  # [m]


def reference_tour_s(
    world: Scene | KnownWorld, reach: float = REACH, margin: float = MARGIN, *, exact: bool = False
) -> float:
    """Time [s] of the reference tour at the forward speed limit; inf when a place is unreachable."""
    legs, _ = reference_tour(world, reach, margin, exact=exact)
    return float(legs.sum()) / world.robot.base.forward_speed


def reference_tour(
    world: Scene | KnownWorld, reach: float = REACH, margin: float = MARGIN, *, exact: bool = False
) -> tuple[Array, Array]:
    """Length [m] of each leg of the reference tour, shape (n,), and the points that it touches, shape (n + 1, 2).

    The first point is the start; an unreachable place makes the legs from there on infinitely long.
    """
    solids = tuple(solid for solid in world.solids if solid.z_min < world.robot.top)
    grown, inner = _grown(solids, margin), _grown(solids, margin - INSET)
    stops = stops_of(world, reach)
    walls, corners = _edges(inner), np.ascontiguousarray(_edges(grown)[:, :2])
    between = _shortest(_lengths(corners, corners, walls))
    start = _freed(np.array(world.start[:2], dtype=float), grown)[None]
    layers = [start]
    for stop in stops:
        layers.append(_entries(stop, layers[-1], grown, exact))
    legs, touched = _best(layers, corners, between, walls)
    spread = 2.0 * math.pi / EXACT_POINTS
    for _ in range(ROUNDS if exact and np.isfinite(legs).all() else 0):
        layers = [start] + [_nearby(stop, at, spread, grown) for stop, at in zip(stops, touched[1:], strict=True)]
        legs, touched = _best(layers, corners, between, walls)
        spread /= (FINE_POINTS - 1) / 2.0
    return legs, touched


def stops_of(world: Scene | KnownWorld, reach: float) -> list[Stop]:
    """The discs of a task list: radius ``reach`` [m] round picks and drops, the tolerance round points to drive to."""
    objects = {item.name: item.position for item in world.objects}
    bins = {item.name: item.centre for item in world.bins}
    stops = []
    for task in world.tasks:
        if isinstance(task, DriveTo):
            stops.append(Stop(centre=task.point, radius=task.tolerance))
        else:
            place = objects[task.object] if isinstance(task, Pick) else bins[task.bin]
            stops.append(Stop(centre=(place[0], place[1]), radius=reach))
    return stops


def _grown(solids: tuple[Solid, ...], margin: float) -> BaseGeometry:
    """Union of all solids, grown by the margin [m]."""
    bodies = []
    for solid in solids:
        if isinstance(solid.shape, Cylinder):
            bodies.append(shapely.Point(solid.shape.centre).buffer(solid.shape.radius + margin, quad_segs=16))
        else:
            bodies.append(shapely.Polygon(outline(solid.shape)).buffer(margin, quad_segs=ARC_SEGMENTS))
    return shapely.union_all(bodies)


def _edges(area: BaseGeometry) -> Array:
    """All border segments, shape (n, 4): x, y of both ends."""
    rings = [np.array(ring.coords) for ring in shapely.get_parts(area.boundary)]
    return np.concatenate([np.hstack([ring[:-1], ring[1:]]) for ring in rings]) if rings else np.zeros((0, 4))


def _freed(point: Array, grown: BaseGeometry) -> Array:
    """The point, or the nearest one outside the grown furniture when it is inside."""
    place = shapely.Point(point)
    if not grown.contains(place):
        return point
    return shapely.get_coordinates(shapely.shortest_line(grown.boundary, place))[0]


def _entries(stop: Stop, before: Array, grown: BaseGeometry, exact: bool) -> Array:
    """Points at which the tour may touch a disc: on its free circle, and earlier points that are inside it."""
    centre = np.array(stop.centre)
    angles = np.arange(CIRCLE_POINTS) * 2.0 * math.pi / CIRCLE_POINTS
    circle = centre + stop.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    points = circle[~shapely.contains(grown, shapely.points(circle))]
    if exact or len(points) == 0:
        points = _arc_points(stop, grown)
    found = np.concatenate([before[np.hypot(*(before - centre).T) <= stop.radius], points])
    return found if len(found) else _freed(centre, grown)[None]


def _arc_points(stop: Stop, grown: BaseGeometry) -> Array:
    """Closely spaced points on the free arcs of a circle, their ends included; shape (n, 2)."""
    circle = shapely.Point(stop.centre).buffer(stop.radius, quad_segs=64).exterior
    step = circle.length / EXACT_POINTS
    points = [np.zeros((0, 2))]
    for arc in shapely.get_parts(circle.difference(grown)):
        along = np.linspace(0.0, arc.length, max(2, math.ceil(arc.length / step) + 1))
        points.append(shapely.get_coordinates(shapely.line_interpolate_point(arc, along)))
    return np.concatenate(points)


def _nearby(stop: Stop, point: Array, spread: float, grown: BaseGeometry) -> Array:
    """Points of the disc's circle close to one of them, itself included; ``spread`` [rad] each way."""
    dx, dy = point - np.array(stop.centre)
    if abs(math.hypot(dx, dy) - stop.radius) > 0.01 * stop.radius:
        return point[None]  # inside the disc: a point of the stop before
    angles = math.atan2(dy, dx) + spread * np.linspace(-1.0, 1.0, FINE_POINTS)
    circle = np.array(stop.centre) + stop.radius * np.column_stack([np.cos(angles), np.sin(angles)])
    free = ~shapely.contains(grown, shapely.points(circle))
    return np.concatenate([circle[free], point[None]])


def _best(layers: list[Array], corners: Array, between: Array, walls: Array) -> tuple[Array, Array]:
    """Shortest tour through one point of every layer: lengths of its legs [m] (n,) and those points (n + 1, 2)."""
    cost = np.zeros(1)
    costs, chosen_from = [cost], []
    to_corners = _lengths(layers[0], corners, walls)
    for before, after in pairwise(layers):
        from_corners = _lengths(after, corners, walls)
        cost, source = _step(cost, to_corners, between, from_corners, _lengths(before, after, walls))
        costs.append(cost)
        chosen_from.append(source)
        to_corners = from_corners
    index = int(np.argmin(cost))
    touched, spent = [layers[-1][index]], [cost[index]]
    for layer, before, source in zip(layers[-2::-1], costs[-2::-1], chosen_from[::-1], strict=True):
        index = source[index]
        touched.append(layer[index])
        spent.append(before[index])
    spent = np.array(spent[::-1])
    reached = np.isfinite(spent)
    legs = np.where(reached[1:], spent[1:] - np.where(reached, spent, 0.0)[:-1], np.inf)
    return legs, np.array(touched[::-1])


@njit(cache=True)
def _step(cost, to_corners, between, from_corners, direct):
    """One layer of the dynamic programme: least length to every point of the next layer, and its predecessor."""
    points, corners = to_corners.shape
    at_corner, corner_source = np.full(corners, np.inf), np.zeros(corners, np.int64)
    for i in range(points):
        for c in range(corners):
            if cost[i] + to_corners[i, c] < at_corner[c]:
                at_corner[c], corner_source[c] = cost[i] + to_corners[i, c], i
    left, left_source = np.full(corners, np.inf), np.zeros(corners, np.int64)
    for c in range(corners):
        for d in range(corners):
            if at_corner[c] + between[c, d] < left[d]:
                left[d], left_source[d] = at_corner[c] + between[c, d], corner_source[c]
    n = from_corners.shape[0]
    best, source = np.full(n, np.inf), np.zeros(n, np.int64)
    for j in range(n):
        for i in range(points):
            if cost[i] + direct[i, j] < best[j]:
                best[j], source[j] = cost[i] + direct[i, j], i
        for c in range(corners):
            if left[c] + from_corners[j, c] < best[j]:
                best[j], source[j] = left[c] + from_corners[j, c], left_source[c]
    return best, source


@njit(cache=True)
def _lengths(one, two, walls):
    """Straight-line distances [m], shape (n, m); inf where a wall is crossed."""
    lengths = np.empty((one.shape[0], two.shape[0]))
    for i in range(one.shape[0]):
        for j in range(two.shape[0]):
            ax, ay = one[i, 0], one[i, 1]
            dx, dy = two[j, 0] - ax, two[j, 1] - ay
            lengths[i, j] = math.hypot(dx, dy)
            x_low, x_high, y_low, y_high = min(ax, ax + dx), max(ax, ax + dx), min(ay, ay + dy), max(ay, ay + dy)
            for k in range(walls.shape[0]):
                px, py, qx, qy = walls[k, 0], walls[k, 1], walls[k, 2], walls[k, 3]
                if max(px, qx) < x_low or min(px, qx) > x_high or max(py, qy) < y_low or min(py, qy) > y_high:
                    continue
                side_p, side_q = dx * (py - ay) - dy * (px - ax), dx * (qy - ay) - dy * (qx - ax)
                if side_p * side_q > 0.0 or (side_p == 0.0 and side_q == 0.0):
                    continue
                ex, ey = qx - px, qy - py
                side_a, side_b = ex * (ay - py) - ey * (ax - px), ex * (ay + dy - py) - ey * (ax + dx - px)
                if side_a * side_b <= 0.0:
                    lengths[i, j] = math.inf
                    break
    return lengths


@njit(cache=True)
def _shortest(lengths):
    """Lengths of all shortest paths (Floyd, Warshall), shape (n, n)."""
    best = lengths.copy()
    n = best.shape[0]
    for i in range(n):
        best[i, i] = 0.0
    for k in range(n):
        for i in range(n):
            if best[i, k] < math.inf:
                for j in range(n):
                    best[i, j] = min(best[i, j], best[i, k] + best[k, j])
    return best
