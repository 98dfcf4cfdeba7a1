"""STAA*: time-bounded A* over accelerations, returning the node nearest to the goal when it is cut short.

Differences from STAA* (each can be switched off): goal heading, Bezier heuristic, proximity penalty scaled by k, and
the end of the search: when the path passes the goal, or when the job at the target is predicted to be done. For the
latter, every node holds the time that the job still needs; the cost on to the next target has the weight of C_iN. If
a plan is known already, nodes that cost more are discarded. Dynamic obstacles are predicted, as in STAA*, or are
obstacles at their present place, as in the paper.
All state is in `Memory`, so that a search can be interrupted after any number of expansions and continued.
"""

import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.planning.bezier import bezier_points, time_below
from motm_twin.planning.braking import can_stop
from motm_twin.planning.collision import BORDER, ROUNDING, SLOPE, Body, clearance, clearance_from, distance_at
from motm_twin.planning.cost_to_go import FAR
from motm_twin.planning.encounters import cost_among
from motm_twin.planning.kernels import heap_pop, heap_push, inlined, kernel, length_of
from motm_twin.planning.lattice import lattice_cost
from motm_twin.planning.prediction import at_half_steps, gap_to, way_to
from motm_twin.planning.reach import MANIPULATE, Job, in_reach, manipulable
from motm_twin.planning.rtr import TWO_PI, turn
from motm_twin.planning.search_memory import (
    ACTION,
    BEST,
    DEPTH,
    EXPANSIONS,
    LAYER,
    LEFT,
    NODES,
    PARENT,
    QUEUE,
    SOLUTION,
    T_GOAL,
    TAKEN,
    CellVisibility,
    G,
    H,
    Memory,
    SeenFloor,
    Settings,
    World,
    cost_at,
)

GOAL, ABORTED, DRY = 1, 2, 3
NO_GOAL_TEST, END_TEST, PASS_TEST = 0, 1, 2
# Columns of a row of `Memory.swing`, at the end or in the middle (MID) of a node: WAY is the direction of travel,
# FACING (in the middle MID) the heading; _C and _S are cosine and sine.
YAW_RATE, NOTCH, CHORD, WAY_C, WAY_S, FACING, FACING_C, FACING_S = range(8)
MID_WAY_C, MID_WAY_S, MID, MID_C, MID_S, HALF_WAY, WHOLE_WAY, HEADING_BIN, YAW_RATE_BIN = (
    8,
    9,
    10,
    11,
    12,
    13,
    18,
    23,
    24,
)
ALL_ROUND = 3.1  # [rad] half field of view from which on the lidar sees the floor that the base reverses to
APART = 1e4  # [s] between the keys of two layers
LATER, LATEST = 0.6, 16  # [s] of a bin of time in the closed list, and their number
BEZIER_GAIN = 0.05  # [s] a curve that cannot save more than this is skipped


@inlined
def _bezier_cost(
    x: float, y: float, heading: float, c: float, si: float, limit: float, s: Settings, world: World, memory: Memory
) -> float:
    """Time [s] of the Bezier curve to the goal when it is free and below `limit`, else FAR."""
    straight = length_of(s.goal_x - x, s.goal_y - y)
    if straight / s.v_f + BEZIER_GAIN >= limit or straight < 1e-3:
        return FAR
    curve = memory.curve
    goal_c, goal_s = memory.goal_way[0], memory.goal_way[1]
    bezier_points(x, y, c, si, s.goal_x, s.goal_y, goal_c, goal_s, s.bezier_offset, memory.weights, curve)
    time = time_below(curve, heading, c, si, s.goal_heading, goal_c, goal_s, s.v_f, s.w_max, limit)
    if time >= limit:
        return FAR
    for i in range(1, curve.shape[0] - 1):
        if distance_at(curve[i, 0], curve[i, 1], world.field) < world.body.inner + s.margin:
            return FAR
    return time


