"""Targets of the base and goals of the hand, from tasks and beliefs, each in its own frame."""

import math
from collections.abc import Collection, Sequence
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray

from motm_twin.control.arm.geometry import reach_radius
from motm_twin.control.arm.grasp_room import ASIDE, over_middle
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.types import ArmGoal
from motm_twin.control.task_list import name_of
from motm_twin.control.tick import ObjectBelief
from motm_twin.model.exact import hypot
from motm_twin.model.geometry import Array, compose, from_frame, inverse, to_frame, wrap_angle
from motm_twin.model.known import KnownWorld, known_solids
from motm_twin.model.plant import Observation
from motm_twin.model.scene import Bin, DriveTo, Pick, Solid, Task
from motm_twin.perception.footprints import distance_to_shape, outline
from motm_twin.perception.objects import ObjectTracker
from motm_twin.planning.parameters import ReachParameters
from motm_twin.planning.types import Target

BESIDE = 0.25  # [m] objects this near may be in the way of a hand that grasps
OVER_TARGET = 0.13  # [m] furniture higher than this above a target is a wall: the hand may not get over it
TALL_TARGET = 0.35  # [m] tall walls, which the arm never reaches over, are higher than this above a target
TALL_MOUNT = 0.55  # [m] and higher than this above the arm's mount: the shoulder, at 0.33, reaches over lower ones
STRETCHED = 0.02  # [m] that the hand reaches further in the grasp itself than where it hovers
LET_GO_NEARER = 0.06  # [m] nearer than over a bin's centre, where the hand lets go if the bin is wide enough
NEAR = 1.5  # [m] the mount of an arm is never further from its target
TABLE = 0.3  # [m] lower furniture carries no objects
_NO_EDGES = np.zeros((0, 4))


class Furniture:
    """Outlines and heights of solids, each shape (n,) or one per solid."""

    def __init__(self, solids: Sequence[Solid]) -> None:
        self.shapes = [solid.shape for solid in solids]
        self.bottoms, self.tops = np.array([(one.z_min, one.z_max) for one in solids], dtype=float).reshape(-1, 2).T
        outlines = [shapely.Polygon(outline(shape)) for shape in self.shapes]
        self._bounds = shapely.bounds(outlines).reshape(-1, 4)
        self.edges, self.wide = (
            [_edges(one.buffer(by, join_style="mitre")) for one in outlines] for by in (0.0, ASIDE)
        )

    def near(self, position: Array, within: float, which: NDArray[np.bool_]) -> list[int]:
        """Indices of solids in the mask ``which`` (n,) whose bounding box is within a distance [m] of a point (2,)."""
        low, high = self._bounds[:, :2] - within, self._bounds[:, 2:] + within
        return np.flatnonzero(which & (low < position).all(axis=1) & (position < high).all(axis=1)).tolist()


class Walls(NamedTuple):
    """Obstacles to a hand on its way to a target: edges x, y, x, y [m], shape (k, 4).

    Low walls, which the hand reaches over where there is no other way, are wider by `ASIDE`, for the hand.
    """

    edges: Array
    tall: Array  # edges of walls that the arm never reaches over
    reach_over: float  # [m] reach of a hand that passes over low walls beside the target: it stays high until past them


def _edges(polygon: shapely.Polygon) -> Array:
    corners = shapely.get_coordinates(polygon.exterior)
    return np.hstack([corners[:-1], corners[1:]])


def world_in_odometry(observation: Observation) -> Array:
    """Planar pose of the world frame in the odometry frame, shape (3,)."""
    return compose(observation.odometry, inverse(observation.pose))


