"""The slate of the arm side: what the kernels of one arm step write down for each other.

It is one record of fixed shapes, with the parameters as well. A kernel that is called from Python pays for each array
that it is given, but for a record once, whatever is in it. The next step writes over it: what goes into a Tick or a
state is copied.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from motm_twin.control.parameters import ArmParameters, numbers
from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile

SIZE = 17  # decision variables of the QP, as `qp_rows` tells them
Record = NDArray[np.void]  # of `Slate.record`, shape (1,): a kernel reads and writes `record[0].q`

_SHAPES: dict[str, tuple[int, ...]] = {
    "base_mount": (3,),
    "joint_limits": (4, 7),
    "q": (7,),
    "dq": (7,),
    "pose": (3,),
    "measured": (2,),
    "blind": (1,),
    "wanted": (2,),
    "twist": (2,),
    "T_odom_world": (3,),
    "T": (11, 4, 4),
    "p": (3,),
    "R": (3, 3),
    "arm": (6, 7),
    "factor": (6, 6),
    "J": (6, 9),
    "mount": (3,),
    "target": (3,),
    "velocity": (6,),
    "c": (SIZE,),
    "A": (6, SIZE),
    "b": (6,),
    "lower": (SIZE,),
    "upper": (SIZE,),
}


class Slate:
    """The record, and its arrays by name for Python."""

    base_mount: Array  # [m] of the arm, base frame, shape (3,): as given, never written over
    joint_limits: Array  # of `qp_rows.joint_limits`, shape (4, 7): as given
    q: Array  # [rad], shape (7,)
    dq: Array  # [rad/s], shape (7,)
    pose: Array  # of the base, odometry frame, shape (3,)
    measured: Array  # base twist now, shape (2,)
    blind: Array  # [s] in which the robot goes on and comes to rest should no command come any more, shape (1,)
    wanted: Array  # base twist that its planner wants, shape (2,)
    twist: Array  # base twist expected while the commanded arm rates act, shape (2,)
    T_odom_world: Array  # planar pose of the world frame in the odometry frame, shape (3,)
    T: Array  # arm transforms relative to the mount, shape (11, 4, 4)
    p: Array  # [m] tool centre point, odometry frame, shape (3,)
    R: Array  # rotation of the hand, odometry frame, shape (3, 3)
    arm: Array  # Jacobian of the arm in the axes of the mount, shape (6, 7)
    factor: Array  # lower factor of that times its transpose, shape (6, 6)
    J: Array  # Jacobian of the tool centre point, odometry frame, shape (6, 9)
    mount: Array  # [m] of the arm, odometry frame, shape (3,)
    target: Array  # [m] that the object's centre is to reach or is at, odometry frame, shape (3,)
    velocity: Array  # nu of the hand: linear [m/s], angular [rad/s], odometry frame, shape (6,)
    c: Array  # linear cost of the QP, shape (17,)
    A: Array  # its rows of the hand, shape (6, 17)
    b: Array  # and what they are equal to, shape (6,)
    lower: Array  # its bounds, shape (17,)
    upper: Array  # shape (17,)

    def __init__(self, profile: RobotProfile, parameters: ArmParameters, joint_limits: Array) -> None:
        """A slate for one arm side; ``joint_limits`` (4, 7) of `qp_rows.joint_limits`.

        Kernels find `numbers` of the parameters under ``arm_numbers``, ``qp``, ``avoidance`` and ``base``.
        """
        parts = {
            "arm_numbers": numbers(parameters),
            "qp": numbers(parameters.qp),
            "avoidance": numbers(parameters.avoidance),
            "base": numbers(profile.base),
        }
        shapes: list[Any] = [(name, float, shape) for name, shape in _SHAPES.items()]
        shapes += [(name, part.dtype, (1,)) for name, part in parts.items()]
        self.record: Record = np.zeros(1, np.dtype(shapes))
        for name, part in parts.items():
            self.record[name][0] = part
        for name in _SHAPES:
            setattr(self, name, self.record[name][0])
        arm = profile.arm
        self.base_mount[:], self.joint_limits[:] = (arm.mount_x, arm.mount_y, arm.mount_z), joint_limits
