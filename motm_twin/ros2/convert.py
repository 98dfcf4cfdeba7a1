"""Converts the twin's messages to ROS 2 messages. Stamps are the twin's time [s], frames are those of `robot_model`.

Markers show true places, and the candidate base poses, in the colours of the page.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import shapely
from numpy.typing import NDArray

from motm_twin.bus import messages
from motm_twin.model.geometry import compose, inverse
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene, Solid
from motm_twin.model.scene_shapes import moved_scene, pieces
from motm_twin.planning.types import Mode
from motm_twin.ros2.cdr import Message, blank
from motm_twin.ros2.robot_model import BASE, FINGERS, LIDAR, Quaternion, RobotModel, Transform, turned
from motm_twin.ui import colours

MAP, ODOM = "map", "odom"
_PLANAR = 1e-9  # variance of motions that a wheeled base lacks: height, roll, pitch
_POSE_SD = (0.02, 0.02, 0.01)  # [m, m, rad] of odometry over a scene: a scale error of 0.3 % over some metres
_TWIST_SD = (0.002, 0.002)  # [m/s, rad/s] of the measured twist
_OCCUPIED, _FREE_STEPS = 255, 254  # value of an occupied cell of the twin's grid, and largest value of the others


def stamp(seconds: float) -> Message:
    """builtin_interfaces/Time of a time [s]."""
    nanoseconds = max(0, round(seconds * 1e9))
    return {"sec": nanoseconds // 10**9, "nanosec": nanoseconds % 10**9}


def header(time: float, frame: str) -> Message:
    """std_msgs/Header."""
    return {"stamp": stamp(time), "frame_id": frame}


def vector(x: float, y: float, z: float = 0.0) -> Message:
    """geometry_msgs/Point or Vector3."""
    return {"x": x, "y": y, "z": z}


def quaternion(values: Quaternion) -> Message:
    """geometry_msgs/Quaternion."""
    x, y, z, w = values
    return {"x": x, "y": y, "z": z, "w": w}


def planar_pose(x: float, y: float, yaw: float, z: float = 0.0) -> Message:
    """geometry_msgs/Pose that is upright."""
    return {"position": vector(x, y, z), "orientation": quaternion(turned(yaw))}


def yaw_of(orientation: Message) -> float:
    """Yaw [rad] of an orientation; raises ValueError for a quaternion far from length 1."""
    x, y, z, w = (orientation[name] for name in "xyzw")
    if not 0.5 < math.hypot(x, y, z, w) < 2.0:  # refuses nan, too
        raise ValueError(f"({x:g}, {y:g}, {z:g}, {w:g}) is no orientation: a quaternion has the length 1")
    return math.atan2(2.0 * (w * z + x * y), w * w + x * x - y * y - z * z)


def clock(time: float) -> Message:
    """rosgraph_msgs/Clock."""
    return {"clock": stamp(time)}


def joint_values(robot: messages.RobotStateMessage) -> dict[str, float]:
    """Positions [rad, m] by joint, fingers included."""
    half = 0.5 * robot.gripper_width
    return {**dict(zip(robot.joint_names, robot.q, strict=True)), **dict.fromkeys(FINGERS, half)}


def joint_states(robot: messages.RobotStateMessage, model: RobotModel) -> Message:
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


def odometry(robot: messages.RobotStateMessage) -> Message:
    """nav_msgs/Odometry: dead reckoning from the wheels."""
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


def transforms(robot: messages.RobotStateMessage, model: RobotModel) -> Message:
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


def laser_scan(scan: messages.ScanMessage, rate: float) -> Message:
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


def occupancy_grid(info: messages.GridInfo, cells: bytes) -> Message:
    """nav_msgs/OccupancyGrid: 100 occupied, 0 to 99 nearness to obstacles; the twin has no unknown cells."""
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
    """nav_msgs/Path of a polyline on the map; each pose points along its line."""
    poses = []
    yaw = 0.0
    for i, point in enumerate(points):
        if i + 1 < len(points):
            yaw = math.atan2(points[i + 1][1] - point[1], points[i + 1][0] - point[0])
        poses.append({"header": header(time, MAP), "pose": planar_pose(point[0], point[1], yaw)})
    return {"header": header(time, MAP), "poses": poses}


def local_path(plan: messages.PlanMessage, time: float) -> Message:
    """nav_msgs/Path of the local plan; each pose has the time at which the base will be there."""
    poses = [
        {"header": header(time + after, MAP), "pose": planar_pose(pose[0], pose[1], pose[2])}
        for pose, after in zip(plan.local_poses, plan.local_times, strict=True)
    ]
    return {"header": header(time, MAP), "poses": poses}


ARROW, CUBE, CYLINDER, LINE_LIST, SPHERE_LIST, TRIANGLE_LIST = 0, 1, 3, 5, 7, 11
ADD, DELETE = 0, 2
_ROUND = ("temi", "person", "cylinder")
_BODY_COLOURS: dict[str, colours.Rgb] = {"temi": (236, 236, 240), "person": (70, 110, 190)}
_OBSTACLE: colours.Rgb = (222, 120, 60)
_FURNITURE: colours.Rgb = (196, 164, 124)
_UNMAPPED: colours.Rgb = (160, 110, 170)  # furniture that is not in the robot's map
_BIN: colours.Rgb = (110, 120, 130)
_DOT, _LINE, _NOSE = 0.045, 0.012, 0.10  # [m] diameter of a candidate, line width, length of a candidate's heading
_LIFT = 0.02  # [m] over the floor

Rgba = dict[str, float]


class Markers:
    """Keeps marker numbers for the whole scene, and deletes markers of removed things."""

    def __init__(self) -> None:
        self._scene: Scene | None = None
        self._colours: dict[str, colours.Rgb] = {}
        self._numbers: dict[tuple[str, str], int] = {}
        self._shown: set[tuple[str, int]] = set()
        self._standing: tuple[Any, list[Message]] = (None, [])  # furniture is converted again only when it was moved

    def show(self, scene: Scene) -> None:
        """Switch to another scene."""
        self._scene, self._standing = scene, (None, [])
        self._colours = {item.name: colours.of_cube(item.colour) for item in scene.objects}

    def array(self, tick: messages.TickMessage) -> Message:
        """All markers at a tick, and deletions of those that are no longer there."""
        found = [*self._furniture(tick), *_placement(tick.placement)]
        grey = colours.NAMED["grey"]
        for body in tick.objects:
            found.append(self._body("objects", body, self._colours.get(body.name, grey)))
        for space, group in (("agents", tick.agents), ("obstacles", tick.obstacles)):
            found += [self._body(space, body, _BODY_COLOURS.get(body.kind, _OBSTACLE)) for body in group]
        shown = {(marker["ns"], marker["id"]) for marker in found}
        gone = [_marker(ns, number, CUBE, action=DELETE) for ns, number in sorted(self._shown - shown)]
        self._shown = shown
        head = header(tick.time, MAP)
        return {"markers": [{**marker, "header": head} for marker in (*gone, *found)]}

    def _number(self, space: str, name: str) -> int:
        return self._numbers.setdefault((space, name), len(self._numbers))

    def _body(self, space: str, body: messages.BodyMessage, colour: colours.Rgb) -> Message:
        x, y, z = body.position
        centre = z if space == "objects" else z + 0.5 * body.size[2]
        kind = CYLINDER if body.kind in _ROUND else CUBE
        return _solid(space, self._number(space, body.name), kind, (x, y, centre), body.yaw, body.size, _rgba(colour))

    def _furniture(self, tick: messages.TickMessage) -> list[Message]:
        """Furniture and bins where they stand now."""
        if self._scene is None:
            return []
        moved = {body.name: (body.position[0], body.position[1], body.yaw) for body in tick.furniture}
        state = (moved, tuple(tick.removed))
        if state != self._standing[0]:
            known = pieces(self._scene)
            scene = moved_scene(self._scene, moved, tuple(name for name in tick.removed if name in known))
            bins = [self._bin(box) for box in scene.bins]
            self._standing = (state, [*(self._piece(solid) for solid in scene.solids), *bins])
        return self._standing[1]

    def _piece(self, solid: Solid) -> Message:
        number, colour = self._number("furniture", solid.name), _rgba(_FURNITURE if solid.mapped else _UNMAPPED)
        height, z = solid.z_max - solid.z_min, 0.5 * (solid.z_min + solid.z_max)
        match solid.shape:
            case Box(centre=(x, y), size=size, yaw=yaw):
                return _solid("furniture", number, CUBE, (x, y, z), yaw, (*size, height), colour)
            case Cylinder(centre=(x, y), radius=radius):
                size = (2.0 * radius, 2.0 * radius, height)
                return _solid("furniture", number, CYLINDER, (x, y, z), 0.0, size, colour)
            case Prism() as prism:
                marker = _solid("furniture", number, TRIANGLE_LIST, (0.0, 0.0, 0.0), 0.0, (1.0, 1.0, 1.0), colour)
                return {**marker, "points": _prism_faces(prism, solid)}

    def _bin(self, box: Bin) -> Message:
        (x, y), height = box.centre, box.rim_z - box.floor_z
        place, size = (x, y, box.floor_z + 0.5 * height), (box.side, box.side, height)
        return _solid("bins", self._number("bins", box.name), CUBE, place, box.yaw, size, _rgba(_BIN, 0.45))


def _prism_faces(prism: Prism, solid: Solid) -> list[Message]:
    """Triangles of the sides and the top."""
    corners, low, high = prism.corners, solid.z_min, solid.z_max
    points = []
    for (ax, ay), (bx, by) in zip(corners, [*corners[1:], corners[0]], strict=True):
        points += [vector(ax, ay, low), vector(bx, by, low), vector(bx, by, high)]
        points += [vector(ax, ay, low), vector(bx, by, high), vector(ax, ay, high)]
    for triangle in shapely.constrained_delaunay_triangles(shapely.Polygon(corners)).geoms:
        points += [vector(x, y, high) for x, y in shapely.get_coordinates(triangle)[:3].tolist()]
    return points


def _placement(placement: messages.PlacementMessage) -> list[Message]:
    """Candidates coloured by cost (rejected ones grey), their headings, and the chosen goal."""
    if not placement.poses:
        return [] if placement.mode == Mode.NONE else _goal(placement)
    poses = np.array(placement.poses, dtype=float)
    shades = _cost_colours(placement.cost)
    dots = [vector(x, y, _LIFT) for x, y in poses[:, :2].tolist()]
    noses = poses[:, :2] + _NOSE * np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    ends = [vector(x, y, _LIFT) for x, y in noses.tolist()]
    spots = _marker("candidates", 0, SPHERE_LIST, scale=vector(_DOT, _DOT, _DOT))
    lines = _marker("candidates", 1, LINE_LIST, scale=vector(_LINE, 0.0, 0.0))
    return [
        {**spots, "points": dots, "colors": shades},
        {**lines, "points": _alternating(dots, ends), "colors": _alternating(shades, shades)},
        *_goal(placement),
    ]


def _goal(placement: messages.PlacementMessage) -> list[Message]:
    x, y, yaw = placement.goal
    if x is None or y is None:
        return []
    arrow = (0.35, 0.05, 0.05) if yaw is not None else (0.01, 0.12, 0.12)
    return [_solid("goal", 0, ARROW, (x, y, _LIFT), yaw or 0.0, arrow, _rgba(colours.TARGET))]


def _cost_colours(costs: Sequence[float | None]) -> list[Rgba]:
    """Cheap is bright, expensive is dark, as on the page; rejected is grey."""
    cost = np.array([np.nan if value is None else value for value in costs], dtype=float)
    known = cost[np.isfinite(cost)]
    span = max(float(np.ptp(known)), 1e-6) if known.size else 1.0
    relative = (cost - known.min(initial=np.inf)) / span if known.size else np.zeros(len(cost))
    shades = colours.scale(np.nan_to_num(relative)).tolist()
    pairs = zip(np.isfinite(cost), shades, strict=True)
    return [_rgba(tuple(shade)) if viable else _rgba(colours.REJECTED, 0.4) for viable, shade in pairs]


def _alternating(first: Sequence[Any], second: Sequence[Any]) -> list[Any]:
    return [item for pair in zip(first, second, strict=True) for item in pair]


def _rgba(colour: Iterable[int], alpha: float = 1.0) -> Rgba:
    r, g, b = (value / 255.0 for value in colour)
    return {"r": r, "g": g, "b": b, "a": alpha}


def _solid(
    space: str, number: int, kind: int, place: tuple[float, float, float], yaw: float, size: Sequence[float], rgba: Rgba
) -> Message:
    pose = planar_pose(place[0], place[1], yaw, place[2])
    return {**_marker(space, number, kind, scale=vector(*size)), "pose": pose, "color": rgba}


def _marker(space: str, number: int, kind: int, *, action: int = ADD, scale: Message | None = None) -> Message:
    about = {"ns": space, "id": number, "type": kind, "action": action, "scale": scale or vector(1.0, 1.0, 1.0)}
    return {**blank("visualization_msgs/msg/Marker"), "pose": planar_pose(0.0, 0.0, 0.0), **about}