@inlined
def _judge(
    x: float, y: float, heading: float, c: float, si: float, reached: bool, done: bool, s: Settings, world: World,
    cells: CellVisibility, memory: Memory,
) -> tuple[float, float]:  # fmt: skip
    """Heuristic h and time to the goal t_h [s] of a pose; c, si: cosine and sine of its heading."""
    onward = FAR
    if reached and s.drive_on:
        onward = 0.0
        if s.has_next:
            onward = s.next_weight * cost_at(x, y, heading, world.next_table, world, cells, memory.scratch)
        if done:
            return onward, 0.0
    h = lattice_cost(x, y, heading, world.table.rates.turn, world.lattice)
    if h < FAR:
        return min(h, onward), 0.0 if reached else max(0.0, h - s.after_goal)
    h = cost_at(x, y, heading, world.table, world, cells, memory.scratch)
    if s.bezier and not math.isnan(s.goal_heading):
        after = world.table.goal[0, 1]
        h = min(h, after + _bezier_cost(x, y, heading, c, si, h - after, s, world, memory))
    return min(h, onward), 0.0 if reached else max(0.0, h - s.after_goal)


@kernel
def _passes(x: float, y: float, heading: float, s: Settings) -> bool:
    """Test that a pose passes the goal (Paper, Sec. III-C); `planning/search_settings.py` chooses the goal test."""
    if length_of(x - s.goal_x, y - s.goal_y) > s.pass_distance:
        return False
    if math.isnan(s.goal_heading):
        return True
    return turn(heading, s.goal_heading) <= s.pass_heading


@inlined
def _cell_of(x: float, y: float, v_bin: int, row: Array, later: int, s: Settings) -> int:
    """Key of a node's cell in the closed list; ``row`` of `swing`. ``later``: bin of time, 0 if time does not count."""
    i, j = int(math.floor(x / s.cell)) + 100_000, int(math.floor(y / s.cell)) + 100_000
    k, w = int(row[HEADING_BIN]), int(row[YAW_RATE_BIN])
    return ((((i * 200_000 + j) * s.heading_bins + k) * s.speed_bins + v_bin) * s.speed_bins + w) * LATEST + later


@kernel
def _close(key: int, closed: NDArray[np.int64], add: int) -> bool:
    """Test that a cell is closed already; with `add`, close it."""
    slots = closed.shape[0]
    at = (key * 2_654_435_761) & (slots - 1)
    while closed[at] != -1:
        if closed[at] == key:
            return True
        at = (at + 1) & (slots - 1)
    if add == 1:
        closed[at] = key
    return False


@kernel
def _proximity_cost(x: float, y: float, heading: float, free: float, s: Settings, world: World) -> float:
    """Proximity C of the footprint to obstacles, 0 .. 1."""
    if not s.grid_map:
        return max(0.0, 1.0 - free / s.grid_range)
    c, si = math.cos(heading), math.sin(heading)
    worst = 0.0
    for i in range(4):
        px, py = world.body.corner[i, 0], world.body.corner[i, 1]
        worst = max(worst, distance_at(x + c * px - si * py, y + si * px + c * py, world.proximity))
    return worst


@kernel
def _backs_into_the_unknown(
    before: Array, x: float, y: float, c: float, si: float, floor: SeenFloor, body: Body
) -> bool:
    """Test that a base that reverses to (x, y) moves its rear over floor not seen by then; c, si of its heading.

    ``before``: the pose it comes from, where the lidar sees more. Floor outside the kept grid will be seen on the way.
    """
    c_0, s_0 = math.cos(before[2]), math.sin(before[2])
    sensor_x = before[0] + c_0 * floor.sensor_x - s_0 * floor.sensor_y
    sensor_y = before[1] + s_0 * floor.sensor_x + c_0 * floor.sensor_y
    rear, half = 2.0 * body.centre_x - body.corner[3, 0], body.corner[3, 1]
    for i in range(-1, 2):
        px, py = x + c * rear - si * half * i, y + si * rear + c * half * i
        row, column = math.floor((py - floor.y) * floor.inverse_cell), math.floor((px - floor.x) * floor.inverse_cell)
        if row < 0 or column < 0 or row >= floor.seen.shape[0] or column >= floor.seen.shape[1]:
            continue
        if floor.seen[row, column] < floor.least:
            if turn(math.atan2(py - sensor_y, px - sensor_x), before[2]) > floor.half_view:
                return True
    return False


