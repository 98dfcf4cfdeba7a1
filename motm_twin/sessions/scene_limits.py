"""Limits of the scene format, applied to the resolved scene inside a session."""

import functools
import re
from typing import Annotated, Any, Literal

import msgspec

from motm_twin.model import bounds, scene_check, scene_format
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Box, Cylinder, DriveTo, Prism, Scene, Solid
from motm_twin.model.scene_shapes import is_simple
from motm_twin.model.scene_yaml import Node

_NAMED = ("solids", "objects", "bins", "bumps", "agents")  # entries that have a name
_MOST_POINTS = 2_000  # of a lane or an outline
_SHAPES = {Box: scene_format.BoxFile, Cylinder: scene_format.CylinderFile, Prism: scene_format.PolygonFile}
_ROBOT = {
    "footprint": scene_format.FootprintFile,
    "base": scene_format.BaseFile,
    "arm": scene_format.ArmFile,
    "gripper": scene_format.GripperFile,
    "lidar": scene_format.LidarFile,
    "camera": scene_format.CameraFile,
}
_KINDS = ("temi", "person")
_COORDINATE = scene_format.Coordinate
_ANGLE = Annotated[float, msgspec.Meta(ge=-7.0, le=7.0)]  # [rad]
_TALL = Annotated[float, msgspec.Meta(ge=0, le=10)]  # [m]
_NAME = scene_format.Name


def check_scene(scene: Scene) -> None:
    """Raise SceneError for the first value that a scene file would not allow."""
    _check_counts(scene)
    _check_ranges(scene)
    scene_check.check_scene(scene, _places(scene))


def _check_counts(scene: Scene) -> None:
    for what in (*_NAMED, "tasks"):
        section = "furniture" if what == "solids" else what
        most, count = scene_format.most_entries(section), len(getattr(scene, what))
        if count > most:
            raise SceneError(f"scene.{what}: {count} are too many, at most {most}")
    names = [item.name for what in _NAMED for item in getattr(scene, what)]
    for name in names:
        if names.count(name) > 1:
            raise SceneError(f"scene: the name {name[:60]!r} is used twice")


def _check_ranges(scene: Scene) -> None:
    _fits(scene.seed, scene_format.Seed, "scene.seed")
    _fits(scene.time_limit, scene_format.TimeLimit, "scene.time_limit")
    _fits(scene.title, scene_format.Text, "scene.title")
    _fits(scene.bounds, tuple[_COORDINATE, _COORDINATE, _COORDINATE, _COORDINATE], "scene.bounds")
    _pose(scene.start, "scene.start")
    _within(scene.noise, scene_format.NoiseFile, "scene.noise")
    _within(scene.mismatch, scene_format.MismatchFile, "scene.mismatch")
    _fits(scene.detections, Literal["anonymous", "named"], "scene.detections")
    _within(scene.faults, scene_format.FaultsFile, "scene.faults")
    _fits(scene.grasp_rule, Literal["strict", "swept"], "scene.grasp_rule")
    _fits(scene.grasp_speed, scene_format.GraspSpeed, "scene.grasp_speed")
    if scene.physics is not None and (problem := bounds.problem(scene.physics)):
        raise SceneError(f"scene.physics: {problem}")
    for part, limits in _ROBOT.items():
        _within(getattr(scene.robot, part), limits, f"scene.robot.{part}")
    for index, solid in enumerate(scene.solids):
        _check_solid(solid, f"scene.solids[{index}]")
    for section, limits, point, kind in (
        ("objects", scene_format.ObjectFile, "position", tuple[_COORDINATE, _COORDINATE, _TALL]),
        ("bins", scene_format.BinFile, "centre", scene_format.Point),
        ("bumps", scene_format.BumpFile, "centre", scene_format.Point),
    ):
        for index, item in enumerate(getattr(scene, section)):
            place = f"scene.{section}[{index}]"
            _within(item, limits, place)
            _fits(item.name, _NAME, f"{place}.name")
            _fits(getattr(item, point), kind, f"{place}.{point}")
    for index, bump in enumerate(scene.bumps):
        _fits(bump.yaw, _ANGLE, f"scene.bumps[{index}].yaw")
    for index, agent in enumerate(scene.agents):
        place = f"scene.agents[{index}]"
        _within(agent, scene_format.AgentFile, place, skip=("start", "waypoints"))
        _fits(agent.name, _NAME, f"{place}.name")
        _pose(agent.start, f"{place}.start")
        _points(agent.waypoints, f"{place}.waypoints")
        if agent.kind not in _KINDS:
            raise SceneError(f"{place}.kind: {agent.kind[:60]!r} is unknown, use one of {', '.join(_KINDS)}")
    for index, task in enumerate(scene.tasks):
        if isinstance(task, DriveTo):
            place = f"scene.tasks[{index}]"
            _fits(task.point, scene_format.Point, f"{place}.point")
            _fits(task.heading, _ANGLE | None, f"{place}.heading")
            _fits(task.tolerance, scene_format.Tolerance, f"{place}.tolerance")


