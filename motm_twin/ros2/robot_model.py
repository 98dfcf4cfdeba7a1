"""The robot for ROS 2 programs: a URDF with frames of the sensors, and transforms from joint values."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass, replace

from scipy.spatial.transform import Rotation

from motm_twin.model.assets import collision_hull, robot_urdf, web_assets_dir
from motm_twin.model.profile import RobotProfile

BASE, HAND = "base_link", "panda_hand"
LIDAR, CAMERA = "lidar", "camera"
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
FILES, PRIMITIVES = "file", "primitives"
_PACKAGE = "package://web_assets/"
_COLOUR = "0.85 0.86 0.88 1"

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w


@dataclass(frozen=True)
class Transform:
    """Pose of a child frame in its parent [m]."""

    parent: str
    child: str
    translation: Vector
    rotation: Quaternion


@dataclass(frozen=True)
class _Joint:
    name: str
    kind: str  # fixed | revolute | prismatic
    axis: Vector
    origin: Transform


class RobotModel:
    """URDF and transforms of one robot profile."""

    def __init__(self, profile: RobotProfile, meshes: str = FILES) -> None:
        """``meshes``: "file" (hulls in the shipped files), "primitives" (boxes), or address of web_assets."""
        robot = robot_urdf(profile)
        _add_frame(robot, LIDAR, BASE, (profile.lidar.x, profile.lidar.y, profile.lidar.z))
        if profile.has_arm:
            _add_frame(robot, CAMERA, HAND, (0.0, 0.0, 0.0))
        else:
            _remove_arm(robot)
        _set_geometry(robot, meshes)
        self.urdf = ET.tostring(robot, encoding="unicode")
        self._joints = [_joint(element) for element in robot.findall("joint")]

    @property
    def moving_joints(self) -> tuple[str, ...]:
        """Names of the joints that move; none for a robot without an arm."""
        return tuple(joint.name for joint in self._joints if joint.kind != "fixed")

    def static(self) -> list[Transform]:
        """The transforms that never change."""
        return [joint.origin for joint in self._joints if joint.kind == "fixed"]

    def moving(self, values: dict[str, float]) -> list[Transform]:
        """The transforms of all other joints at their ``values`` [rad, m] by name of the joint."""
        return [_moved(joint, values[joint.name]) for joint in self._joints if joint.kind != "fixed"]


def turned(yaw: float) -> Quaternion:
    """The quaternion of a turn about z [rad]."""
    return (0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw))


def _moved(joint: _Joint, value: float) -> Transform:
    origin, way = joint.origin, tuple(value * part for part in joint.axis)
    turn = Rotation.from_quat(origin.rotation)
    if joint.kind == "prismatic":
        x, y, z = (turn.apply(way) + origin.translation).tolist()
        return replace(origin, translation=(x, y, z))
    x, y, z, w = (turn * Rotation.from_rotvec(way)).as_quat().tolist()
    return replace(origin, rotation=(x, y, z, w))


def _joint(element: ET.Element) -> _Joint:
    origin, axis = element.find("origin"), element.find("axis")
    parent, child = element.find("parent"), element.find("child")
    if parent is None or child is None:
        raise ValueError(f"joint {element.get('name')} of frankie.urdf has no parent or no child: restore the file")
    xyz, rpy = ((0.0, 0.0, 0.0),) * 2 if origin is None else (_numbers(origin, "xyz"), _numbers(origin, "rpy"))
    rx, ry, rz, rw = Rotation.from_euler("xyz", rpy).as_quat().tolist()  # fixed axes: roll, then pitch, then yaw
    return _Joint(
        name=element.get("name", ""),
        kind=element.get("type", ""),
        axis=(0.0, 0.0, 1.0) if axis is None else _numbers(axis, "xyz"),
        origin=Transform(parent.get("link", ""), child.get("link", ""), xyz, (rx, ry, rz, rw)),
    )


def _numbers(element: ET.Element, name: str) -> Vector:
    x, y, z = (float(text) for text in element.get(name, "0 0 0").split())
    return (x, y, z)


def _remove_arm(robot: ET.Element) -> None:
    """Remove everything but the base and its lidar."""
    for link in [link for link in robot.findall("link") if link.get("name") not in (BASE, LIDAR)]:
        robot.remove(link)
    for joint in [joint for joint in robot.findall("joint") if joint.get("name") != f"{LIDAR}_joint"]:
        robot.remove(joint)


def _add_frame(robot: ET.Element, name: str, parent: str, place: Vector) -> None:
    ET.SubElement(robot, "link", name=name)
    joint = ET.SubElement(robot, "joint", name=f"{name}_joint", type="fixed")
    ET.SubElement(joint, "origin", xyz=" ".join(repr(value) for value in place))
    ET.SubElement(joint, "parent", link=parent)
    ET.SubElement(joint, "child", link=name)


def _set_geometry(robot: ET.Element, meshes: str) -> None:
    """Show the hulls and boxes of the collision geometry: viewers disagree on which axis of a GLB file is up.

    The hulls are files at an address that a viewer can open, or are replaced by boxes.
    """
    root = web_assets_dir().resolve().as_uri() if meshes == FILES else meshes.rstrip("/")
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is not None and meshes == PRIMITIVES:
                vertices = collision_hull(link.get("name", ""))[0]
                low, high = vertices.min(axis=0), vertices.max(axis=0)
                collision.clear()
                _add_box(collision, _triple(0.5 * (low + high)), _triple(high - low))
            elif mesh is not None:
                mesh.set("filename", f"{root}/{mesh.get('filename', '').removeprefix(_PACKAGE)}")
            visual = ET.SubElement(link, "visual")
            visual.extend(list(collision))
            material = ET.SubElement(visual, "material", name="light")
            ET.SubElement(material, "color", rgba=_COLOUR)


def _triple(values: object) -> Vector:
    x, y, z = (round(float(value), 4) for value in values)  # type: ignore[attr-defined]
    return (x, y, z)


def _add_box(parent: ET.Element, centre: Vector, size: Vector) -> None:
    ET.SubElement(parent, "origin", xyz=" ".join(repr(value) for value in centre))
    geometry = ET.SubElement(parent, "geometry")
    ET.SubElement(geometry, "box", size=" ".join(repr(value) for value in size))
