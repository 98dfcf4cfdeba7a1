"""Checks of a resolved scene. Every refusal names the place in the file, what is wrong and what to do.

The start is free, agents do not drive through furniture, and every target can be reached. Reach is a necessary
condition only: the base as its inscribed disc, the arm as a sphere round its shoulder. A scene refused here is
impossible; one that passes may still be hard, or impossible, too.
"""

import itertools
import math
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from shapely.geometry import LineString, Polygon, box
from shapely.geometry import Point as ShapelyPoint
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.model import bounds
from motm_twin.model.arm_kernels import ELBOW_OFFSET, HAND, LOWER, SHOULDER, TCP, TOOL, UPPER, WRIST, fk_arm
from motm_twin.model.geometry import from_frame
from motm_twin.model.names import hint
from motm_twin.model.plant import SLOW_AGE
from motm_twin.model.profile import READY
from motm_twin.model.scene import Agent, Bin, DriveTo, Pick, Place, Point, Scene, SceneObject, Solid
from motm_twin.model.scene_shapes import base_outline, bin_solid, outline, rectangle, surface
from motm_twin.model.scene_yaml import Node

TOUCH = 1e-3  # [m] bodies may overlap by this much: rounding of the numbers in a file
MAX_EXTENT = 60.0  # [m] side of the map
FINGER_ROOM = 0.01  # [m] the open gripper must be this much wider than the cube


def check_scene(scene: Scene, root: Node) -> None:
    """Raise SceneError for the first error found."""
    check_bounds(scene, root)
    check_robot(scene, root)
    check_faults(scene, root)
    for item in scene.bins:
        check_bin(scene, item, root.at("bins", item.name))
    for item in scene.objects:
        check_object(scene, item, root)
    check_pairs(scene, root)
    check_tasks(scene, root)
    check_start(scene, root)
    check_arm_start(scene, root)
    check_agents(scene, root)
    check_reach(scene, root)


def object_node(root: Node, name: str) -> Node:
    """Node that defines an object: its own entry, or the slot that holds it."""
    return root.at("objects", name) if _is_object(root, name) else root.at("slots", name.removeprefix("cube_"))


def _is_object(root: Node, name: str) -> bool:
    objects = root.value.get("objects")
    return objects is not None and name in objects.value


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
    if robot.lidar.rate * SLOW_AGE < 1.0:
        raise node.at("lidar").error(
            f"{robot.lidar.rate:g} sweeps a second are too few: the base slows down when the newest is more than "
            f"{SLOW_AGE:g} s old; set rate_hz to {math.ceil(10.0 / SLOW_AGE) / 10.0:g} or more"
        )


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


def _side_node(root: Node, name: str) -> Node:
    """Node that gives the side of a cube; the node of the gripper's width when the side is the default."""
    given = object_node(root, name) if _is_object(root, name) else root.at("deliver")
    return given.at("side") if "side" in given.value else root.at("robot", "gripper", "max_width")


def _surface(scene: Scene, node: Node) -> str:
    """Words for the surface that an object or slot names."""
    name = node.at("surface").value if node.value and "surface" in node.value else ""
    piece = surface(name, scene.solids)
    if piece is None:
        return "its surface"
    return f"its surface '{piece.name}'" + ("" if piece.name == name else f", the highest piece of '{name}'")


def check_object(scene: Scene, item: SceneObject, root: Node) -> None:
    """A cube fits the gripper, rests wholly on a surface, and is inside nothing."""
    widest = scene.robot.gripper.max_width - FINGER_ROOM
    if item.side > widest:
        raise _side_node(root, item.name).error(
            f"a cube of {item.side:g} m is too wide for the gripper: at most {widest:.3g} m"
        )
    check_rest(scene, item, object_node(root, item.name))


def check_rest(scene: Scene, item: SceneObject, node: Node) -> None:
    """A cube rests wholly on a surface, and is inside no furniture."""
    x, y, z = item.position
    square, bottom, top = cube_outline(item), z - item.side / 2.0, z + item.side / 2.0
    under = [outline(s.shape) for s in scene.solids if abs(s.z_max - bottom) <= TOUCH]
    ground = unary_union(under).buffer(TOUCH)
    if bottom > TOUCH and not ground.contains(square):
        what = "hangs over the edge of" if ground.intersects(square) else "is off"
        raise node.at("at").error(
            f"the cube at ({x:g}, {y:g}) {what} {_surface(scene, node)} (nothing else is {bottom:g} m high there): "
            "move it"
        )
    for solid in _overlapping(scene, square.buffer(-TOUCH), bottom, top):
        raise node.at("at").error(f"the cube is inside '{solid.name}': move one of them")