@kernel
def start_search(pose: Array, twist: Array, left: float, memory: Memory) -> None:
    """Put the root into the queue. left: time [s] that the job still needs."""
    for i in range(memory.closed.shape[0]):
        memory.closed[i] = -1
    for i in range(memory.count.shape[0]):
        memory.count[i] = 0
    for i in range(3):
        memory.state[0, i] = pose[i]
    for i in range(2):
        memory.state[0, 3 + i] = twist[i]
    memory.cost[0, G], memory.cost[0, H], memory.cost[0, LEFT], memory.cost[0, T_GOAL] = 0.0, 0.0, left, 0.0
    memory.link[0, PARENT], memory.link[0, ACTION], memory.link[0, DEPTH] = -1, -1, 0
    memory.passed[0] = False
    memory.key[0], memory.item[0] = 0.0, 0
    memory.count[NODES], memory.count[QUEUE], memory.count[BEST] = 1, 1, -1


@inlined
def _swings(node: int, left: float, by_reach: bool, s: Settings, memory: Memory) -> int:
    """Fill `swing` with all values that depend only on the yaw rate at the end; returns the number of yaw rates."""
    dt, swing, half_notches = s.node_duration, memory.swing, s.notches // 2
    heading, w_0 = memory.state[node, 2], memory.state[node, 4]
    count, w_before = 0, math.inf
    for j in range(-half_notches, half_notches + 1):
        b = s.b_max * j / half_notches
        w_end = min(s.w_max, max(-s.w_max, w_0 + b * dt))
        if j == 0 and s.steadiness > 0.0 and abs(w_0) < 0.5 * s.b_max * dt / half_notches:
            w_end = 0.0  # with a cost of turning, going straight must be among the choices
        if w_end == w_before:
            continue
        w_before = w_end
        w = 0.5 * (w_0 + w_end)
        half = 0.5 * w * dt
        # The way to the middle is driven with the mean of the first half, not with that of the whole node.
        w_m = 0.75 * w_0 + 0.25 * w_end
        middle, m_heading = heading + 0.25 * w_m * dt, heading + 0.5 * w_m * dt
        row = swing[count]
        row[YAW_RATE], row[NOTCH] = w_end, j + half_notches
        row[CHORD] = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        row[WAY_C], row[WAY_S], row[FACING] = math.cos(heading + half), math.sin(heading + half), heading + w * dt
        row[FACING_C], row[FACING_S] = math.cos(row[FACING]), math.sin(row[FACING])
        row[MID_WAY_C], row[MID_WAY_S], row[MID] = math.cos(middle), math.sin(middle), m_heading
        row[MID_C], row[MID_S] = math.cos(m_heading), math.sin(m_heading)
        turns = row[FACING] / TWO_PI
        row[HEADING_BIN] = min(s.heading_bins - 1, int((turns - math.floor(turns)) * s.heading_bins))
        yaw_rate_bin = int((w_end + s.w_max) / (2.0 * s.w_max) * s.speed_bins)
        row[YAW_RATE_BIN] = min(s.speed_bins - 1, max(0, yaw_rate_bin))
        if by_reach and left > 0.0:
            _turned(row[HALF_WAY:WHOLE_WAY], heading, w_0, w_end, min(0.5, left / dt), dt)
            _turned(row[WHOLE_WAY:], heading, w_0, w_end, min(1.0, left / dt), dt)
        count += 1
    return count


@kernel
def _turned(row: Array, heading: float, w_0: float, w_end: float, f: float, dt: float) -> None:
    """Yaw rate, and cosine and sine of travel direction and heading, a fraction f into a node of duration dt [s]."""
    w = w_0 + f * (w_end - w_0)
    w_m, t = 0.5 * (w_0 + w), f * dt
    ahead, facing = heading + 0.5 * w_m * t, heading + w_m * t
    row[0], row[1], row[2], row[3], row[4] = w, math.cos(ahead), math.sin(ahead), math.cos(facing), math.sin(facing)


@kernel
def _reached_at(x: float, y: float, v_0: float, v_end: float, f: float, dt: float, row: Array, job: Job) -> bool:
    """Test that the target is in reach a fraction f into a node of duration dt [s]; row of `_turned`."""
    v = v_0 + f * (v_end - v_0)
    v_m = 0.5 * (v_0 + v)
    t = f * dt
    return manipulable(x + v_m * t * row[1], y + v_m * t * row[2], row[3], row[4], v, row[0], job)


