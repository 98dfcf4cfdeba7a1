"""The robot against itself: which of its parts may touch each other, and how near they are."""

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.model.geometry import Array
from motm_twin.sim.referee_geometry import HELD

_CHAIN = {f"panda_link{k}": k for k in range(8)} | {"panda_hand": 8, "panda_leftfinger": 9, "panda_rightfinger": 9}
_ROOT_HALF = math.sqrt(0.5)


def self_pairs(bodies: tuple[str, ...]) -> NDArray[np.int64]:
    """Pairs of shapes of the arm that are not neighbours, the one nearer to the hand first, shape (k, 2).

    Neighbours are joined by a joint. Hand, fingers and what they hold are one part; the base is a thing like any other
    to the arm.
    """
    rank = [_CHAIN.get(body, -1) for body in bodies]
    pairs = []
    for i, body in enumerate(bodies):
        for k, other in enumerate(rank):
            if body == HELD:
                apart = 0 <= other <= _CHAIN["panda_link7"]
            else:
                apart = other >= 0 and rank[i] - other > 1 and other < _CHAIN["panda_hand"]
                apart = apart and not (other == _CHAIN["panda_link7"] and rank[i] > _CHAIN["panda_hand"])
            if apart:
                pairs.append((i, k))
    return np.array(pairs, dtype=np.int64).reshape(-1, 2)


@njit(cache=True)
def update_self_gaps(
    gaps: Array,
    pairs: NDArray[np.int64],
    now: Array,
    before: Array,
    centres: Array,
    radii: Array,
) -> NDArray[np.int64]:
    """Lower bounds [m] of the distances of pairs after one substep, in place; the indices of those below 0.

    Motion counts as seen from the base, whose transform is the first of ``now`` and ``before``, shapes (n, 4, 4): a
    robot that only drives comes no nearer to itself.
    """
    n = now.shape[0]
    moved, middle = np.empty(n), np.empty((n, 3))
    for i in range(n):
        way2, turn2 = 0.0, 0.0
        for r in range(3):
            middle[i, r] = now[i, r, 3]
            for k in range(3):
                middle[i, r] += now[i, r, k] * centres[i, k]
        for r in range(3):
            own, old = 0.0, 0.0
            for k in range(3):
                point = before[i, k, 3]
                for m in range(3):
                    point += before[i, k, m] * centres[i, m]
                own += now[0, k, r] * (middle[i, k] - now[0, k, 3])
                old += before[0, k, r] * (point - before[0, k, 3])
            way2 += (own - old) ** 2
            for c in range(3):
                turn = 0.0
                for k in range(3):
                    turn += now[0, k, r] * now[i, k, c] - before[0, k, r] * before[i, k, c]
                turn2 += turn**2
        moved[i] = math.sqrt(way2) + radii[i] * _ROOT_HALF * math.sqrt(turn2)
    below = []
    for p in range(pairs.shape[0]):
        i, k = pairs[p, 0], pairs[p, 1]
        gaps[p] -= moved[i] + moved[k]
        if gaps[p] < 0.0:
            away = 0.0
            for r in range(3):
                away += (middle[i, r] - middle[k, r]) ** 2
            gaps[p] = max(gaps[p], math.sqrt(away) - radii[i] - radii[k])
            if gaps[p] < 0.0:
                below.append(p)
    found = np.empty(len(below), dtype=np.int64)
    for p in range(len(below)):
        found[p] = below[p]
    return found
