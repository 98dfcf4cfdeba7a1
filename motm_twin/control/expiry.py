"""What a robot does after a command has expired: base and arm come to rest. Robot and twin reckon with the same."""

import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import braking_time
from motm_twin.model.plant import Actuation


def expired(twist: Array, joint_velocity: Array, gripper: str, since: float) -> Actuation:
    """What to do ``since`` [s] a command of this twist (2,) and these joint rates (7,) has expired.

    The base ramps to a stop within its limits, the joints come to rest together, the gripper stays as it is.
    """
    longest = braking_time(joint_velocity)
    share = 1.0 - since / longest if since < longest else 0.0
    return Actuation(twist=np.zeros_like(twist), joint_velocity=share * joint_velocity, gripper=gripper)