@inlined
def _counts(s: Settings) -> float:
    """Clearance [m] beyond which costs do not depend on it."""
    return max(BORDER, s.margin, s.grid_range if s.grid_weight > 0.0 and not s.grid_map else 0.0)


@inlined
def _free_way(before: Array, pose: Array, row: Array, depth: int, allowed: float, s: Settings, world: World) -> float:
    """Clearance [m] at the end of a node, as far as costs depend on it; -inf if end or way are not free.

    ``before``, ``pose``: states at both ends; row of `swing`.
    """
    v_end, w_end, body, field = pose[3], pose[4], world.body, world.field
    # Costs depend on clearance up to `_counts`; more of it matters only where the way is not free, or near the root.
    enough = s.free if depth <= s.brake_depth else min(s.free, _counts(s) + body.slack)
    free = clearance_from(pose[0], pose[1], row[FACING_C], row[FACING_S], enough, allowed, field, body)
    if free < allowed:
        return -math.inf
    if v_end < 0.0 and world.floor.half_view < ALL_ROUND:
        if _backs_into_the_unknown(before, pose[0], pose[1], row[FACING_C], row[FACING_S], world.floor, body):
            return -math.inf
    mx, my = _half_way(before, pose, row, s)
    if free < s.free:
        away = length_of(pose[0] - mx, pose[1] - my)
        away += (body.outer + abs(body.centre_x)) * abs(pose[2] - row[MID])
        if allowed <= 0.0 or free - SLOPE * away < allowed + ROUNDING:
            at_most = max(allowed, BORDER) + body.slack
            middle = clearance_from(mx, my, row[MID_C], row[MID_S], at_most, allowed, field, body)
            if middle < allowed and (
                free < enough
                or clearance_from(pose[0], pose[1], row[FACING_C], row[FACING_S], s.free, allowed, field, body) < s.free
            ):
                return -math.inf
    if depth <= s.brake_depth and not can_stop(
        pose[0], pose[1], row[FACING_C], row[FACING_S], pose[2], free if free < s.free else math.inf, v_end, w_end,
        s.a_max, s.b_max, allowed, field, body,
    ):  # fmt: skip
        return -math.inf
    if world.moving.shape[1] > 0:
        discs = world.moving[at_half_steps(2 * depth, world.moving)]
        free = min(free, gap_to(pose[0], pose[1], row[FACING_C], row[FACING_S], discs, body))
        between = world.moving[at_half_steps(2 * depth - 1, world.moving)]
        if free < allowed or gap_to(mx, my, row[MID_C], row[MID_S], between, body) < allowed:
            return -math.inf
    return free


@inlined
def _half_way(before: Array, pose: Array, row: Array, s: Settings) -> tuple[float, float]:
    """Place [m] in the middle of a node: `model.motion.step` of its first half, with the row of `swing`."""
    v_m = 0.75 * before[3] + 0.25 * pose[3]
    way = 0.5 * v_m * s.node_duration
    return before[0] + way * row[MID_WAY_C], before[1] + way * row[MID_WAY_S]


@inlined
def _job_after(
    before: Array, pose: Array, row: Array, left: float, root_reached: bool, s: Settings, job: Job
) -> tuple[float, bool, bool, bool]:
    """Time [s] that the job still needs after a node; tests: target in reach, job done, reach lost that must be kept.

    ``left``: that time [s] before the node.
    """
    x, y, v_0, w_0, dt = before[0], before[1], before[3], before[4], s.node_duration
    if not s.by_job:
        return left, False, False, False
    if job.kind == MANIPULATE:
        reached = manipulable(pose[0], pose[1], row[FACING_C], row[FACING_S], pose[3], pose[4], job)
        if left > 0.0:
            # Reach is tested half way and at the end, or exactly when the job would be done, if that is earlier.
            kept = _reached_at(x, y, v_0, pose[3], min(0.5, left / dt), dt, row[HALF_WAY:WHOLE_WAY], job)
            f = min(1.0, left / dt)
            kept_on = reached if f == 1.0 else _reached_at(x, y, v_0, pose[3], f, dt, row[WHOLE_WAY:], job)
            if s.keep_reach and root_reached and not (kept and kept_on):
                return left, reached, False, True
            if not kept:
                left = job.dwell
            left = left - (0.5 if not kept else 1.0) * dt if kept_on else job.dwell
            left = 0.0 if left < 1e-6 else left
    else:
        reached = in_reach(pose[0], pose[1], pose[2], pose[3], pose[4], job)
        mx, my = _half_way(before, pose, row, s)
        if reached or in_reach(mx, my, row[MID], v_0, w_0, job):
            left = 0.0
    return left, reached, left <= 0.0, False


