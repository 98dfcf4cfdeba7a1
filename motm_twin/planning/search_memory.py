"""Data that a STAA* search reads and remembers, as tuples of arrays, and costs from the cells of the map."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.model.motion import kernel
from motm_twin.planning.bezier import bernstein
from motm_twin.planning.collision import Body, Field
from motm_twin.planning.cost_to_go import Table, cheapest
from motm_twin.planning.encounters import Weights
from motm_twin.planning.kernels import inlined
from motm_twin.planning.reach import Job
from motm_twin.planning.visibility import Graph, push_out, visible_vertices

IntArray = NDArray[np.int32]
BEZIER_SAMPLES = 8
SWING = 25  # columns, named in staa.py


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
    epsilon: float
    margin: float
    margin_floor: float
    margin_cost: float
    brake_depth: int
    free: float  # [m] a node with this clearance at its end is not tested half way
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
    bound: float  # [s] a plan that costs as much is of no use; inf: any plan is of use
    layers: int  # nodes of a plan in a search layer by layer (one depth after the other); 0: cheapest node first
    width: int  # nodes of each layer that are expanded
    moving_weight: float
    among: Weights  # of the costs of dynamic obstacles
    steadiness: float


class SeenFloor(NamedTuple):
    """Floor that has been seen, and the field of view of the lidar; half_view of pi: all round, no floor is tested."""

    seen: NDArray[np.uint8]  # `perception.floor`, (rows, columns)
    x: float  # [m] corner of cell (0, 0)
    y: float
    inverse_cell: float
    least: int  # least value of a cell that may be driven over backwards
    half_view: float  # [rad] to either side of straight ahead
    sensor_x: float  # [m] in the base frame
    sensor_y: float


_NOTHING = np.zeros((0, 0), np.uint8)
_NOTHING.setflags(write=False)  # read-only, as a seen floor is: kernels are compiled once
SEES_ALL = SeenFloor(_NOTHING, 0.0, 0.0, 1.0, 0, np.pi, 0.0, 0.0)


class LatticeCosts(NamedTuple):
    """Costs [s] of poses round a robot that cannot turn on the spot, see `lattice.py`; empty: none are needed."""

    value: Array  # (rows, columns, headings), `FAR`: not known
    x: float  # [m] corner of cell (0, 0)
    y: float


class World(NamedTuple):
    """The data that one search reads."""

    field: Field
    proximity: Field
    body: Body
    graph: Graph
    table: Table  # to the local goal, with the cost of the way after it
    next_table: Table  # to the next target
    job: Job
    lattice: LatticeCosts
    floor: SeenFloor
    moving: Array  # expected discs of dynamic obstacles, every half node, (n, k, 3); `field` is then without them
    others: Array  # dynamic obstacles that cost something, (k, 8), see `others_of`; `field` has none that goes on


class CellVisibility(NamedTuple):
    """Vertices seen from each map cell, found when first needed: a pure function of the graph, kept while it stays."""

    start: IntArray  # (cells,) into pool
    count: IntArray
    age: IntArray  # (cells,) value of `newest` when the vertices were found; entries of another age are out of date
    point: Array  # (cells, 3) point outside the grown polygons, and its distance
    pool: IntArray
    shape: IntArray  # rows, columns of the map; the arrays may have room for more
    used: IntArray  # (1,)
    newest: IntArray  # (1,)


G, H, LEFT, T_GOAL = 0, 1, 2, 3  # columns of Memory.cost
PARENT, ACTION, DEPTH = 0, 1, 2  # columns of Memory.link
NODES, QUEUE, EXPANSIONS, BEST, SOLUTION, LAYER, TAKEN = 0, 1, 2, 3, 4, 5, 6  # of Memory.count


class Memory(NamedTuple):
    """All nodes of a search, its queue and its closed list."""

    state: Array  # (n, 5) x, y, heading, v, w
    cost: Array  # (n, 4) g, h, time that the job still needs, estimated time until the goal is achieved [s]
    link: IntArray  # (n, 3) parent, action, depth
    passed: NDArray[np.bool_]  # (n,) True: the node ends the search
    cell: NDArray[np.int64]  # (n,) of the closed list
    key: Array
    item: IntArray
    closed: NDArray[np.int64]
    count: NDArray[np.int64]
    scratch: IntArray
    curve: Array
    weights: Array  # of the curve's control points, (BEZIER_SAMPLES + 1, 4)
    goal_way: Array  # (2,) cosine and sine of the goal's heading
    swing: Array  # (notches, SWING) values shared by all children of a node with the same yaw rate at their end


def make_memory(expansions: int, notches: int, vertices: int, *, layered: bool = False) -> Memory:
    """Memory for a search of that many expansions; a ``layered`` one also closes nodes that it does not expand."""
    n = expansions * notches * notches + 2
    slots = 1 << (2 * n if layered else 4 * expansions + 16).bit_length()
    return Memory(
        state=np.zeros((n, 5)),
        cost=np.zeros((n, 4)),
        link=np.zeros((n, 3), np.int32),
        passed=np.zeros(n, np.bool_),
        cell=np.zeros(n, np.int64),
        key=np.zeros(n),
        item=np.zeros(n, np.int32),
        closed=np.full(slots, -1, np.int64),
        count=np.zeros(8, np.int64),
        scratch=np.zeros(vertices + 1, np.int32),
        curve=np.zeros((BEZIER_SAMPLES + 1, 2)),
        weights=bernstein(BEZIER_SAMPLES),
        goal_way=np.zeros(2),
        swing=np.zeros((notches, SWING)),
    )


def make_cell_visibility(cells: int) -> CellVisibility:
    """An empty store with room for a map of that many cells."""
    return CellVisibility(
        np.zeros(cells, np.int32), np.zeros(cells, np.int32), np.zeros(cells, np.int32), np.zeros((cells, 3)),
        np.zeros(16 * cells, np.int32), np.zeros(2, np.int32), np.zeros(1, np.int32), np.zeros(1, np.int32),
    )  # fmt: skip


def forget_visibility(cells: CellVisibility, field: Field) -> None:
    """Empty the store for another graph or part of the map, without touching every cell."""
    cells.shape[:] = field.value.shape
    cells.used[0] = 0
    cells.newest[0] += 1


def branch_to(memory: Memory, node: int) -> list[int]:
    """The nodes from the root to ``node``."""
    branch = [node]
    while memory.link[branch[-1], PARENT] >= 0:
        branch.append(int(memory.link[branch[-1], PARENT]))
    return branch[::-1]


def to_go(memory: Memory, branch: list[int]) -> Array:
    """Cost [s] from each node of a branch on: that of the edges that follow, plus the heuristic at the branch's end."""
    spent = memory.cost[branch, G]
    return spent[-1] - spent + memory.cost[branch[-1], H]


def first_action(memory: Memory, branch: list[int], duration: float) -> Array:
    """The first acceleration of a branch, as the node was predicted: a speed limit may have reduced it."""
    if len(branch) == 1:  # only the root
        return np.zeros(2)
    return (memory.state[branch[1], 3:] - memory.state[0, 3:]) / duration


@kernel
def _look_round(c: int, field: Field, graph: Graph, cells: CellVisibility, scratch: IntArray) -> None:
    """Store the vertices seen from the middle of map cell c. A store that is full starts anew."""
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
    x: float, y: float, heading: float, table: Table, world: World, cells: CellVisibility, scratch: IntArray
) -> float:
    """PathRTR cost [s] from a pose to the goals of a table, by the vertices seen from its map cell."""
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
    return cheapest(x, y, heading, sx, sy, pushed, seen, world.graph, table)[0]
