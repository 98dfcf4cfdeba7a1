"""Checks of free space: the start is free, agents do not drive through furniture, and every target can be reached.

Reach is a necessary condition only: the base as its inscribed disc, the arm as a sphere round its shoulder. A scene
refused here is impossible; one that passes may still be hard.
"""

import itertools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
from shapely.geometry import LineString, box
from shapely.geometry import Point as ShapelyPoint
from shapely.ops import unary_union

from motm_twin.model.arm_kernels import ELBOW_OFFSET, HAND, LOWER, SHOULDER, TCP, TOOL, UPPER, WRIST, fk_arm
from motm_twin.model.geometry import from_frame
from motm_twin.model.joint_limits import READY
from motm_twin.model.scene import Agent, DriveTo, Point, Scene, Solid
from motm_twin.model.scene_shapes import base_outline, bin_solid, outline
from motm_twin.model.scene_yaml import Node

TOUCH = 1e-3  # [m]
STRAIGHT = math.hypot(UPPER, ELBOW_OFFSET) + math.hypot(LOWER, ELBOW_OFFSET)  # [m] joint 6 from the shoulder, at most
PICK_TILT, PLACE_TILT = math.radians(16.0), math.radians(25.0)  # of the tool from straight down, at most
HOVER = 0.06  # [m] above an object, where the hand waits for it
LINK_RADIUS = 0.05  # [m] of the arm's thinnest part: what is nearer to its middle line is inside it
_ARM_LINE = [2, 4, 5, 7, HAND, TCP]  # frames along the arm above its foot, which stands on the base


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
    """Agents start apart and their ways, a disc wide, are free of furniture."""
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
    """Reach [m] of the gripper from the arm's axis at a height z [m], tilted outwards by no more; 0: out of reach."""
    farthest = 0.0
    for share in (0.0, 0.5, 1.0):
        c, s = math.cos(share * tilt), math.sin(share * tilt)
        rise = z - scene.robot.arm.mount_z + TOOL * c - WRIST * s - SHOULDER
        if abs(rise) < STRAIGHT:
            farthest = max(farthest, TOOL * s + WRIST * c + math.sqrt(STRAIGHT**2 - rise**2))
    return farthest


def highest(scene: Scene, tilt: float) -> float:
    """Height [m] up to which the gripper reaches at all."""
    return scene.robot.arm.mount_z + SHOULDER + STRAIGHT - TOOL * math.cos(tilt) + WRIST * math.sin(tilt)


def free_space(scene: Scene) -> Any:
    """Places that the base frame can reach from the start, for the disc inscribed in the footprint."""
    body = scene.robot.footprint
    radius = min(body.width / 2.0, body.length / 2.0 - abs(body.offset_x))
    walls = unary_union([outline(solid.shape) for solid in blocking(scene, scene.robot.driving_top)])
    free = box(*scene.bounds).difference(walls.buffer(radius - TOUCH))
    start = ShapelyPoint(scene.start[:2])
    parts = getattr(free, "geoms", [free])
    return min(parts, key=start.distance)


def check_reach(scene: Scene, root: Node, object_node: Callable[[Node, str], Node]) -> None:
    """Objects, bins and places to drive to can be reached from the start."""
    free = free_space(scene)
    if scene.robot.has_arm:
        for i in scene.objects:
            node, top = object_node(root, i.name), highest(scene, PICK_TILT) - HOVER
            _check_target(
                scene, free, ("object", i.name, i.position), (reach(scene, i.position[2], PICK_TILT), top), node
            )
        for i in scene.bins:
            node, far = root.at("bins", i.name), reach(scene, i.rim_z, PLACE_TILT) + 0.5 * i.side
            _check_target(scene, free, ("bin", i.name, (*i.centre, i.rim_z)), (far, highest(scene, PLACE_TILT)), node)
    for index, task in enumerate(scene.tasks):
        if isinstance(task, DriveTo):
            _check_goal(scene, task, free, root.at("tasks", index, "drive_to"))


def _check_target(
    scene: Scene, free: Any, target: tuple[str, str, tuple[float, ...]], limits: tuple[float, float], node: Node
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
    if ShapelyPoint(x, y).distance(free) > radius + math.hypot(arm.mount_x, arm.mount_y):
        raise node.error(
            f"the {kind} '{name}' is unreachable: no free base position within {radius:.2f} m of the arm; "
            "move it towards an edge or make room"
        )


def _check_goal(scene: Scene, task: DriveTo, free: Any, node: Node) -> None:
    if ShapelyPoint(task.point).distance(free) > TOUCH:
        raise node.error(
            f"the robot cannot get to ({task.point[0]:g}, {task.point[1]:g}): it is in or too close to furniture, "
            "or shut off from the start"
        )
    if task.heading is None:
        return
    body = base_outline((*task.point, task.heading), scene.robot.footprint)
    for solid in blocking(scene, scene.robot.driving_top):
        if outline(solid.shape).intersects(body):
            raise node.error(f"the robot's footprint overlaps '{solid.name}' there: move it or leave heading_deg out")
