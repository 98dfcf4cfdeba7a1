"""What the lag of the base means for its plans.

They are made from `command_pose`, where the commands given so far will take the base, and it follows them by its lag.
"""

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.planning.types import BasePlan


def dwell_to_plan(dwell: float | None, engaged: bool, lag: float) -> float | None:
    """Time [s] for which a plan keeps the target in reach; None: as long as the whole job takes.

    While the arm is at work, the base stays there for its lag by itself.
    """
    return max(0.0, dwell - lag) if engaged and dwell is not None else dwell


def followed(plan: BasePlan, lag: float, passed: float = 0.0) -> tuple[float, Array]:
    """When [s] the target comes into range, and when the base is at each pose of a plan made ``passed`` [s] ago."""
    later = lag - passed
    to_range = max(0.0, plan.time_to_range + later) if plan.time_to_range > 0.0 else 0.0
    return to_range, np.maximum(0.0, plan.local_times + later)
