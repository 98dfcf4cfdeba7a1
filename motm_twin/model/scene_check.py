"""Checks of a resolved scene. Every refusal names the place in the file, what is wrong and what to do."""

import math
from collections.abc import Iterator

from shapely.geometry import Polygon, box
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.model import bounds
from motm_twin.model.scene import Bin, DriveTo, Pick, Place, Scene, SceneObject, Solid
from motm_twin.model.scene_error import near
from motm_twin.model.scene_shapes import outline, rectangle
from motm_twin.model.scene_space import check_agents, check_arm_start, check_reach, check_start
from motm_twin.model.scene_yaml import Node

TOUCH = 1e-3  # [m] bodies may overlap by this much: rounding of the numbers in a file
MAX_EXTENT = 60.0  # [m] side of the map
FINGER_ROOM = 0.01  # [m] the open gripper must be wider than the cube by this


def check_scene(scene: Scene, root: Node) -> None:
    """Raise SceneError for the first thing that cannot be right."""
    check_bounds(scene, root)
    check_robot(scene, root)
    check_faults(scene, root)
    for item in scene.bins:
        check_bin(scene, item, root.at("bins", item.name))
    for item in scene.objects:
        check_object(scene, item, object_node(root, item.name))
    check_pairs(scene, root)
    check_tasks(scene, root)
    check_start(scene, root)
    check_arm_start(scene, root)
    check_agents(scene, root)
    check_reach(scene, root, object_node)


def object_node(root: Node, name: str) -> Node:
    """Node that defines an object: its own entry, or the slot that holds it."""
    objects = root.value.get("objects")
    if objects is not None and name in objects.value:
        return objects.value[name]
    return root.at("slots", name.removeprefix("cube_"))


def check_robot(scene: Scene, root: Node) -> None:
    """The robot's own numbers agree with one another."""
    node, robot = root.at("robot"), scene.robot
    body = robot.footprint
    if abs(body.offset_x) >= body.length / 2.0:
        raise node.at("footprint", "offset_x").error("the base frame lies outside the footprint: make it smaller")
    x, y = robot.arm.mount_x, robot.arm.mount_y
    if robot.has_arm and (abs(x - body.offset_x) > body.length / 2.0 or abs(y) > body.width / 2.0):
        raise node.at("arm").error(
            f"the arm stands at ({x:g}, {y:g}) m, outside the footprint of {body.length:g} x {body.width:g} m: set "
            "arm.mount_x and arm.mount_y"
        )
    if robot.lidar.range_min >= robot.lidar.range_max:
        raise node.at("lidar").error("range_min must be below range_max")


def check_faults(scene: Scene, root: Node) -> None:
    """Timed faults have numbers that their kinds allow."""
    for index, one in enumerate(scene.faults.inject or ()):
        if problem := bounds.problem(one):
            raise root.at("faults", "inject", index).error(problem)


def check_bounds(scene: Scene, root: Node) -> None:
    """The map is not empty, not huge, and everything is in it."""
    node = root.at("bounds")
    x_min, y_min, x_max, y_max = scene.bounds
    if x_min >= x_max or y_min >= y_max:
        raise node.error("bounds are [x_min, y_min, x_max, y_max] with min below max")
    if max(x_max - x_min, y_max - y_min) > MAX_EXTENT:
        raise node.error(f"the map is {x_max - x_min:.0f} x {y_max - y_min:.0f} m: at most {MAX_EXTENT:.0f} m a side")
    area = box(*scene.bounds)
    points = [(item.name, item.position) for item in scene.objects] + [(item.name, item.centre) for item in scene.bins]
    points += [("drive_to", task.point) for task in scene.tasks if isinstance(task, DriveTo)]
    points += [(agent.name, point) for agent in scene.agents for point in (agent.start, *agent.waypoints)]
    contents = [(solid.name, outline(solid.shape)) for solid in scene.solids]
    contents += [("start", rectangle(scene.start, (0.1, 0.1)))]
    contents += [(name, rectangle((*point[:2], 0.0), (0.01, 0.01))) for name, point in points]
    for name, shape in contents:
        if not area.contains(shape):
            raise node.error(f"'{name}' is outside the bounds: make them larger, or leave them out")


def bin_outline(item: Bin) -> Polygon:
    """The outer square of a bin."""
    return rectangle((*item.centre, item.yaw), (item.side, item.side))


def cube_outline(item: SceneObject) -> Polygon:
    """The square under a cube."""
    return rectangle((item.position[0], item.position[1], item.yaw), (item.side, item.side))