@inlined
def proximity_scale(t_h: float, k_min: float, k_time: float) -> float:
    """k = max(0.1, min(t_h / 3, 1)): scale of the proximity penalty t_h [s] before the goal (Paper, Sec. III-D)."""
    return max(k_min, min(t_h / k_time, 1.0))


@inlined
def _node_costs(
    before: Array, pose: Array, free: float, t_goal: float, s: Settings, world: World
) -> tuple[float, float, float]:
    """Costs [s] of a node: of obstacles beside it, of being inside the margin, and of changing the yaw rate."""
    k = proximity_scale(t_goal, s.k_min, s.k_time) if s.scale_penalty else 1.0
    cost = _proximity_cost(pose[0], pose[1], pose[2], free, s, world) if s.grid_weight > 0.0 else 0.0
    inside = s.margin_cost * max(0.0, 1.0 - max(0.0, free) / s.margin)
    return k * s.grid_weight * cost, inside, s.steadiness * abs(pose[4] - before[4]) / s.b_max


@inlined
def _child(
    node: int, v_end: float, v_bin: int, row: Array, action: int, allowed: float, root_reached: bool, s: Settings,
    world: World, cells: CellVisibility, memory: Memory,
) -> None:  # fmt: skip
    """Make the child that ends at the given speed and with a row of `swing`, if it is free and new, and queue it."""
    before, n = memory.state[node], memory.count[NODES]
    chord = 0.5 * (before[3] + v_end) * s.node_duration * row[CHORD]
    pose = memory.state[n]
    pose[0] = before[0] + chord * row[WAY_C]
    pose[1] = before[1] + chord * row[WAY_S]
    pose[2], pose[3], pose[4] = row[FACING], v_end, row[YAW_RATE]
    if length_of(pose[0] - s.region_x, pose[1] - s.region_y) > s.region_radius:
        return
    depth = memory.link[node, DEPTH] + 1
    later = min(int(depth * s.node_duration / LATER), LATEST - 1) if world.others.shape[0] > 0 else 0
    memory.cell[n] = _cell_of(pose[0], pose[1], v_bin, row, later, s)
    if _close(memory.cell[n], memory.closed, 0):
        return
    free = _free_way(before, pose, row, depth, allowed, s, world)
    if free == -math.inf:
        return
    left, reached, done, lost = _job_after(before, pose, row, memory.cost[node, LEFT], root_reached, s, world.job)
    if lost:
        return
    c, si = row[FACING_C], row[FACING_S]
    h, t_goal = _judge(pose[0], pose[1], pose[2], c, si, reached or done, done, s, world, cells, memory)
    if h >= FAR:
        return
    beside, inside, turning = _node_costs(before, pose, free, t_goal, s, world)
    spent = memory.cost[node, G] + s.node_duration + beside + inside
    spent += turning
    if s.moving_weight > 0.0:
        discs = world.moving[at_half_steps(2 * depth, world.moving)]
        spent += s.moving_weight * max(0.0, 1.0 - way_to(pose[0], pose[1], discs))
    if world.others.shape[0] > 0:
        mx, my = _half_way(before, pose, row, s)
        half, end = (depth - 0.5) * s.node_duration, depth * s.node_duration
        spent += max(
            cost_among(mx, my, row[MID_C], row[MID_S], half, world.others, world.body, s.among),
            cost_among(pose[0], pose[1], c, si, end, world.others, world.body, s.among),
        )
    if spent + h >= s.bound:
        return
    memory.cost[n, G] = spent
    memory.cost[n, H], memory.cost[n, T_GOAL], memory.cost[n, LEFT] = h, t_goal, left
    memory.link[n, PARENT], memory.link[n, ACTION], memory.link[n, DEPTH] = node, action, depth
    memory.passed[n] = done
    if s.goal_test != NO_GOAL_TEST:
        mx, my = _half_way(before, pose, row, s)
        at_end = _passes(pose[0], pose[1], pose[2], s)
        memory.passed[n] = done or at_end or (s.goal_test == PASS_TEST and _passes(mx, my, row[MID], s))
    memory.count[NODES] = n + 1
    key = memory.cost[n, G] + s.epsilon * h + (APART * depth if s.width > 0 else 0.0)
    memory.count[QUEUE] = heap_push(memory.key, memory.item, memory.count[QUEUE], key, n)


