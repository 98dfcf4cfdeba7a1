"""Compiled parts of the agents' behaviour: how far the way ahead is free, and a way round."""

import math

import numpy as np
from numba import njit

from motm_twin.model.geometry import Array
from motm_twin.sim.kernels import Index, clearance

_BETTER = 0.002  # [m] of distance gained that counts as moving away


@njit(cache=True)
def free_ahead(pose: Array, radius: float, reach: float, corners: Array, first: Index, discs: Array) -> float:
    """Distance [m] that a disc of this radius can drive straight on, at most ``reach``.

    Something nearer than the radius already does not stop a motion that leads away from it.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    gap = clearance(pose[0], pose[1], corners, first, discs)
    travelled = 0.0
    while travelled < reach:
        step = min(max(gap - radius, 0.02), reach - travelled)
        ahead = clearance(pose[0] + c * (travelled + step), pose[1] + s * (travelled + step), corners, first, discs)
        if ahead < radius and ahead < gap + _BETTER * (step / 0.02):
            return travelled
        travelled += step
        gap = ahead
    return reach


@njit(cache=True)
def way_round(  # noqa: PLR0913
    start: Array, goal: Array, radius: float, cell: float, window: float, corners: Array, first: Index, discs: Array
) -> Array:
    """Points [m] of a shortest way on a grid for a disc, shape (n, 2); empty when there is none.

    The grid is a square of half width ``window`` about the start; a goal outside is replaced by the free cell nearest
    to it. Dijkstra over eight neighbours. Near the start a cell is free when it is no tighter than the start itself.
    """
    half = int(window / cell)
    n = 2 * half + 1
    free = np.zeros((n, n), dtype=np.bool_)
    here = clearance(start[0], start[1], corners, first, discs)
    for i in range(n):
        for j in range(n):
            x, y = start[0] + (i - half) * cell, start[1] + (j - half) * cell
            gap = clearance(x, y, corners, first, discs)
            near = math.hypot(x - start[0], y - start[1]) < 0.4
            free[i, j] = gap >= radius or (near and gap >= here)
    cost = np.full((n, n), np.inf)
    parent = np.full((n, n), -1, dtype=np.int64)
    done = np.zeros((n, n), dtype=np.bool_)
    heap = [(0.0, half * n + half)]
    cost[half, half] = 0.0
    best, best_left = -1, math.hypot(goal[0] - start[0], goal[1] - start[1]) - 2.0 * cell
    best_total = np.inf
    while len(heap) > 0:
        value, node = _pop(heap)
        i, j = node // n, node % n
        if done[i, j]:
            continue
        done[i, j] = True
        left = math.hypot(goal[0] - start[0] - (i - half) * cell, goal[1] - start[1] - (j - half) * cell)
        total = left + 0.3 * value
        if left < best_left and total < best_total:
            best, best_total = node, total
        if left < cell:
            best = node
            break
        for di in range(-1, 2):
            for dj in range(-1, 2):
                a, b = i + di, j + dj
                if a < 0 or b < 0 or a >= n or b >= n or not free[a, b] or done[a, b]:
                    continue
                new = value + cell * math.sqrt(di * di + dj * dj)
                if new < cost[a, b]:
                    cost[a, b] = new
                    parent[a, b] = node
                    _push(heap, (new, a * n + b))
    count, node = 0, best
    while node >= 0:
        count += 1
        node = parent[node // n, node % n]
    path = np.empty((max(0, count - 1), 2))
    node = best
    for k in range(count - 2, -1, -1):
        path[k, 0] = start[0] + (node // n - half) * cell
        path[k, 1] = start[1] + (node % n - half) * cell
        node = parent[node // n, node % n]
    return path


@njit(cache=True)
def _push(heap: list[tuple[float, int]], item: tuple[float, int]) -> None:
    heap.append(item)
    k = len(heap) - 1
    while k > 0 and heap[k] < heap[(k - 1) // 2]:
        heap[k], heap[(k - 1) // 2] = heap[(k - 1) // 2], heap[k]
        k = (k - 1) // 2


@njit(cache=True)
def _pop(heap: list[tuple[float, int]]) -> tuple[float, int]:
    top = heap[0]
    last = heap.pop()
    if len(heap) == 0:
        return top
    heap[0] = last
    k = 0
    while True:
        child = 2 * k + 1
        if child >= len(heap):
            return top
        if child + 1 < len(heap) and heap[child + 1] < heap[child]:
            child += 1
        if heap[k] <= heap[child]:
            return top
        heap[k], heap[child] = heap[child], heap[k]
        k = child
