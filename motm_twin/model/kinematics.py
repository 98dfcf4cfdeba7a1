"""Kinematics of the whole robot: a planar base with the sideways direction dropped, and the arm on it (Paper, Sec. V).

Poses of the base are planar ``(x, y, heading)`` in any planar frame (world or odometry); every result is in that frame.
"""

import functools
import math
import xml.etree.ElementTree as ET

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from motm_twin.model.arm_kernels import HAND, fk_arm, placed_frames
from motm_twin.model.assets import LINKS, robot_urdf
from motm_twin.model.exact import times
from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile

_FINGER_Z = 0.0584  # [m] of the finger frames beyond the hand frame
_COLUMNS = (0, *range(2, 10))  # of the planar model's velocity: forward, yaw, seven joints; sideways dropped


class Frankie:
    """The robot's geometry for a given base pose, joints and gripper width; its only state is a workspace."""

    def __init__(self, profile: RobotProfile) -> None:
        """Kinematics for one profile; only its arm mount matters here."""
        self.profile = profile
        self.model = _model(profile)
        self.mount = np.array([profile.arm.mount_x, profile.arm.mount_y, profile.arm.mount_z])
        self._data = self.model.createData()
        self._tcp = self.model.getFrameId("panda_tcp")
        self._configuration = np.zeros(self.model.nq)

    def tcp_pose(self, pose: Array, q: Array) -> tuple[Array, Array]:
        """Position [m] shape (3,) and rotation shape (3, 3) of the tool centre point."""
        pin.forwardKinematics(self.model, self._data, self._configure(pose, q))
        T = pin.updateFramePlacement(self.model, self._data, self._tcp)
        return T.translation.copy(), T.rotation.copy()

    def tcp_jacobian(self, pose: Array, q: Array) -> Array:
        """Geometric Jacobian of the tool centre point, shape (6, 9).

        Columns: base forward speed, base yaw rate, seven joint rates. Rows: linear, angular, along the axes of the
        planar frame of ``pose``, at the tool centre point.
        """
        configuration = self._configure(pose, q)
        full = pin.computeFrameJacobian(
            self.model, self._data, configuration, self._tcp, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        return full[:, _COLUMNS]

    def mount_transform(self, pose: Array) -> Array:
        """Transform of the arm mount (``panda_link0``), shape (4, 4)."""
        T = _planar_transform(pose)
        T[:3, 3] += times(T[:3, :3], self.mount)
        return T

    def link_transforms(self, pose: Array, q: Array, width: float = 0.08) -> Array:
        """Transforms of `LINKS` with the gripper ``width`` [m] open, shape (12, 4, 4)."""
        arm = placed_frames(self.mount_transform(pose), fk_arm(np.asarray(q, dtype=float)))
        T = np.empty((len(LINKS), 4, 4))
        T[0] = _planar_transform(pose)
        T[1:9] = arm[:8]
        T[9:] = arm[HAND]
        T[10:, :3, 3] += _FINGER_Z * arm[HAND, :3, 2]
        T[10, :3, 3] += 0.5 * width * arm[HAND, :3, 1]
        T[11, :3, 3] -= 0.5 * width * arm[HAND, :3, 1]
        return T

    def _configure(self, pose: Array, q: Array) -> Array:
        configuration = self._configuration
        configuration[0], configuration[1] = pose[0], pose[1]
        configuration[2], configuration[3] = math.cos(pose[2]), math.sin(pose[2])
        configuration[4:] = q
        return configuration


@functools.cache
def _model(profile: RobotProfile) -> pin.Model:
    """The planar model with locked fingers, and the arm mounted as in the profile."""
    full = pin.buildModelFromXML(ET.tostring(robot_urdf(profile), encoding="unicode"), pin.JointModelPlanar())
    fingers = [full.getJointId(f"panda_finger_joint{i}") for i in (1, 2)]
    return pin.buildReducedModel(full, fingers, pin.neutral(full))


def _planar_transform(pose: Array) -> NDArray[np.float64]:
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return np.array([[c, -s, 0.0, pose[0]], [s, c, 0.0, pose[1]], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
