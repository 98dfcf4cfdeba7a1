"""From the checked tree of one variant to the resolved `Scene`: units converted, names followed, slots drawn."""

import math
from typing import Any

import msgspec
import numpy as np
from shapely.ops import unary_union

from motm_twin.model import scene as resolved
from motm_twin.model import scene_format as fmt
from motm_twin.model.names import hint
from motm_twin.model.profile import DEG, RobotProfile
from motm_twin.model.scene import PlanarPose, Point, Scene, SceneObject, Solid, Task
from motm_twin.model.scene_shapes import base_outline, counter_clockwise, is_simple, lane, outline, surface
from motm_twin.model.scene_yaml import Node

MARGIN = 1.5  # [m] of map round everything in the scene
_SLOT_STREAM = 0x510750  # separates the draw of slots from other uses of the scene's seed


class Resolver:
    """Resolves one variant; every refusal names the place in the file that caused it."""

    def __init__(self, root: Node, seed: int | None, chosen_slots: list[str] | None = None) -> None:
        """``chosen_slots``: to use instead of those that the seed draws."""
        self.root, self.chosen_slots = root, chosen_slots
        plain = {key: value for key, value in root.plain().items() if key not in ("extends", "default_variant")}
        self.keep = plain.pop("keep_agents", None)
        self.file = msgspec.convert(plain, fmt.SceneFile)
        self.seed = seed if seed is not None else (self.file.seed or 0)
        self.slots, self.agents = self._entries("slots"), self._entries("agents")
        self.solids: dict[str, Solid] = {}

    def _entries(self, section: str) -> dict[str, Any]:
        """Entries of a section without null ones, which only files and variants may have."""
        return {key: item for key, item in getattr(self.file, section).items() if item is not None}

    def scene(self, name: str, variant: str) -> Scene:
        """The resolved scene, before the checks of ``scene_check.py``."""
        file = self.file
        self.solids = {key: self._solid(key, piece) for key, piece in self._entries("furniture").items()}
        self._check_names()
        objects, tasks = self._work()
        scene = Scene(
            name=name,
            variant=variant,
            seed=self.seed,
            title=file.title or name,
            robot=self._robot(),
            start=_pose(file.start) if file.start else (0.0, 0.0, 0.0),
            solids=tuple(self.solids.values()),
            objects=objects,
            bins=tuple(resolved.Bin(name=key, **_placed(item)) for key, item in self._entries("bins").items()),
            bumps=tuple(resolved.Bump(name=key, **_placed(item)) for key, item in self._entries("bumps").items()),
            agents=tuple(self._agent(key, agent) for key, agent in self._kept_agents().items()),
            tasks=tasks,
            noise=_noise(file.noise),
            mismatch=resolved.Mismatch(**_plain_units(file.mismatch)) if file.mismatch else resolved.Mismatch(),
            detections=file.detections or resolved.DETECTIONS[0],
            grasp_rule=file.grasp_rule or resolved.GRASP_RULES[0],
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
            shape: Any = resolved.Box(centre=piece.centre, size=piece.size, yaw=piece.yaw_deg * DEG)
        elif isinstance(piece, fmt.CylinderFile):
            shape = resolved.Cylinder(centre=piece.centre, radius=piece.radius)
        else:
            if not is_simple(piece.corners):
                raise node.at("corners").error("the outline crosses itself or has no area: list the corners in order")
            shape = resolved.Prism(corners=counter_clockwise(piece.corners))
        (low, high), group = piece.z, piece.group or name
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
        """The furniture of this name; a group stands for its highest piece."""
        found = surface(name, self.solids.values())
        if found is None:
            groups = {*self.solids, *(solid.group for solid in self.solids.values())}
            raise node.error(f"there is no furniture '{name}'; {hint(name, sorted(groups))}")
        return found

    def _work(self) -> tuple[tuple[SceneObject, ...], tuple[Task, ...]]:
        objects = tuple(self._object(key, item) for key, item in self._entries("objects").items())
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
        return _cube(name, item, top, item)

    def _deliver(self, deliver: fmt.DeliverFile) -> tuple[tuple[SceneObject, ...], tuple[Task, ...]]:
        node = self.root.at("deliver")
        if deliver.to is None or deliver.slots is None:
            raise node.error("'deliver' needs 'slots' (names, or {random: n}) and 'to' (bins)")
        objects: list[SceneObject] = []
        tasks: list[Task] = []
        for index, slot_name in enumerate(self._slot_names(deliver.slots, node)):
            objects.append(self.cube_on(slot_name))
            tasks += [resolved.Pick(object=objects[-1].name), resolved.Place(bin=deliver.to[index % len(deliver.to)])]
        return tuple(objects), tuple(tasks)

    def cube_on(self, slot_name: str) -> SceneObject:
        """The cube that a slot would hold; of the default size without `deliver`."""
        slot = self.slots[slot_name]
        top = self.surface(slot.surface, self.root.at("slots", slot_name, "surface")).z_max
        return _cube(f"cube_{slot_name}", slot, top, self.file.deliver or fmt.DeliverFile())

    def draws(self) -> list[list[str]]:
        """Lists of slots to check: one with all slots if several are drawn, else one per slot; none for named slots."""
        chosen = None if self.file.deliver is None else self.file.deliver.slots
        if not isinstance(chosen, fmt.RandomSlots):
            return []
        return [list(self.slots)] if chosen.random > 1 else [[name] for name in self.slots]

    def _slot_names(self, chosen: tuple[str, ...] | fmt.RandomSlots, node: Node) -> list[str]:
        slots = self.slots
        if isinstance(chosen, fmt.RandomSlots):
            if chosen.random > len(slots):
                raise node.at("slots", "random").error(f"there are only {len(slots)} slots, got {chosen.random}")
            if self.chosen_slots is not None:
                return self.chosen_slots
            rng, names = np.random.default_rng([self.seed, _SLOT_STREAM]), list(slots)
            return [names[i] for i in rng.permutation(len(names))[: chosen.random]]
        for index, name in enumerate(chosen):
            place = node.at("slots", index)
            if name not in slots:
                raise place.error(f"there is no slot '{name}'; {hint(name, slots)}")
            if name in chosen[:index]:
                raise place.error(f"the object of slot '{name}' is already picked before: name each slot once")
        return list(chosen)

    def _task(self, index: int, task: fmt.TaskFile) -> Task:
        node = self.root.at("tasks", index)
        given, goal = [key for key in task.__struct_fields__ if getattr(task, key) is not None], task.drive_to
        if len(given) != 1:
            raise node.error(f"a task is exactly one of pick, place, drive_to; got {', '.join(given) or 'none'}")
        if task.pick is not None:
            return resolved.Pick(object=task.pick)
        if task.place is not None:
            return resolved.Place(bin=task.place)
        assert goal is not None
        heading = None if goal.heading_deg is None else goal.heading_deg * DEG
        return resolved.DriveTo(point=(goal.x, goal.y), heading=heading, tolerance=goal.tolerance)

    def _kept_agents(self) -> dict[str, fmt.AgentFile]:
        if self.keep is None:
            return self.agents
        for index, name in enumerate(self.keep):
            if name not in self.agents:
                node = self.root.at("keep_agents", index)
                raise node.error(f"there is no agent '{name}'; {hint(name, self.agents)}")
        return {name: agent for name, agent in self.agents.items() if name in self.keep}

    def _agent(self, name: str, agent: fmt.AgentFile) -> resolved.Agent:
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
        usual: dict[str, Any] = {"height": 1.0, "acceleration": resolved.TEMI_ACCELERATION}
        if agent.kind == "person":
            usual = {"height": 1.7, "acceleration": resolved.PERSON_ACCELERATION}
        given = _plain_units(msgspec.structs.replace(agent, around=None))
        return resolved.Agent(**usual | given | {"name": name, "start": start, "waypoints": tuple(points)})

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
    points += [task.point for task in scene.tasks if isinstance(task, resolved.DriveTo)]
    for agent in scene.agents:
        points += [agent.start[:2], *agent.waypoints]
    boxes += [(x, y, x, y) for x, y in points]
    corners = np.array(boxes)
    x_min, y_min = (round(float(value), 6) for value in corners[:, :2].min(axis=0) - MARGIN)
    x_max, y_max = (round(float(value), 6) for value in corners[:, 2:].max(axis=0) + MARGIN)
    return (x_min, y_min, x_max, y_max)


def _pose(pose: fmt.PoseFile) -> PlanarPose:
    return (pose.x, pose.y, pose.heading_deg * DEG)


def _cube(
    name: str, at: fmt.ObjectFile | fmt.SlotFile, top: float, of: fmt.ObjectFile | fmt.DeliverFile
) -> SceneObject:
    """A cube with its lower face at a height [m]."""
    position = (*at.at, top + of.side / 2.0)
    return SceneObject(name=name, position=position, yaw=at.yaw_deg * DEG, side=of.side, colour=of.colour)


def _placed(part: msgspec.Struct) -> dict[str, Any]:
    """Fields of a section with ``at``, which becomes ``centre``."""
    fields = _plain_units(part)
    return {"centre": fields.pop("at"), **fields}


def _noise(part: fmt.NoiseFile | str | None) -> resolved.Noise:
    """The given noise over the defaults; the name `earlier` stands for `EARLIER_NOISE`."""
    if isinstance(part, str):
        return resolved.EARLIER_NOISE
    return resolved.USUAL_NOISE if part is None else msgspec.structs.replace(resolved.USUAL_NOISE, **_plain_units(part))


def _faults(part: fmt.FaultsFile | None) -> resolved.Faults:
    """Faults of a run, and their times."""
    if part is None:
        return resolved.Faults()
    timed = tuple(resolved.TimedFault(**_plain_units(item)) for item in part.inject or ())
    return resolved.Faults(**{**_plain_units(part), "inject": timed or None})


def _plain_units(part: msgspec.Struct) -> dict[str, Any]:
    """The given fields in plain units (degrees become radians), without the unit in their names."""
    fields: dict[str, Any] = {}
    for key in part.__struct_fields__:
        value = getattr(part, key)
        if value is None:
            continue
        stem, _, unit = key.rpartition("_")
        scaled = unit in fmt.UNITS
        fields[stem if scaled else key] = value * fmt.UNITS[unit] if scaled else value
    return fields
