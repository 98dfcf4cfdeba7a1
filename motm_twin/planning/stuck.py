"""Where the arm was stuck: the base goes elsewhere then."""

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import turn_between
from motm_twin.model.geometry import Array

PLACE, HEADING = 0.25, 0.6  # [m], [rad] this near to where the arm was stuck it may be so again,
COST = 10.0  # [s] which is worth going elsewhere, unless that takes longer; the arm tried for 6 s


def near(pose: Array, stuck_at: Array) -> NDArray[np.int64]:
    """How many of the poses (k, 3) from which the arm did not get to its target are near each pose, (m, 3) -> (m,)."""
    away = np.hypot(*(pose[:, None, :2] - stuck_at[None, :, :2]).transpose(2, 0, 1))
    swing = turn_between(pose[:, None, 2], stuck_at[None, :, 2])
    return np.sum((away <= PLACE) & (swing <= HEADING), axis=1)


def here(pose: Array, stuck_at: Array) -> bool:
    """Whether the arm was stuck near this pose (3,): having the target in reach is not enough there."""
    return len(stuck_at) > 0 and bool(near(np.asarray(pose)[None], stuck_at)[0])
