"""From the twin's messages to ROS 2 messages. Stamps are the twin's time [s], frames are those of `robot_model`."""

import math
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from motm_twin.bus.messages import GridInfo, PlanMessage, RobotStateMessage, ScanMessage
from motm_twin.model.geometry import compose, inverse
from motm_twin.ros2.cdr import Message
from motm_twin.ros2.robot_model import BASE, FINGERS, LIDAR, Quaternion, RobotModel, Transform, turned

MAP, ODOM = "map", "odom"
_PLANAR = 1e-9  # variance of motions that a wheeled base lacks: height, roll, pitch
_POSE_SD = (0.02, 0.02, 0.01)  # [m, m, rad] of odometry over a scene: a scale error of 0.3 % over some metres
_TWIST_SD = (0.002, 0.002)  # [m/s, rad/s] of the measured twist
_OCCUPIED, _FREE_STEPS = 255, 254  # of a cell of the twin's grid


def stamp(seconds: float) -> Message:
    """A time [s]."""
    nanoseconds = max(0, round(seconds * 1e9))
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def header(time: float, frame: str) -> Message:
    """A header."""
    return {"stamp": stamp(time), "frame_id": frame}


def vector(x: float, y: float, z: float = 0.0) -> Message:
    """A point or vector."""
    return {"x": x, "y": y, "z": z}


def quaternion(values: Quaternion) -> Message:
    """A quaternion."""
    x, y, z, w = values
    return {"x": x, "y": y, "z": z, "w": w}


def planar_pose(x: float, y: float, yaw: float, z: float = 0.0) -> Message:
    """A pose that stands upright."""
    return {"position": vector(x, y, z), "orientation": quaternion(turned(yaw))}


def yaw_of(orientation: Message) -> float:
    """The turn [rad] about z of an orientation; raises ValueError when it is none."""
    x, y, z, w = (orientation[name] for name in "xyzw")
    if not 0.5 < math.hypot(x, y, z, w) < 2.0:  # nan neither
        raise ValueError(f"({x:g}, {y:g}, {z:g}, {w:g}) is no orientation: a quaternion has the length 1")
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def clock(time: float) -> Message:
    """rosgraph_msgs/Clock."""
    return {"clock": stamp(time)}


def joint_values(robot: RobotStateMessage) -> dict[str, float]:
    """Positions [rad, m] by joint, fingers included."""
    half = 0.5 * robot.gripper_width
    return {**dict(zip(robot.joint_names, robot.q, strict=True)), **dict.fromkeys(FINGERS, half)}


def joint_states(robot: RobotStateMessage, model: RobotModel) -> Message:
    """sensor_msgs/JointState: the arm and both fingers; the twin measures no finger speeds and no efforts."""
    if not model.moving_joints:
        return {"header": header(robot.time, ""), "name": [], "position": [], "velocity": [], "effort": []}
    values = joint_values(robot)
    return {
        "header": header(robot.time, ""),
        "name": list(values),
        "position": list(values.values()),
        "velocity": [*robot.dq, *(0.0 for _ in FINGERS)],
        "effort": [],
    }


def odometry(robot: RobotStateMessage) -> Message:
    """nav_msgs/Odometry: dead reckoning, as the wheels tell it."""
    x, y, heading = robot.odometry
    twist = {"linear": vector(robot.twist[0], 0.0), "angular": vector(0.0, 0.0, robot.twist[1])}
    pose_sd, (v_sd, w_sd) = _POSE_SD, _TWIST_SD
    return {
        "header": header(robot.time, ODOM),
        "child_frame_id": BASE,
        "pose": {"pose": planar_pose(x, y, heading), "covariance": _covariance(*pose_sd)},
        "twist": {"twist": twist, "covariance": _covariance(v_sd, 0.0, w_sd)},
    }