def check_pairs(scene: Scene, root: Node) -> None:
    """No two cubes or bins are in the same place, and no names are shared."""
    for index, item in enumerate(scene.objects):
        node, square = object_node(root, item.name), cube_outline(item).buffer(-TOUCH / 2.0)
        for other in scene.objects[:index]:
            if other.name == item.name:
                raise node.error(f"two objects are called '{item.name}': rename one")
            level = abs(other.position[2] - item.position[2]) < (item.side + other.side) / 2.0 - TOUCH
            if level and cube_outline(other).intersects(square):
                raise node.at("at").error(f"it overlaps the object '{other.name}': move one of them")
        check_out_of_bins(scene, item, node)
    for index, item in enumerate(scene.bins):
        for other in scene.bins[:index]:
            level = item.floor_z < other.rim_z and other.floor_z < item.rim_z
            if level and bin_outline(item).buffer(-TOUCH).intersects(bin_outline(other)):
                raise root.at("bins", item.name, "at").error(f"it overlaps the bin '{other.name}': move one of them")


def check_out_of_bins(scene: Scene, item: SceneObject, node: Node) -> None:
    """A cube is in no bin, nor in its wall."""
    square = cube_outline(item).buffer(-TOUCH / 2.0)
    bottom, top = item.position[2] - item.side / 2.0, item.position[2] + item.side / 2.0
    for other in scene.bins:
        if bottom < other.rim_z and top > other.floor_z and bin_outline(other).intersects(square):
            raise node.at("at").error(f"it is in the bin '{other.name}' or its wall: move one of them")


def check_tasks(scene: Scene, root: Node) -> None:
    """Picks and places alternate and name things that are there."""
    objects, bins = [item.name for item in scene.objects], [item.name for item in scene.bins]
    deliver = root.value.get("deliver")
    if deliver is not None:
        for index, name in enumerate(deliver.at("to").plain()):
            if name not in bins:
                raise deliver.at("to", index).error(f"there is no bin '{name}'; {hint(name, bins)}")
    held, picked = "", set()
    for index, task in enumerate(scene.tasks):
        node = root.at("tasks", index)
        if not scene.robot.has_arm and not isinstance(task, DriveTo):
            raise (node if deliver is None else deliver).error(
                "the robot has no arm (arm: none): it can only drive_to; leave the others out, or give it an arm"
            )
        if isinstance(task, Pick):
            if task.object not in objects:
                raise node.at("pick").error(f"there is no object '{task.object}'; {hint(task.object, objects)}")
            if task.object in picked:
                raise node.at("pick").error(f"'{task.object}' is already picked by an earlier task: remove this one")
            if held:
                raise node.at("pick").error(f"'{held}' is still held: put a place task before this one")
            held = task.object
            picked.add(held)
        elif isinstance(task, Place):
            if task.bin not in bins:
                raise node.at("place").error(f"there is no bin '{task.bin}'; {hint(task.bin, bins)}")
            if not held:
                raise node.at("place").error("nothing is held here: put a pick task before this one")
            held = ""


STRAIGHT = math.hypot(UPPER, ELBOW_OFFSET) + math.hypot(LOWER, ELBOW_OFFSET)  # [m] joint 6 from the shoulder, at most
PICK_TILT, PLACE_TILT = math.radians(16.0), math.radians(25.0)  # of the tool from straight down, at most
HOVER = 0.06  # [m] height above an object at which the hand waits for it
LINK_RADIUS = 0.05  # [m] of the arm's thinnest part: points nearer to its centre line are inside it
_ARM_LINE = [2, 4, 5, 7, HAND, TCP]  # frames along the arm, without its foot on the base


def blocking(scene: Scene, height: float) -> list[Solid]:
    """Furniture and bins that a body of a height [m] cannot pass under."""
    return [solid for solid in (*scene.solids, *map(bin_solid, scene.bins)) if solid.z_min < height]


def check_start(scene: Scene, root: Node) -> None:
    """The robot starts clear of furniture and agents."""
    body, node = base_outline(scene.start, scene.robot.footprint), root.at("start")
    for solid in blocking(scene, scene.robot.driving_top):
        if outline(solid.shape).intersects(body):
            raise node.error(f"the robot's footprint overlaps '{solid.name}' at the start: move the start pose")
    for agent in scene.agents:
        if ShapelyPoint(agent.start[:2]).distance(body) < agent.radius:
            raise root.at("agents", agent.name).error("it starts inside the robot: move it or the robot's start")


