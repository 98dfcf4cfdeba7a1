"""Distances in ascending order, of which most are infinite: nothing is near."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from motm_twin.model.geometry import Array

_SHORT = 32  # finite distances that are sorted one by one
_FEW = 384  # distances that NumPy sorts as they are


@njit(cache=True)
def nearest_first(distance: Array) -> NDArray[np.int64]:
    """Indices of the finite ones, nearest first; of equal ones as `np.argsort` has them."""
    order, count, unsorted = np.empty(distance.shape[0], dtype=np.int64), 0, False
    for i in range(distance.shape[0]):
        if not distance[i] < np.inf:
            continue
        if count == _SHORT:
            unsorted = True
            break
        k = count
        while k > 0 and distance[i] < distance[order[k - 1]]:
            order[k] = order[k - 1]
            k -= 1
        unsorted = unsorted or (k > 0 and distance[i] == distance[order[k - 1]])
        order[k] = i
        count += 1
    if not unsorted:
        return order[:count]
    close = np.flatnonzero(distance < np.inf)
    if distance.shape[0] <= _FEW:
        return np.argsort(distance)[: len(close)]
    return close[np.argsort(distance[close])]
