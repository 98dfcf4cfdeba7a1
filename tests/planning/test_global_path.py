"""The visibility graph and the directed-edge search against networkx, shapely and brute force."""

import itertools
import math

import networkx
import numpy as np
import pytest
import shapely
from idealised import polygons, rectangle, world_of

from motm_twin.model.profile import BaseLimits
from motm_twin.planning.global_path import (
    GraphCache,
    costs_on,
    costs_to,
    goal_table,
    path_to_goal,
    poses_at,
    rates_of,
    robot_table,
    shortest_path,
)
from motm_twin.planning.rtr import path_rtr
from motm_twin.planning.visibility import build_graph, push_out

LIMITS = BaseLimits()
G = 0.33


def grown_rings(shapes: tuple[np.ndarray, ...]) -> list[np.ndarray]:
    """Outlines of the grown polygons, shape (n, 2) each."""
    outline = build_graph(shapes, G).outline
    return [outline.point[first:end] for first, end in outline.ring[:, 4:].astype(int)]


def free_points(area: shapely.Geometry, count: int, seed: int) -> np.ndarray:
    """Points outside an area."""
    points = np.random.default_rng(seed).uniform((-1.5, -2.8), (6.5, 3.8), (8 * count, 2))
    return points[~shapely.contains_xy(shapely.buffer(area, 0.01), points)][:count]


def independent_lengths(rings: list[np.ndarray], start: np.ndarray, goals: np.ndarray) -> list[float]:
    """Shortest lengths by networkx over all shapely-visible pairs of corners."""
    area = shapely.union_all([shapely.Polygon(ring) for ring in rings])
    inner = shapely.buffer(area, -0.0005)
    nodes = [tuple(p) for ring in rings for p in ring] + [tuple(start)] + [tuple(g) for g in goals]
    graph = networkx.Graph()
    graph.add_nodes_from(nodes)
    for a, b in itertools.combinations(nodes, 2):
        if not shapely.LineString((a, b)).intersects(inner):
            graph.add_edge(a, b, weight=math.dist(a, b))
    lengths = networkx.single_source_dijkstra_path_length(graph, tuple(start))
    return [lengths[tuple(g)] for g in goals]


