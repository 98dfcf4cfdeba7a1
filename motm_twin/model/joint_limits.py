"""Limits of the arm's joints.

Source: Franka Control Interface documentation, "Robot and interface specifications", Panda column.
Positions and speeds stand in ``frankie.urdf`` too (a test keeps them equal); accelerations have no place in a URDF.
"""

import math

import numpy as np

from motm_twin.model.geometry import Array, frozen

Q_MIN = frozen([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])  # [rad], shape (7,)
Q_MAX = frozen([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])  # [rad], shape (7,)
DQ_MAX = frozen([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # [rad/s], shape (7,)
DDQ_MAX = frozen([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])  # [rad/s^2], shape (7,)
WRIST_MIN = 0.75  # [rad] of joint 6: below it, the hand would touch the forearm (at some angle of joint 7, below 0.7)
_BRAKING = 0.8  # of DDQ_MAX with which joints brake together: a lag of the drives must not take them above it

READY = frozen([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, math.pi / 4])  # [rad] hand down in front of the arm, shape (7,)


def braking_time(rates: Array) -> float:
    """Time [s] in which joints at these rates [rad/s], shape (7,), stop when they brake together.

    The hand then stays on its path. With each joint braking as hard as it can, a hand that fast joints kept level while
    its base drove on sank by 9 cm.
    """
    return float(np.max(np.abs(rates) / (_BRAKING * DDQ_MAX)))