class Targets:
    """Looks up the targets of tasks."""

    def __init__(self, known: KnownWorld, tracker: ObjectTracker, reach: ReachParameters, arm: ArmParameters) -> None:
        self.known, self._arm = known, arm
        self.tracker, self._reach = tracker, reach
        self.objects = {item.name: item for item in known.objects}
        self.bins = {item.name: item for item in known.bins}
        self._tall = known.robot.arm.mount_z + TALL_MOUNT
        self._furniture = Furniture(known_solids(known))

    def base_target(self, task: Task | None, observation: Observation, dwell: float | None) -> Target | None:
        """A task as a target of the base, in the world frame; dwell [s] as the arm reports it, or the usual one."""
        if task is None:
            return None
        if isinstance(task, DriveTo):
            return Target(
                kind="drive",
                name=name_of(task),
                position=np.array(task.point),
                heading=task.heading,
                tolerance=task.tolerance,
            )
        if isinstance(task, Pick):
            kind, name, top = "pick", task.object, float(self.objects[task.object].position[2])
            position, reach = self.tracker.world_position(name, observation)[:2], self._reach_of_pick(top)
        else:
            kind, name, top = "place", task.bin, self.bins[task.bin].rim_z
            position, reach = np.array(self.bins[name].centre), self._reach_of_place(self.bins[name])
        walls = self._walls(position, top)
        return Target(
            kind=kind,
            name=name,
            position=position,
            walls=walls.edges,
            tall=walls.tall,
            dwell=self._reach.dwell(kind) if dwell is None else dwell,
            reach=reach,
            reach_over=walls.reach_over if kind == "pick" else math.inf,  # over a bin the hand is high anyway
        )

    def _reach_of_pick(self, middle: float) -> float:
        """Reach [m] of the hand, tilted outwards, to an object with its middle at this height [m]."""
        p = self._arm
        return reach_radius(middle - self.known.robot.arm.mount_z, p.pick_tilt, p.stretch) + STRETCHED

    def _reach_of_place(self, place: Bin) -> float:
        """Reach [m] of a hand, tilted outwards, to the middle of a bin, even while it holds the widest object."""
        p, widest = self._arm, max((item.side for item in self.known.objects), default=0.0)
        half = 0.5 * place.side - place.wall - 0.5 * widest - p.release_margin
        over = reach_radius(place.rim_z + p.release_height - self.known.robot.arm.mount_z, p.place_tilt, p.stretch)
        return min(over, p.place_reach) + min(LET_GO_NEARER, max(0.0, half))

    def _walls(self, position: Array, height: float) -> Walls:
        """Walls near a target: furniture that is higher and may be between it and the arm's mount."""
        furniture, never = self._furniture, max(height + TALL_TARGET, self._tall)
        high = (furniture.tops > height + OVER_TARGET) & (furniture.bottoms < never)  # the arm passes below the others
        tall, low, over = [_NO_EDGES], [_NO_EDGES], math.inf
        for k in furniture.near(position, NEAR, high):
            if furniture.tops[k] > never:
                tall.append(furniture.edges[k])
                continue
            away = float(distance_to_shape(furniture.shapes[k], position))
            low.append((furniture.wide if away > ASIDE else furniture.edges)[k])
            if 0.0 < away < BESIDE:
                hand = furniture.tops[k] + self._arm.transit_clearance - self.known.robot.arm.mount_z
                over = min(over, reach_radius(hand, self._arm.pick_tilt, self._arm.stretch) + max(0.0, away - ASIDE))
        return Walls(np.concatenate(tall + low), np.concatenate(tall), over)

    def arm_goal(self, task: Task | None, held: str, observation: Observation, T_odom_world: Array) -> ArmGoal:
        """Goal of the hand for a task, in the odometry frame."""
        side = self.objects[held].side if held else 0.0
        if isinstance(task, Pick):
            position, yaw, sd, last_seen = self.tracker.belief(task.object, observation)
            side = self.objects[task.object].side
            names, beside = self.tracker.beside(task.object, BESIDE, observation)
            near = [
                (*at, turn, self.objects[name].side, seen)
                for name, (*at, turn, seen) in zip(names, beside, strict=True)
            ]
            return ArmGoal(
                kind="pick",
                name=task.object,
                position=position + self._over_middle(side),
                yaw=yaw,
                side=side,
                position_sd=sd,
                last_seen=last_seen,
                neighbours=np.array(near).reshape(-1, 6),
                neighbour_names=names,
                others=self._others(observation, {task.object, held}),
            )
        if task is None or isinstance(task, DriveTo):
            return ArmGoal(
                kind="none", name="", position=np.zeros(3), yaw=0.0, side=side, position_sd=0.0, last_seen=None
            )
        place = self.bins[task.bin]
        names, inside = self._inside(place, held, observation, T_odom_world)
        top = max([place.rim_z, *(z + 0.5 * side for _, _, z, _, side, seen in inside if seen)])
        position = from_frame(T_odom_world, np.array([*place.centre, top])) + self._over_middle(side)
        return ArmGoal(
            kind="place",
            name=place.name,
            position=position,
            yaw=wrap_angle(place.yaw + T_odom_world[2]),
            side=side,
            position_sd=0.0,
            last_seen=observation.time,
            release_half_width=place.side / 2.0 - place.wall,
            neighbours=np.array(inside).reshape(-1, 6),
            others=self._others(observation, {held, *names}),
        )

    def _others(self, observation: Observation, without: Collection[str]) -> Array:
        """Objects seen near the robot, as rows of `ArmGoal.others`; ``without``: names to leave out."""
        x, y, _ = observation.odometry.tolist()
        found = [
            (*position.tolist(), yaw, self.objects[name].side, 1.0)
            for name, position, yaw in self.tracker.seen_places()
            if name not in without and hypot(position[0] - x, position[1] - y) < NEAR
        ]
        return np.array(found).reshape(-1, 6)

    def _over_middle(self, side: float) -> Array:
        """Offset from the middle of an object to the point where it is grasped, (3,) [m]."""
        return np.array([0.0, 0.0, over_middle(side, self._arm.pick_tilt)])

    def _inside(
        self, place: Bin, held: str, observation: Observation, T_odom_world: Array
    ) -> tuple[tuple[str, ...], list[tuple[float, ...]]]:
        """Objects believed in a bin: names, and rows as in `ArmGoal.neighbours`; seen: since they were let go."""
        frame, known = compose(T_odom_world, np.array([*place.centre, place.yaw])), self.tracker.places(observation)
        inside = [
            (name, position)
            for name, position in zip(known.names, known.positions, strict=True)
            if name != held and np.abs(to_frame(frame, position[:2])).max() < 0.5 * place.side
        ]
        seen = {name for name, _, _ in self.tracker.seen_places()}
        items = [(*at.tolist(), 0.0, self.objects[name].side, float(name in seen)) for name, at in inside]
        return tuple(name for name, _ in inside), items

    def top_below(self, point: Array) -> float | None:
        """Height [m] of the furniture of the map below a point (3,) [m], world; None over the floor."""
        tops = [
            solid.z_max
            for solid in self.known.solids
            if TABLE < solid.z_max < point[2] and float(distance_to_shape(solid.shape, point[:2])) == 0.0
        ]
        return max(tops, default=None)

    def beliefs(self, observation: Observation, T_odom_world: Array, held: str) -> tuple[ObjectBelief, ...]:
        """Every object's belief in the world frame, for the Tick."""
        beliefs = []
        for name in self.objects:
            position, yaw, sd, last_seen = self.tracker.belief(name, observation)
            beliefs.append(
                ObjectBelief(
                    name=name,
                    position=to_frame(T_odom_world, position),
                    yaw=wrap_angle(yaw - T_odom_world[2]),
                    position_sd=sd,
                    seen=last_seen is not None,
                    held=name == held,
                )
            )
        return tuple(beliefs)
