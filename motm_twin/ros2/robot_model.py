"""The robot for ROS 2 programs: a URDF with frames of the sensors, and transforms from joint values."""

import math
import xml.etree.ElementTree as ET
from dataclasses import dataclass

from scipy.spatial.transform import Rotation

from motm_twin.model.assets import web_assets_dir
from motm_twin.model.profile import RobotProfile

BASE, HAND = "base_link", "panda_hand"
LIDAR, CAMERA = "lidar", "camera"
FINGERS = ("panda_finger_joint1", "panda_finger_joint2")
FILES, PRIMITIVES = "file", "primitives"
_PACKAGE = "package://web_assets/"
_COLOUR = "0.85 0.86 0.88 1"

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w
IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)


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
        """``meshes``: "file" (hulls in the shipped files), "primitives" (boxes), or where web_assets is served at."""
        robot = ET.parse(web_assets_dir() / "frankie.urdf").getroot()  # noqa: S314 - our own file
        _place_mount(robot, profile)
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


def product(a: Quaternion, b: Quaternion) -> Quaternion:
    """First ``b``, then ``a``."""
    (ax, ay, az, aw), (bx, by, bz, bw) = a, b
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def rotated(q: Quaternion, v: Vector) -> Vector:
    """A vector turned by a quaternion."""
    x, y, z, _ = product(product(q, (*v, 0.0)), (-q[0], -q[1], -q[2], q[3]))
    return (x, y, z)


def _moved(joint: _Joint, value: float) -> Transform:
    origin, (ax, ay, az) = joint.origin, joint.axis
    if joint.kind == "prismatic":
        dx, dy, dz = rotated(origin.rotation, (ax * value, ay * value, az * value))
        x, y, z = origin.translation
        return Transform(origin.parent, origin.child, (x + dx, y + dy, z + dz), origin.rotation)
    s = math.sin(0.5 * value)
    turn = (ax * s, ay * s, az * s, math.cos(0.5 * value))
    return Transform(origin.parent, origin.child, origin.translation, product(origin.rotation, turn))


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


def _place_mount(robot: ET.Element, profile: RobotProfile) -> None:
    origin = robot.find("joint[@name='arm_mount']/origin")
    if origin is None:
        raise ValueError("frankie.urdf has no joint arm_mount with an origin: restore the file")
    arm = profile.arm
    origin.set("xyz", f"{arm.mount_x!r} {arm.mount_y!r} {arm.mount_z!r}")
    body, height = profile.footprint, profile.footprint.height
    for collision in robot.findall("link[@name='base_link']/collision"):
        collision.clear()
        _add_box(collision, (body.offset_x, 0.0, 0.5 * height), (body.length, body.width, height))


def _remove_arm(robot: ET.Element) -> None:
    """Leave the base and its lidar."""
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
    """Draw the hulls and boxes of the collision geometry: viewers disagree on which way up a GLB file is.

    The hulls are files with an address that a viewer can open, or boxes in their place.
    """
    root = web_assets_dir().resolve().as_uri() if meshes == FILES else meshes.rstrip("/")
    for link in robot.findall("link"):
        for visual in link.findall("visual"):
            link.remove(visual)
        for collision in link.findall("collision"):
            mesh = collision.find("geometry/mesh")
            if mesh is not None and meshes == PRIMITIVES:
                from motm_twin.model.assets import collision_hull  # slow to import, and large

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
