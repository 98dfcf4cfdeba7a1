"""From the checked tree of one variant to the resolved `Scene`: units converted, names followed, slots drawn."""

import math
from typing import Any

import msgspec
import numpy as np
from shapely.ops import unary_union

from motm_twin.model import scene_format as fmt
from motm_twin.model.profile import DEG, RobotProfile
from motm_twin.model.scene import (
    DETECTIONS,
    EARLIER_NOISE,
    GRASP_RULES,
    PERSON_ACCELERATION,
    TEMI_ACCELERATION,
    USUAL_NOISE,
    Agent,
    Bin,
    Box,
    Bump,
    Cylinder,
    DriveTo,
    Faults,
    Mismatch,
    Noise,
    Pick,
    Place,
    PlanarPose,
    Point,
    Prism,
    Scene,
    SceneObject,
    Solid,
    Task,
    TimedFault,
)
from motm_twin.model.scene_error import near
from motm_twin.model.scene_shapes import base_outline, counter_clockwise, is_simple, lane, outline
from motm_twin.model.scene_yaml import Node

MARGIN = 1.5  # [m] of map round everything in the scene
_SLOT_STREAM = 0x510750  # keeps the draw of slots apart from other uses of the scene's seed


class Resolver:
    """Resolves one variant; every refusal names the place in the file that caused it."""

    def __init__(self, root: Node, seed: int | None) -> None:
        self.root = root
        plain = {key: value for key, value in root.plain().items() if key not in ("extends", "default_variant")}
        self.keep = plain.pop("keep_agents", None)
        self.file = msgspec.convert(plain, fmt.SceneFile)
        self.seed = seed if seed is not None else (self.file.seed or 0)
        # A merged tree has no null entries; the types allow them because files and variants may.
        self.furniture = {key: item for key, item in self.file.furniture.items() if item is not None}
        self.slots = {key: item for key, item in self.file.slots.items() if item is not None}
        self.objects = {key: item for key, item in self.file.objects.items() if item is not None}
        self.bins = {key: item for key, item in self.file.bins.items() if item is not None}
        self.bumps = {key: item for key, item in self.file.bumps.items() if item is not None}
        self.agents = {key: item for key, item in self.file.agents.items() if item is not None}
        self.solids: dict[str, Solid] = {}

    def scene(self, name: str, variant: str) -> Scene:
        """The resolved scene, before the checks of ``scene_check.py``."""
        file = self.file
        self.solids = {key: self._solid(key, piece) for key, piece in self.furniture.items()}
        self._check_names()
        bins = tuple(
            Bin(name=k, centre=b.at, yaw=b.yaw_deg * DEG, side=b.side, wall=b.wall, rim_z=b.rim_z, floor_z=b.floor_z)
            for k, b in self.bins.items()
        )
        bumps = tuple(
            Bump(name=k, centre=b.at, length=b.length, yaw=b.yaw_deg * DEG, width=b.width, height=b.height)
            for k, b in self.bumps.items()
        )
        objects, tasks = self._work()
        start = _pose(file.start) if file.start else (0.0, 0.0, 0.0)
        agents = tuple(self._agent(key, agent) for key, agent in self._kept_agents().items())
        scene = Scene(
            name=name,
            variant=variant,
            seed=self.seed,
            title=file.title or name,
            robot=self._robot(),
            start=start,
            solids=tuple(self.solids.values()),
            objects=objects,
            bins=bins,
            bumps=bumps,
            agents=agents,
            tasks=tasks,
            noise=_noise(file.noise),
            mismatch=Mismatch(**_plain_units(file.mismatch)) if file.mismatch else Mismatch(),
            detections=file.detections or DETECTIONS[0],
            grasp_rule=file.grasp_rule or GRASP_RULES[0],
            faults=_faults(file.faults),
            bounds=(0.0, 0.0, 0.0, 0.0),
            time_limit=file.time_limit or 300.0,
        )
        return msgspec.structs.replace(scene, bounds=file.bounds or extent(scene))

    def _solid(self, name: str, piece: fmt.Furniture) -> Solid:
        node = self.root.at("furniture", name)
        if piece.z[0] >= piece.z[1]:
            raise node.at("z").error(f"the upper height must be above the lower one, got {list(piece.z)}")
        if isinstance(piece, fmt.BoxFile):
            shape: Any = Box(centre=piece.centre, size=piece.size, yaw=piece.yaw_deg * DEG)
        elif isinstance(piece, fmt.CylinderFile):
            shape = Cylinder(centre=piece.centre, radius=piece.radius)
        else:
            if not is_simple(piece.corners):
                raise node.at("corners").error("the outline crosses itself or has no area: list the corners in order")
            shape = Prism(corners=counter_clockwise(piece.corners))
        low, high = piece.z
        group = piece.group or name
        return Solid(name=name, shape=shape, z_min=low, z_max=high, mapped=piece.mapped, group=group, style=piece.style)

    def _check_names(self) -> None:
        seen: dict[str, str] = {}
        for section in ("furniture", "objects", "bins", "bumps", "agents"):
            for name in getattr(self.file, section):
                if name in seen:
                    node = self.root.at(section, name)
                    raise node.error(f"the name '{name}' is also used in {seen[name]}: rename one")
                seen[name] = section

    def _robot(self) -> RobotProfile:
        given = self.file.robot
        if given is None or isinstance(given, str):
            return RobotProfile()
        default = RobotProfile()
        parts = {
            key: msgspec.structs.replace(getattr(default, key), **_plain_units(getattr(given, key)))
            for key in ("footprint", "base", "arm", "gripper", "lidar", "camera")
            if isinstance(getattr(given, key), msgspec.Struct)
        }
        changed = parts or given.arm == "none"
        name = given.name if given.name != "frankie" or not changed else "frankie_modified"
        return msgspec.structs.replace(default, name=name, has_arm=given.arm != "none", **parts)

    def surface(self, name: str, node: Node) -> Solid:
        """The furniture called so; a group stands for its highest piece."""
        if name in self.solids:
            return self.solids[name]
        group = [solid for solid in self.solids.values() if solid.group == name]
        if not group:
            groups = {*self.solids, *(solid.group for solid in self.solids.values())}
            raise node.error(f"there is no furniture '{name}'; {near(name, sorted(groups))}")
        return max(group, key=lambda solid: solid.z_max)

    def _work(self) -> tuple[tuple[SceneObject, ...], tuple[Task, ...]]:
        objects = tuple(self._object(key, item) for key, item in self.objects.items())
        if self.file.deliver is not None:
            if self.file.tasks is not None:
                raise self.root.at("tasks").error("give either 'deliver' or 'tasks', not both")
            placed, tasks = self._deliver(self.file.deliver)
            return objects + placed, tasks
        if self.file.tasks is None:
            raise self.root.error("nothing to do: add 'tasks' (a list of pick, place, drive_to) or 'deliver'")
        return objects, tuple(self._task(i, task) for i, task in enumerate(self.file.tasks))

    def _object(self, name: str, item: fmt.ObjectFile) -> SceneObject:
        node = self.root.at("objects", name)
        if (item.surface is None) == (item.z is None):
            raise node.error("give exactly one of 'surface' (a piece of furniture) and 'z' (height of its top)")
        top = self.surface(item.surface, node.at("surface")).z_max if item.surface is not None else item.z or 0.0
        position = (*item.at, top + item.side / 2.0)
        return SceneObject(name=name, position=position, yaw=item.yaw_deg * DEG, side=item.side, colour=item.colour)

    def _deliver(self, deliver: fmt.DeliverFile) -> tuple[tuple[SceneObject, ...], tuple[Task, ...]]:
        node = self.root.at("deliver")
        if deliver.to is None or deliver.slots is None:
            raise node.error("'deliver' needs 'slots' (names, or {random: n}) and 'to' (bins)")
        objects: list[SceneObject] = []
        tasks: list[Task] = []
        for index, slot_name in enumerate(self._slot_names(deliver.slots, node)):
            slot = self.slots[slot_name]
            top = self.surface(slot.surface, self.root.at("slots", slot_name, "surface")).z_max
            name = f"cube_{slot_name}"
            position = (*slot.at, top + deliver.side / 2.0)
            objects.append(
                SceneObject(
                    name=name, position=position, yaw=slot.yaw_deg * DEG, side=deliver.side, colour=deliver.colour
                )
            )
            tasks += [Pick(object=name), Place(bin=deliver.to[index % len(deliver.to)])]
        return tuple(objects), tuple(tasks)

    def _slot_names(self, chosen: tuple[str, ...] | fmt.RandomSlots, node: Node) -> list[str]:
        slots = self.slots
        if isinstance(chosen, fmt.RandomSlots):
            wanted = chosen.random
            if wanted > len(slots):
                raise node.at("slots", "random").error(f"there are only {len(slots)} slots, got {wanted}")
            rng = np.random.default_rng([self.seed, _SLOT_STREAM])
            names = list(slots)
            return [names[i] for i in rng.permutation(len(names))[:wanted]]
        for index, name in enumerate(chosen):
            place = node.at("slots", index)
            if name not in slots:
                raise place.error(f"there is no slot '{name}'; {near(name, slots)}")
            if name in chosen[:index]:
                raise place.error(f"the object of slot '{name}' is already picked before: name each slot once")
        return list(chosen)

    def _task(self, index: int, task: fmt.TaskFile) -> Task:
        node = self.root.at("tasks", index)
        given = [key for key in ("pick", "place", "drive_to") if getattr(task, key) is not None]
        goal = task.drive_to
        if len(given) != 1:
            raise node.error(f"a task is exactly one of pick, place, drive_to; got {', '.join(given) or 'none'}")
        if task.pick is not None:
            return Pick(object=task.pick)
        if task.place is not None:
            return Place(bin=task.place)
        assert goal is not None
        heading = None if goal.heading_deg is None else goal.heading_deg * DEG
        return DriveTo(point=(goal.x, goal.y), heading=heading, tolerance=goal.tolerance)

    def _kept_agents(self) -> dict[str, fmt.AgentFile]:
        if self.keep is None:
            return self.agents
        for index, name in enumerate(self.keep):
            if name not in self.agents:
                node = self.root.at("keep_agents", index)
                raise node.error(f"there is no agent '{name}'; {near(name, self.agents)}")
        return {name: agent for name, agent in self.agents.items() if name in self.keep}

    def _agent(self, name: str, agent: fmt.AgentFile) -> Agent:
        node = self.root.at("agents", name)
        if agent.around is not None and (agent.waypoints or agent.start):
            raise node.error("'around' gives the way and the start: remove 'waypoints' and 'start'")
        points = list(self._lane(agent.around, node) if agent.around else agent.waypoints)
        if agent.start is not None:
            start = _pose(agent.start)
        elif points:
            ahead = points[1] if len(points) > 1 else points[0]
            start = (*points[0], math.atan2(ahead[1] - points[0][1], ahead[0] - points[0][0]))
            points = [*points[1:], points[0]] if len(points) > 1 else []
        else:
            raise node.error("where does it stand? Give 'start', 'waypoints' or 'around'")
        person = agent.kind == "person"
        return Agent(
            name=name,
            start=start,
            waypoints=tuple(points),
            speed=agent.speed_mps,
            radius=agent.radius,
            height=(1.7 if person else 1.0) if agent.height is None else agent.height,
            behaviour=agent.behaviour,
            kind=agent.kind,
            sees_robot=agent.sees_robot,
            acceleration=agent.acceleration_mps2 or (PERSON_ACCELERATION if person else TEMI_ACCELERATION),
            pause=agent.pause,
        )

    def _lane(self, around: fmt.AroundFile, node: Node) -> tuple[Point, ...]:
        self.surface(around.furniture, node.at("around", "furniture"))
        pieces = [s for s in self.solids.values() if around.furniture in (s.name, s.group)]
        hull = unary_union([outline(solid.shape) for solid in pieces]).convex_hull
        clockwise = around.direction == "clockwise"
        return lane(hull, around.distance, clockwise=clockwise, start_at=around.start_at)


