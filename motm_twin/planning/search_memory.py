"""What a STAA* search reads and remembers, as tuples of arrays for the kernels."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.collision import Body, Field
from motm_twin.planning.cost_to_go import Table
from motm_twin.planning.reach import Job
from motm_twin.planning.visibility import Graph

IntArray = NDArray[np.int32]
BEZIER_SAMPLES = 8


class Settings(NamedTuple):
    """Numbers of one search; see `StaaParameters`, `BaseLimits` and the problem for their meaning."""

    v_f: float
    v_r: float
    w_max: float
    a_max: float
    b_max: float
    node_duration: float
    notches: int
    cell: float
    heading_bins: int
    speed_bins: int
    yaw_rate_bins: int
    epsilon: float
    margin: float
    margin_floor: float
    margin_cost: float
    brake_depth: int
    grid_weight: float
    grid_range: float
    grid_map: bool
    k_min: float
    k_time: float
    scale_penalty: bool
    bezier: bool
    bezier_offset: float
    goal_test: int
    pass_distance: float
    pass_heading: float
    goal_x: float
    goal_y: float
    goal_heading: float  # nan: free
    after_goal: float  # [s] of the table's cost that comes after the goal (not part of t_h)
    by_job: bool  # end when the job is done
    drive_on: bool
    next_weight: float
    has_next: bool
    keep_reach: bool  # the arm is at the object
    region_x: float
    region_y: float
    region_radius: float


class World(NamedTuple):
    """What one search reads."""

    field: Field
    proximity: Field
    body: Body
    graph: Graph
    table: Table  # to the local goal, with what comes after it
    next_table: Table  # to the next target
    job: Job


class CellSights(NamedTuple):
    """Seen vertices per map cell, found when first asked for: a pure function of the graph, kept while it stays."""

    start: IntArray  # (cells,) into pool; -1: not known yet
    count: IntArray
    point: Array  # (cells, 3) point outside the grown polygons, and how far it is
    pool: IntArray
    shape: IntArray  # rows, columns
    used: IntArray  # (1,)


class Memory(NamedTuple):
    """All nodes of a search, its queue and its closed list."""

    pose: Array  # (n, 3)
    twist: Array  # (n, 2)
    g: Array
    h: Array
    left: Array  # [s] that the job still needs
    t_goal: Array  # [s] estimated until the goal is achieved
    parent: IntArray
    action: IntArray
    depth: IntArray
    passed: NDArray[np.bool_]
    key: Array
    item: IntArray
    closed: NDArray[np.int64]
    count: NDArray[np.int64]
    scratch: IntArray
    curve: Array


def make_memory(expansions: int, notches: int, vertices: int) -> Memory:
    """Room for a search of that many expansions."""
    n = expansions * notches * notches + 2
    slots = 1 << (4 * expansions + 16).bit_length()
    ints = (np.zeros(n, np.int32) for _ in range(4))
    return Memory(
        np.zeros((n, 3)), np.zeros((n, 2)), np.zeros(n), np.zeros(n), np.zeros(n), np.zeros(n),
        next(ints), next(ints), next(ints), np.zeros(n, np.bool_), np.zeros(n), next(ints),
        np.full(slots, -1, np.int64), np.zeros(8, np.int64), np.zeros(vertices + 1, np.int32),
        np.zeros((BEZIER_SAMPLES + 1, 2)),
    )  # fmt: skip


def make_cell_sights(field: Field) -> CellSights:
    """An empty store for the cells of a map."""
    rows, columns = field.value.shape
    n = rows * columns
    return CellSights(
        np.full(n, -1, np.int32), np.zeros(n, np.int32), np.zeros((n, 3)), np.zeros(16 * n, np.int32),
        np.array([rows, columns], np.int32), np.zeros(1, np.int32),
    )  # fmt: skip