def _check_solid(solid: Solid, place: str) -> None:
    _fits(solid.name, _NAME, f"{place}.name")
    _fits((solid.z_min, solid.z_max), tuple[scene_format.Height, scene_format.Height], f"{place}.z_min, z_max")
    if solid.z_min >= solid.z_max:
        raise SceneError(f"{place}: z_max must be above z_min, got {solid.z_min:g} and {solid.z_max:g}")
    _fits(solid.style, scene_format.Style, f"{place}.style")
    if solid.group:
        _fits(solid.group, _NAME, f"{place}.group")
    if isinstance(solid.shape, Prism):
        _points(solid.shape.corners, f"{place}.shape.corners")
        if len(solid.shape.corners) < 3 or not is_simple(solid.shape.corners):
            raise SceneError(f"{place}.shape: the outline crosses itself or has no area")
    else:
        _within(solid.shape, _SHAPES[type(solid.shape)], f"{place}.shape")


def _pose(pose: tuple[float, float, float], place: str) -> None:
    _fits(pose, tuple[_COORDINATE, _COORDINATE, _ANGLE], place)


def _points(points: tuple[tuple[float, float], ...], place: str) -> None:
    if len(points) > _MOST_POINTS:
        raise SceneError(f"{place}: {len(points)} points are too many, at most {_MOST_POINTS}")
    _fits(points, tuple[scene_format.Point, ...], place)


_fields = functools.cache(msgspec.structs.fields)


def _within(part: Any, limits: type[msgspec.Struct], place: str, skip: tuple[str, ...] = ()) -> None:
    """Check the fields that the scene format has against its limits, in its units."""
    for field in _fields(limits):
        stem, _, unit = field.name.rpartition("_")
        name, scale = (stem, scene_format.UNITS[unit]) if unit in scene_format.UNITS else (field.name, 1.0)
        if name in skip or name not in part.__struct_fields__:
            continue
        value = getattr(part, name)
        if unit in scene_format.UNITS and value is not None:
            value = round(value / scale, 9)
        _fits(value, field.type, f"{place}.{name}")


def _fits(value: Any, kind: Any, place: str) -> None:
    try:
        msgspec.convert(msgspec.to_builtins(value), kind)
    except msgspec.ValidationError as error:
        message = re.sub(r" - at `(.*)`$", lambda found: f" ({place}{found[1].removeprefix('$')})", str(error))
        raise SceneError(f"{place}: {message}") from error


def _places(scene: Scene) -> Node:
    """Places of named items and tasks in the scene, for the messages of `scene_check`."""

    def node(value: Any, place: str) -> Node:
        return Node(value, "", 0, place)

    def named(what: str) -> Node:
        names = [item.name for item in getattr(scene, what)]
        return node({name: node(None, f"scene.{what}: {name}") for name in names}, f"scene.{what}")

    tasks = node([node(None, f"scene.tasks[{index}]") for index in range(len(scene.tasks))], "scene.tasks")
    return node({what: named(what) for what in ("objects", "bins", "agents")} | {"tasks": tasks}, "scene")