def length_of(path: np.ndarray) -> float:
    """Length of a polyline."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


@pytest.mark.parametrize("boxes", [False, True])
def test_shortest_paths_without_rotation_cost_equal_those_of_networkx_and_shapely(boxes: bool) -> None:
    shapes = polygons(boxes=boxes)
    rings = grown_rings(shapes)
    area = shapely.union_all([shapely.Polygon(r) for r in rings])
    points = free_points(area, 9, seed=4)
    expected = independent_lengths(rings, points[0], points[1:])
    for goal, length in zip(points[1:], expected, strict=True):
        path = shortest_path(build_graph(shapes, G), np.array([*points[0], 0.0]), goal, LIMITS)
        assert length_of(path) == pytest.approx(length, abs=2e-3)
        assert np.allclose(path[-1], goal)


def brute_force(graph, start: np.ndarray, goal: np.ndarray, limit: int = 5) -> float:
    """Cheapest PathRTR over all vertex sequences of up to `limit` visible corners."""
    rings = [graph.walls.point[int(row[4]) : int(row[5])] for row in graph.walls.ring]
    inner = shapely.union_all([shapely.Polygon(ring) for ring in rings])
    shapely.prepare(inner)
    nodes = [*map(tuple, graph.vertex[:, :2]), tuple(goal[:2])]
    near: dict[tuple, list[tuple]] = {}
    for a in [tuple(start[:2]), *nodes]:
        near[a] = [b for b in nodes if a != b and not shapely.LineString((a, b)).crosses(inner)
                   and not inner.contains(shapely.LineString((a, b)))]  # fmt: skip
    best = math.inf

    def extend(path: list[tuple]) -> None:
        nonlocal best
        if length_of(np.array(path)) / LIMITS.forward_speed >= best if len(path) > 1 else False:
            return
        if path[-1] == tuple(goal[:2]):
            cost = path_rtr(np.array(path), start[2], goal[2], v_f=0.5, v_r=0.25, w_max=LIMITS.yaw_rate)
            best = min(best, cost)
            return
        if len(path) <= limit:
            for b in near[path[-1]]:
                if b not in path:
                    extend([*path, b])

    extend([tuple(start[:2])])
    return best


@pytest.mark.parametrize("goal_heading", [0.0, 1.5, 3.0, -1.5])
def test_the_directed_edge_search_finds_the_cheapest_path_of_all(goal_heading: float) -> None:
    shapes = (np.array([[1.0, -0.5], [2.0, -0.5], [2.0, 0.5], [1.0, 0.5]]),)
    graph = build_graph(shapes, 0.2)
    start, goal = np.array([0.0, 0.1, 2.0]), np.array([3.0, -0.2, goal_heading])
    table = goal_table(graph, goal, rates_of(LIMITS))
    here = poses_at(graph, start[None], start[None, :2], np.zeros(1, np.int32))
    assert costs_on(graph, table, here)[0] == pytest.approx(brute_force(graph, start, goal), abs=1e-6)


def test_costs_from_the_robot_equal_costs_to_the_goal() -> None:
    graph = build_graph(polygons(), G)
    rng = np.random.default_rng(1)
    points = free_points(shapely.union_all([shapely.Polygon(ring) for ring in grown_rings(polygons())]), 12, seed=2)
    poses = np.column_stack((points, rng.uniform(-3, 3, len(points))))
    rates = rates_of(LIMITS)
    index = np.arange(len(points), dtype=np.int32)
    forward = costs_to(graph, robot_table(graph, poses[0], rates), poses_at(graph, poses, points, index))
    for pose, cost in zip(poses, forward, strict=True):
        table = goal_table(graph, pose, rates)
        start = poses_at(graph, poses[:1], points[:1], np.zeros(1, np.int32))
        assert costs_on(graph, table, start)[0] == pytest.approx(cost, abs=1e-9)


def test_the_traced_path_costs_what_the_table_says() -> None:
    graph = build_graph(polygons(), G)
    table = goal_table(graph, np.array([4.2, 2.75, 0.3]), rates_of(LIMITS))
    for heading in np.linspace(-3, 3, 7):
        start = np.array([0.5, 0.2, heading])
        path, _ = path_to_goal(graph, table, start)
        cost = costs_on(graph, table, poses_at(graph, start[None], start[None, :2], np.zeros(1, np.int32)))[0]
        assert path_rtr(path, heading, 0.3, v_f=0.5, v_r=0.25, w_max=LIMITS.yaw_rate) == pytest.approx(cost)


def test_rotation_cost_takes_the_robot_round_the_side_that_fits_the_goal_heading() -> None:
    shapes = (np.array([[1.5, -0.6], [2.5, -0.6], [2.5, 0.4], [1.5, 0.4]]),)
    graph = build_graph(shapes, 0.3)
    start, goal = np.array([0.0, 0.0, 0.0]), np.array([3.6, 0.0, 0.9])
    shortest = shortest_path(graph, start, goal, LIMITS)
    smooth, _ = path_to_goal(graph, goal_table(graph, goal, rates_of(LIMITS)), start)
    assert shortest[1:-1, 1].min() > 0.0
    assert smooth[1:-1, 1].max() < 0.0


def test_a_point_inside_a_grown_polygon_is_pushed_to_its_border_not_through_the_solid() -> None:
    shapes = (np.array([[0.0, 0.0], [0.1, 0.0], [0.1, 4.0], [0.0, 4.0]]),)
    graph = build_graph(shapes, 0.5)
    x, y, pushed = push_out(0.2, 2.0, graph.outline, graph.solids)
    assert (x, y) == (pytest.approx(0.6, abs=0.01), pytest.approx(2.0))
    assert pushed == pytest.approx(0.4, abs=0.01)
    assert push_out(2.0, 2.0, graph.outline, graph.solids) == (2.0, 2.0, 0.0)


def test_every_point_has_a_path_wherever_it_lies_in_the_grown_border() -> None:
    graph = build_graph(polygons(), G)
    table = goal_table(graph, np.array([4.2, -0.5, 0.0]), rates_of(LIMITS))
    x, y = np.meshgrid(np.linspace(2.6, 5.8, 65), np.linspace(0.95, 2.6, 34))
    points = np.column_stack((x.ravel(), y.ravel()))
    points = points[~shapely.contains_xy(shapely.box(3.0, 1.37, 5.4, 2.17), points)]
    poses = np.column_stack((points, np.zeros(len(points))))
    cost = costs_on(graph, table, poses_at(graph, poses, points, np.arange(len(points), dtype=np.int32)))
    assert np.isfinite(cost).all()


def test_the_graph_is_kept_while_the_polygons_stay_and_rebuilt_when_one_moves() -> None:
    cache = GraphCache()
    shapes = polygons()
    first = cache.graph(world_of(shapes), G)
    assert cache.graph(world_of(tuple(p.copy() for p in shapes)), G) is first
    assert cache.graph(world_of((shapes[0] + 0.01, *shapes[1:])), G) is not first


def test_no_path_leaves_the_map() -> None:
    world = world_of((rectangle(2.0, -1.0, 2.2, 5.0),), (-2, -3, 8, 4))
    path = shortest_path(GraphCache().graph(world, G), np.zeros(3), np.array([4.0, 3.0]), LIMITS)
    assert path[:, 1].min() == pytest.approx(-1.33, abs=0.01)
    closed = world_of((rectangle(2.0, -2.8, 2.2, 5.0),), (-2, -3, 8, 4))
    assert len(shortest_path(GraphCache().graph(closed, G), np.zeros(3), np.array([4.0, 3.0]), LIMITS)) == 1


def test_without_obstacles_the_path_is_straight() -> None:
    graph = build_graph((), G)
    table = goal_table(graph, np.array([2.0, 0.0, 0.0]), rates_of(LIMITS))
    path, in_reverse = path_to_goal(graph, table, np.zeros(3))
    assert path.tolist() == [[0.0, 0.0], [2.0, 0.0]]
    assert not in_reverse
