"""Which young cells belong to something static: its sides come into sight as the robot passes, and flicker at its edge.

A cell is static once it was hit for 3 s without a break (Paper, Sec. V). A side that a beam only grazes is hit for two
seconds and then missed for one, by a pose that is 2 cm off; and a side that comes into sight is new. Neither moves.
"""

import numpy as np
from numba import njit

from motm_twin.perception.clusters import label_cells


@njit(cache=True)
def touching(cells, anchors, others, reach):
    """Which cells hang together with one of the ``anchors``, through ``others`` up to ``reach`` apart; shape (m,).

    ``cells``: row and column, shape (m, 2); ``anchors`` and ``others``: shape (m,) each.
    """
    found = np.zeros(cells.shape[0], np.bool_)
    if not anchors.any() or not others.any():
        return found
    which = np.flatnonzero(anchors | others)
    label, count = label_cells(cells[which], reach)
    anchored = np.zeros(count, np.bool_)
    for i in range(which.shape[0]):
        if anchors[which[i]]:
            anchored[label[i]] = True
    for i in range(which.shape[0]):
        found[which[i]] = anchored[label[i]]
    return found