def _covariance(x_sd: float, y_sd: float, yaw_sd: float) -> NDArray[np.float64]:
    return np.diag([x_sd**2 or _PLANAR, y_sd**2 or _PLANAR, _PLANAR, _PLANAR, _PLANAR, yaw_sd**2]).ravel()


def transforms(robot: RobotStateMessage, model: RobotModel) -> Message:
    """tf2_msgs/TFMessage: map to odom (localisation), odom to base (dead reckoning), and the arm's joints."""
    pose, odom = np.array(robot.pose), np.array(robot.odometry)
    correction = compose(pose, inverse(odom))
    base = [_planar(MAP, ODOM, correction), _planar(ODOM, BASE, odom)]
    return tf_message([*base, *model.moving(joint_values(robot))], robot.time)


def _planar(parent: str, child: str, pose: NDArray[np.float64]) -> Transform:
    x, y, heading = (float(value) for value in pose)
    return Transform(parent, child, (x, y, 0.0), turned(heading))


def tf_message(found: Iterable[Transform], time: float) -> Message:
    """tf2_msgs/TFMessage of any transforms."""
    at = stamp(time)
    return {
        "transforms": [
            {
                "header": {"stamp": at, "frame_id": item.parent},
                "child_frame_id": item.child,
                "transform": {"translation": vector(*item.translation), "rotation": quaternion(item.rotation)},
            }
            for item in found
        ]
    }


def laser_scan(scan: ScanMessage, rate: float) -> Message:
    """sensor_msgs/LaserScan of a lidar with this rate [Hz]; a beam without return is infinite (REP 117)."""
    count = len(scan.ranges)
    return {
        "header": header(scan.stamp, LIDAR),
        "angle_min": scan.angle_min,
        "angle_max": scan.angle_min + scan.angle_step * max(0, count - 1),
        "angle_increment": scan.angle_step,
        "time_increment": 0.0,  # a sweep is one instant
        "scan_time": 1.0 / rate,
        "range_min": scan.range_min,
        "range_max": scan.range_max,
        "ranges": np.array([math.inf if value is None else value for value in scan.ranges], dtype=np.float32),
        "intensities": [],
    }


def occupancy_grid(info: GridInfo, cells: bytes) -> Message:
    """nav_msgs/OccupancyGrid: 100 occupied, 0 to 99 the nearness of something; the twin has no unknown cells."""
    values = np.frombuffer(cells, dtype=np.uint8)
    if values.size != info.width * info.height:
        raise ValueError(f"a grid of {info.width} x {info.height} cells came with {values.size} bytes")
    return {
        "header": header(info.stamp, MAP),
        "info": {
            "map_load_time": stamp(info.stamp),
            "resolution": info.resolution,
            "width": info.width,
            "height": info.height,
            "origin": planar_pose(info.origin[0], info.origin[1], 0.0),
        },
        "data": _CELLS[values],
    }


_CELLS = np.array([100 if v == _OCCUPIED else 99 * v // _FREE_STEPS for v in range(256)], dtype=np.int8)


def plan_path(points: Sequence[Sequence[float]], time: float) -> Message:
    """nav_msgs/Path of a polyline on the map; each pose looks along its line."""
    poses = []
    yaw = 0.0
    for i, point in enumerate(points):
        if i + 1 < len(points):
            yaw = math.atan2(points[i + 1][1] - point[1], points[i + 1][0] - point[0])
        poses.append({"header": header(time, MAP), "pose": planar_pose(point[0], point[1], yaw)})
    return {"header": header(time, MAP), "poses": poses}


def local_path(plan: PlanMessage, time: float) -> Message:
    """nav_msgs/Path of the local plan; each pose has the time at which the base will be there."""
    poses = [
        {"header": header(time + after, MAP), "pose": planar_pose(pose[0], pose[1], pose[2])}
        for pose, after in zip(plan.local_poses, plan.local_times, strict=True)
    ]
    return {"header": header(time, MAP), "poses": poses}