def check_arm_start(scene: Scene, root: Node) -> None:
    """The arm starts clear of furniture and agents, as spheres of the links' least radius along it."""
    points = _arm_points(scene)
    bodies = [(solid.name, outline(solid.shape), solid.z_min, solid.z_max) for solid in scene.solids]
    bodies += [
        (agent.name, ShapelyPoint(agent.start[:2]).buffer(agent.radius), 0.0, agent.height) for agent in scene.agents
    ]
    for name, shape, low, high in bodies:
        for x, y, z in points:
            beside, above = ShapelyPoint(x, y).distance(shape), max(low - z, z - high, 0.0)
            if math.hypot(beside, above) < LINK_RADIUS:
                raise root.at("start").error(
                    f"the arm is inside '{name}' at the start, at ({x:.2f}, {y:.2f}) m and {z:.2f} m high: move the "
                    f"start pose or '{name}'"
                )


def _arm_points(scene: Scene) -> list[tuple[float, float, float]]:
    """Points along the arm in its start pose, at most `LINK_RADIUS` apart, world [m]; none without an arm."""
    if not scene.robot.has_arm:
        return []
    arm, pose = scene.robot.arm, np.array(scene.start, dtype=float)
    joints = fk_arm(READY)[_ARM_LINE, :3, 3] + np.array([arm.mount_x, arm.mount_y, arm.mount_z])
    points = []
    for start, end in itertools.pairwise(from_frame(pose, joints).tolist()):
        count = max(1, math.ceil(math.dist(start, end) / LINK_RADIUS))
        points += [tuple(a + (b - a) * k / count for a, b in zip(start, end, strict=True)) for k in range(count)]
    return points


def check_agents(scene: Scene, root: Node) -> None:
    """Agents start apart, and their discs touch no furniture on their paths."""
    for index, agent in enumerate(scene.agents):
        node = root.at("agents", agent.name)
        for other in scene.agents[:index]:
            if math.dist(agent.start[:2], other.start[:2]) < agent.radius + other.radius:
                raise node.error(f"it starts inside the agent '{other.name}': move one of them")
        solids = [(solid.name, outline(solid.shape)) for solid in blocking(scene, agent.height)]
        for name, shape in solids:
            if ShapelyPoint(agent.start[:2]).distance(shape) < agent.radius - TOUCH:
                raise node.error(f"it starts inside '{name}' or closer than its radius of {agent.radius:g} m: move it")
        _check_way(agent, solids, node)


def _check_way(agent: Agent, solids: list[tuple[str, Any]], node: Node) -> None:
    points = (agent.start[:2], *agent.waypoints)
    legs = list(itertools.pairwise(points))
    if len(agent.waypoints) > 1:
        legs.append((agent.waypoints[-1], agent.waypoints[0]))
    for name, shape in solids:
        for b in agent.waypoints:
            if ShapelyPoint(b).distance(shape) < agent.radius - TOUCH:
                raise _waypoint(node, b).error(
                    f"the waypoint ({b[0]:g}, {b[1]:g}) is inside '{name}' or closer to it than the agent's radius "
                    f"of {agent.radius:g} m: move it, or change the lane's distance"
                )
    for name, shape in solids:
        for a, b in legs:
            if LineString([a, b]).distance(shape) < agent.radius - TOUCH:
                raise _waypoint(node, b).error(
                    f"the way from ({a[0]:g}, {a[1]:g}) to ({b[0]:g}, {b[1]:g}) leads through '{name}': add a waypoint"
                )


def _waypoint(node: Node, point: Point) -> Node:
    ways = node.at("waypoints")
    if isinstance(ways.value, list):
        for index, item in enumerate(ways.plain()):
            if math.dist(item, point) < TOUCH:
                return ways.at(index)
    return node.at("around")


def reach(scene: Scene, z: float, tilt: float) -> float:
    """Reach [m] of the gripper from the arm's axis at height z [m], tilted at most ``tilt`` [rad]; 0: unreachable."""
    farthest = 0.0
    for share in (0.0, 0.5, 1.0):
        c, s = math.cos(share * tilt), math.sin(share * tilt)
        rise = z - scene.robot.arm.mount_z + TOOL * c - WRIST * s - SHOULDER
        if abs(rise) < STRAIGHT:
            farthest = max(farthest, TOOL * s + WRIST * c + math.sqrt(STRAIGHT**2 - rise**2))
    return farthest


def highest(scene: Scene, tilt: float) -> float:
    """Largest height [m] that the gripper reaches at any distance."""
    return scene.robot.arm.mount_z + SHOULDER + STRAIGHT - TOOL * math.cos(tilt) + WRIST * math.sin(tilt)


class FreeSpace(NamedTuple):
    """Places of the base frame where the disc inscribed in the footprint is free."""

    everywhere: BaseGeometry
    reached: BaseGeometry  # part that is connected to the start
    radius: float  # [m] of the disc