def extent(scene: Scene) -> tuple[float, float, float, float]:
    """Bounds of the map: everything in the scene, and a margin round it."""
    boxes = [outline(solid.shape).bounds for solid in scene.solids]
    boxes.append(base_outline(scene.start, scene.robot.footprint).bounds)
    points = [item.position[:2] for item in scene.objects] + [item.centre for item in scene.bins]
    points += [task.point for task in scene.tasks if isinstance(task, DriveTo)]
    for agent in scene.agents:
        points += [agent.start[:2], *agent.waypoints]
    boxes += [(x, y, x, y) for x, y in points]
    corners = np.array(boxes)
    x_min, y_min = (round(float(value), 6) for value in corners[:, :2].min(axis=0) - MARGIN)
    x_max, y_max = (round(float(value), 6) for value in corners[:, 2:].max(axis=0) + MARGIN)
    return (x_min, y_min, x_max, y_max)


def _pose(pose: fmt.PoseFile) -> PlanarPose:
    return (pose.x, pose.y, pose.heading_deg * DEG)


def _noise(part: fmt.NoiseFile | str | None) -> Noise:
    """Given noise over the usual one; the name `earlier` stands for the earlier errors."""
    if isinstance(part, str):
        return EARLIER_NOISE
    return USUAL_NOISE if part is None else msgspec.structs.replace(USUAL_NOISE, **_plain_units(part))


def _faults(part: fmt.FaultsFile | None) -> Faults:
    """Faults of a run, and their times."""
    if part is None:
        return Faults()
    timed = tuple(TimedFault(**_plain_units(item)) for item in part.inject or ())
    return Faults(**{**_plain_units(part), "inject": timed or None})


def _plain_units(part: msgspec.Struct) -> dict[str, Any]:
    """Fields that are given, with their units taken off: degrees become radians."""
    fields: dict[str, Any] = {}
    for key in part.__struct_fields__:
        value = getattr(part, key)
        if value is None:
            continue
        stem, _, unit = key.rpartition("_")
        if unit in fmt.UNITS:
            fields[stem] = value * fmt.UNITS[unit]
        else:
            fields[key] = value
    return fields