@inlined
def _is_best(node: int, s: Settings, memory: Memory) -> bool:
    """Test that a popped node is the best so far: nearest to the goal, or cheapest of the deepest layer."""
    best = memory.count[BEST]
    if best < 0:
        return True
    if s.width > 0:
        return memory.link[node, DEPTH] > memory.link[best, DEPTH]
    return memory.cost[node, H] < memory.cost[best, H]


@inlined
def _layer_is_full(node: int, s: Settings, memory: Memory) -> bool:
    """Count a node in its layer; test that enough others were expanded there."""
    if s.width == 0:
        return False
    count, depth = memory.count, memory.link[node, DEPTH]
    if depth > count[LAYER]:
        count[LAYER], count[TAKEN] = depth, 0
    count[TAKEN] += 1
    return count[TAKEN] > s.width


@kernel
def run_search(limit: int, s: Settings, world: World, cells: CellVisibility, memory: Memory) -> int:
    """Continue until `limit` expansions in total; returns GOAL, ABORTED (limit or last layer) or DRY (empty queue).

    The answer is then node count[SOLUTION]; -1 when nothing but the root was popped.
    """
    count = memory.count
    start = memory.state[0]
    root = clearance(start[0], start[1], start[2], 1.0, world.field, world.body)
    c, si = math.cos(start[2]), math.sin(start[2])
    root = min(root, gap_to(start[0], start[1], c, si, world.moving[0], world.body))
    # A root inside the margin may leave it. Turning away swings a corner outwards, so that coming a little nearer must
    # be possible, down to the floor; a root below the floor may not make it worse.
    allowed = s.margin if root >= s.margin else min(s.margin_floor, root - 0.001)
    root_reached = s.by_job and in_reach(start[0], start[1], start[2], start[3], start[4], world.job)
    memory.goal_way[0], memory.goal_way[1] = math.cos(s.goal_heading), math.sin(s.goal_heading)
    half = s.notches // 2
    while True:
        if count[EXPANSIONS] >= limit:
            count[SOLUTION] = count[BEST]
            return ABORTED
        if count[QUEUE] == 0:
            count[SOLUTION] = count[BEST]
            return DRY
        node = memory.item[0]
        count[QUEUE] = heap_pop(memory.key, memory.item, count[QUEUE])
        if node > 0:
            if memory.passed[node]:
                count[SOLUTION] = node
                return GOAL
            if _is_best(node, s, memory):
                count[BEST] = node
                if 0 < s.layers <= memory.link[node, DEPTH]:
                    count[SOLUTION] = node
                    return ABORTED
            if _close(memory.cell[node], memory.closed, 1) or _layer_is_full(node, s, memory):
                continue
        count[EXPANSIONS] += 1
        swings = _swings(node, memory.cost[node, LEFT], s.by_job and world.job.kind == MANIPULATE, s, memory)
        v_before = math.inf
        for i in range(-half, half + 1):
            a = s.a_max * i / half
            v_end = min(s.v_f, max(-s.v_r, memory.state[node, 3] + a * s.node_duration))
            if world.others.shape[0] > 0 and v_end * memory.state[node, 3] < 0.0:
                v_end = 0.0  # a base that may have to wait can stand
            if v_end == v_before:
                continue
            v_before = v_end
            v_bin = min(s.speed_bins - 1, max(0, int((v_end + s.v_r) / (s.v_f + s.v_r) * s.speed_bins)))
            for k in range(swings):
                row = memory.swing[k]
                action = (i + half) * s.notches + int(row[NOTCH])
                _child(node, v_end, v_bin, row, action, allowed, root_reached, s, world, cells, memory)
