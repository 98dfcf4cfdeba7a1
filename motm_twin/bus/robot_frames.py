"""Messages of what the robot itself reports: its state with all frames, and the sweeps of its lidar."""

import numpy as np

from motm_twin.bus.encode import numbers
from motm_twin.bus.messages import ROBOT_VERSION, SCAN_VERSION, RobotStateMessage, ScanMessage
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.profile import RobotProfile

JOINT_NAMES = [f"panda_joint{number}" for number in range(1, 8)]
TCP_FRAME, CAMERA_FRAME, LIDAR_FRAME = "panda_tcp", "camera", "lidar"
_POSITION = 5  # digits: 0.01 mm
_QUATERNION = 6
_EXACT = 9


class RobotEncoder:
    """Makes the messages of one robot; holds its kinematics."""

    def __init__(self, profile: RobotProfile) -> None:
        from motm_twin.model.kinematics import Frankie  # slow to import: only once the server listens

        self._robot = Frankie(profile)
        lidar = profile.lidar
        self._lidar = np.array([lidar.x, lidar.y, lidar.z])

    def state(self, observation: Observation, run: int, server_time: float) -> RobotStateMessage:
        """The robot at one instant."""
        return RobotStateMessage(
            version=ROBOT_VERSION,
            run=run,
            server_time=server_time,
            time=round(float(observation.time), _EXACT),
            pose=numbers(observation.pose, _EXACT),
            odometry=numbers(observation.odometry, _EXACT),
            twist=numbers(observation.twist, _EXACT),
            joint_names=JOINT_NAMES,
            q=numbers(observation.q, _EXACT),
            dq=numbers(observation.dq, _EXACT),
            gripper_width=float(observation.gripper_width),
            gripper_moving=bool(observation.gripper_moving),
            frames=self._frames(observation),
        )

    def scan(self, scan: Scan, run: int, server_time: float) -> ScanMessage:
        """One sweep."""
        return ScanMessage(
            version=SCAN_VERSION,
            run=run,
            server_time=server_time,
            stamp=float(scan.stamp),
            pose=numbers(scan.pose, _EXACT),
            origin=numbers(scan.origin, _EXACT),
            angle_min=float(scan.angle_min),
            angle_step=float(scan.angle_step),
            range_min=float(scan.range_min),
            range_max=float(scan.range_max),
            ranges=numbers(scan.ranges),
        )

    def _frames(self, observation: Observation) -> dict[str, list[float]]:
        from motm_twin.model.kinematics import LINKS  # as above

        links = self._robot.link_transforms(observation.pose, observation.q, observation.gripper_width)
        tcp = np.eye(4)
        tcp[:3, 3], tcp[:3, :3] = self._robot.tcp_pose(observation.pose, observation.q)
        lidar = links[0].copy()
        lidar[:3, 3] += lidar[:3, :3] @ self._lidar
        camera = links[LINKS.index("panda_hand")]  # the palm camera looks along its z axis
        transforms = np.concatenate([links, np.stack([tcp, camera, lidar])])
        names = (*LINKS, TCP_FRAME, CAMERA_FRAME, LIDAR_FRAME)
        positions = np.round(transforms[:, :3, 3], _POSITION).tolist()
        turns = np.round(_quaternions(transforms[:, :3, :3]), _QUATERNION).tolist()
        return {name: [*position, *turn] for name, position, turn in zip(names, positions, turns, strict=True)}


def _quaternions(rotations: Array) -> Array:
    """Unit quaternions w, x, y, z of rotation matrices, shapes (n, 3, 3) and (n, 4); w is not negative."""
    from scipy.spatial.transform import Rotation  # as above

    x_y_z_w = Rotation.from_matrix(rotations).as_quat(canonical=True)
    return x_y_z_w[:, [3, 0, 1, 2]]