def free_space(scene: Scene) -> FreeSpace:
    """Free places of the base in a scene."""
    body = scene.robot.footprint
    radius = min(body.width / 2.0, body.length / 2.0 - abs(body.offset_x))
    walls = unary_union([outline(solid.shape) for solid in blocking(scene, scene.robot.driving_top)])
    free = box(*scene.bounds).difference(walls.buffer(radius - TOUCH))
    start = ShapelyPoint(scene.start[:2])
    parts = getattr(free, "geoms", [free])
    return FreeSpace(free, min(parts, key=start.distance), radius)


def check_reach(scene: Scene, root: Node) -> None:
    """Objects, bins and places to drive to can be reached from the start."""
    free = free_space(scene)
    if scene.robot.has_arm:
        for i in scene.objects:
            node, top = object_node(root, i.name), highest(scene, PICK_TILT) - HOVER
            _check_target(
                scene, free, ("object", i.name, i.position), (reach(scene, i.position[2], PICK_TILT), top), node
            )
            check_cube_cover(scene, i, node)
        for i in scene.bins:
            node, far = root.at("bins", i.name), reach(scene, i.rim_z, PLACE_TILT) + 0.5 * i.side
            _check_target(scene, free, ("bin", i.name, (*i.centre, i.rim_z)), (far, highest(scene, PLACE_TILT)), node)
            _check_cover(scene, bin_outline(i), (i.rim_z, i.rim_z), PLACE_TILT, node)
    for index, task in enumerate(scene.tasks):
        if isinstance(task, DriveTo):
            _check_goal(scene, task, free, root.at("tasks", index, "drive_to"))


def _check_target(
    scene: Scene, free: FreeSpace, target: tuple[str, str, tuple[float, ...]], limits: tuple[float, float], node: Node
) -> None:
    """A target (kind, name, position) is not too high, and near enough to some place of the base.

    ``limits`` [m]: reach from the arm's axis, greatest height.
    """
    (kind, name, (x, y, z)), (radius, top), arm = target, limits, scene.robot.arm
    if z > top or radius == 0.0:
        raise node.error(
            f"the {kind} '{name}' is unreachable: {z:.2f} m high, the arm reaches up to {top:.2f} m with the gripper "
            "pointing down"
        )
    far = radius + math.hypot(arm.mount_x, arm.mount_y)
    if ShapelyPoint(x, y).distance(free.everywhere) <= far < ShapelyPoint(x, y).distance(free.reached):
        raise node.error(
            f"the {kind} '{name}' is unreachable: there is a free base position near it, but {_no_way(free)}"
        )
    if ShapelyPoint(x, y).distance(free.reached) > far:
        raise node.error(
            f"the {kind} '{name}' is unreachable: no free base position within {radius:.2f} m of the arm; "
            "move it towards an edge or make room"
        )


def _no_way(free: FreeSpace) -> str:
    return f"no way to it from the start: make a passage wider than {2.0 * free.radius:g} m"


def check_cube_cover(scene: Scene, item: SceneObject, node: Node) -> None:
    """No body is so low over a cube that the hand does not fit between."""
    bottom = item.position[2] - item.side / 2.0
    _check_cover(scene, cube_outline(item), (bottom, bottom + item.side), PICK_TILT, node)


def _check_cover(scene: Scene, target: Polygon, heights: tuple[float, float], tilt: float, node: Node) -> None:
    """No furniture or bin covers a whole target so low that the fingers at it, or the tool above them, would collide.

    ``heights`` [m]: lowest height of the fingertips, and height of the target's top.
    """
    low, top = heights
    for solid in (*scene.solids, *map(bin_solid, scene.bins)):
        over = solid.z_min - low
        if solid.z_min < top - TOUCH or over >= TOOL * math.cos(tilt):
            continue
        aside = scene.robot.gripper.max_width / 2.0 + over * math.tan(tilt)
        if outline(solid.shape).contains(target.buffer(aside)):
            raise node.at("at").error(
                f"the hand reaches it only from above, and '{solid.name}' is {solid.z_min - top:.2f} m above it: "
                "move one of them"
            )


def _check_goal(scene: Scene, task: DriveTo, free: FreeSpace, node: Node) -> None:
    goal = ShapelyPoint(task.point)
    if goal.distance(free.reached) > TOUCH:
        why = "it is in or too close to furniture: move it"
        if goal.distance(free.everywhere) <= TOUCH:
            why = f"there is room for the base, but {_no_way(free)}"
        raise node.error(f"the robot cannot get to ({task.point[0]:g}, {task.point[1]:g}): {why}")
    if task.heading is None:
        return
    body = base_outline((*task.point, task.heading), scene.robot.footprint)
    for solid in blocking(scene, scene.robot.driving_top):
        if outline(solid.shape).intersects(body):
            raise node.error(f"the robot's footprint overlaps '{solid.name}' there: move it or leave heading_deg out")
