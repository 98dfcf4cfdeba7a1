"""Every number that the scene format bounds, at both ends: scenes with one of them each."""

import copy
import typing
from collections.abc import Iterator
from typing import Any

import msgspec
import yaml

from motm_twin.model import scene_format as fmt

OPEN = 1e-6  # beside an end that is not allowed itself
ROOM = """
format: motm-scene/1
robot: {name: r}
start: {x: 0, y: 0}
bounds: [-8, -8, 8, 8]
furniture:
  table: {shape: box, centre: [2.5, 0.9], size: [1.2, 0.6], z: [0.7, 0.75]}
  post: {shape: cylinder, centre: [3.0, -1.5], radius: 0.1, z: [0, 1], mapped: false}
objects:
  cube: {surface: table, at: [2.3, 0.75]}
bins:
  tray: {at: [2.0, -3.0]}
agents:
  guest: {waypoints: [[-5, 4], [5, 4]]}
tasks:
  - drive_to: {x: -2, y: 0}
  - pick: cube
  - place: tray
"""
SECTIONS: dict[tuple[str, ...], type] = {
    ("robot", "footprint"): fmt.FootprintFile,
    ("robot", "base"): fmt.BaseFile,
    ("robot", "arm"): fmt.ArmFile,
    ("robot", "gripper"): fmt.GripperFile,
    ("robot", "lidar"): fmt.LidarFile,
    ("robot", "camera"): fmt.CameraFile,
    ("noise",): fmt.NoiseFile,
    ("faults",): fmt.FaultsFile,
    ("objects", "cube"): fmt.ObjectFile,
    ("bins", "tray"): fmt.BinFile,
    ("agents", "guest"): fmt.AgentFile,
    ("start",): fmt.PoseFile,
    ("furniture", "post"): fmt.CylinderFile,
    ("tasks", "0", "drive_to"): fmt.DriveToFile,
}


def ends() -> Iterator[tuple[str, str]]:
    """Name of a number at one of its ends, and the scene file with it."""
    for place, struct in SECTIONS.items():
        for field in msgspec.structs.fields(struct):
            for name, value in _ends_of(field.type):
                scene = yaml.safe_load(ROOM)
                part: Any = scene
                for key in place:
                    index = int(key) if isinstance(part, list) else key
                    if isinstance(part, dict) and key not in part:
                        part[key] = {}
                    part = part[index]
                part[field.name] = copy.copy(value)
                yield f"{'.'.join(place)}.{field.name} {name}", yaml.safe_dump(scene)


def _ends_of(annotation: Any) -> Iterator[tuple[str, float]]:
    for option in (annotation, *typing.get_args(annotation)):
        meta = next((m for m in getattr(option, "__metadata__", ()) if isinstance(m, msgspec.Meta)), None)
        if meta is None:
            continue
        whole = typing.get_args(option)[0] is int
        for name, bound, step in (("ge", meta.ge, 0), ("gt", meta.gt, 1), ("le", meta.le, 0), ("lt", meta.lt, -1)):
            if bound is not None:
                yield name, bound + step * (1 if whole else OPEN)
        return