def check_bin(scene: Scene, item: Bin, node: Node) -> None:
    """A bin is hollow, large enough for the cubes, and not sunk into furniture."""
    if item.floor_z >= item.rim_z:
        raise node.error(f"the rim (rim_z {item.rim_z:g}) must be above the floor (floor_z {item.floor_z:g})")
    inner = item.side - 2.0 * item.wall
    largest = max((cube.side for cube in scene.objects), default=0.0)
    if inner <= largest * math.sqrt(2.0):
        raise node.error(f"{inner:.3g} m between its walls is too narrow for a cube of {largest:g} m in any yaw")
    square = bin_outline(item).buffer(-TOUCH)
    for solid in _overlapping(scene, square, item.floor_z, item.rim_z):
        raise node.error(
            f"it is sunk into '{solid.name}' (up to {solid.z_max:g} m): raise floor_z and rim_z or move it"
        )


def _overlapping(scene: Scene, shape: BaseGeometry, low: float, high: float) -> Iterator[Solid]:
    """Furniture that overlaps a shape between two heights [m]."""
    for solid in scene.solids:
        if solid.z_max > low + TOUCH and solid.z_min < high - TOUCH and outline(solid.shape).intersects(shape):
            yield solid


def check_object(scene: Scene, item: SceneObject, node: Node) -> None:
    """A cube fits the gripper, rests wholly on a surface, and is inside nothing."""
    widest = scene.robot.gripper.max_width - FINGER_ROOM
    if item.side > widest:
        raise node.error(f"a cube of {item.side:g} m is too wide for the gripper: at most {widest:.3g} m")
    x, y, z = item.position
    square, bottom, top = cube_outline(item), z - item.side / 2.0, z + item.side / 2.0
    under = [outline(s.shape) for s in scene.solids if abs(s.z_max - bottom) <= TOUCH]
    surface = unary_union(under).buffer(TOUCH)
    if bottom > TOUCH and not surface.contains(square):
        what = "hangs over the edge of" if surface.intersects(square) else "is off"
        raise node.at("at").error(
            f"the cube at ({x:g}, {y:g}) {what} its surface (nothing else is {bottom:g} m high there): move it"
        )
    for solid in _overlapping(scene, square.buffer(-TOUCH), bottom, top):
        raise node.at("at").error(f"the cube is inside '{solid.name}': move one of them")


def check_pairs(scene: Scene, root: Node) -> None:
    """No two cubes or bins are in the same place, and no names are shared."""
    for index, item in enumerate(scene.objects):
        node, square = object_node(root, item.name), cube_outline(item).buffer(-TOUCH / 2.0)
        bottom, top = item.position[2] - item.side / 2.0, item.position[2] + item.side / 2.0
        for other in scene.objects[:index]:
            if other.name == item.name:
                raise node.error(f"two objects are called '{item.name}': rename one")
            level = abs(other.position[2] - item.position[2]) < (item.side + other.side) / 2.0 - TOUCH
            if level and cube_outline(other).intersects(square):
                raise node.at("at").error(f"it overlaps the object '{other.name}': move one of them")
        for other in scene.bins:
            if bottom < other.rim_z and top > other.floor_z and bin_outline(other).intersects(square):
                raise node.at("at").error(f"it is in the bin '{other.name}' or its wall: move one of them")
    for index, item in enumerate(scene.bins):
        for other in scene.bins[:index]:
            level = item.floor_z < other.rim_z and other.floor_z < item.rim_z
            if level and bin_outline(item).buffer(-TOUCH).intersects(bin_outline(other)):
                raise root.at("bins", item.name, "at").error(f"it overlaps the bin '{other.name}': move one of them")


def check_tasks(scene: Scene, root: Node) -> None:
    """Picks and places alternate and name things that are there."""
    objects, bins = [item.name for item in scene.objects], [item.name for item in scene.bins]
    deliver = root.value.get("deliver")
    if deliver is not None:
        for index, name in enumerate(deliver.at("to").plain()):
            if name not in bins:
                raise deliver.at("to", index).error(f"there is no bin '{name}'; {near(name, bins)}")
    held, picked = "", set()
    for index, task in enumerate(scene.tasks):
        node = root.at("tasks", index)
        if not scene.robot.has_arm and not isinstance(task, DriveTo):
            raise (node if deliver is None else deliver).error(
                "the robot has no arm (arm: none): it can only drive_to; leave the others out, or give it an arm"
            )
        if isinstance(task, Pick):
            if task.object not in objects:
                raise node.at("pick").error(f"there is no object '{task.object}'; {near(task.object, objects)}")
            if task.object in picked:
                raise node.at("pick").error(f"'{task.object}' is already picked by an earlier task: remove this one")
            if held:
                raise node.at("pick").error(f"'{held}' is still held: put a place task before this one")
            held = task.object
            picked.add(held)
        elif isinstance(task, Place):
            if task.bin not in bins:
                raise node.at("place").error(f"there is no bin '{task.bin}'; {near(task.bin, bins)}")
            if not held:
                raise node.at("place").error("nothing is held here: put a pick task before this one")
            held = ""
