"""What stands still, as Foxglove draws it: the furniture of a scene, and the robot's shape, each sent once."""

import json
import math
import struct

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.data_dirs import web_assets_dir
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene, Solid
from motm_twin.record.foxglove_shapes import Colour, Json, colour, cube, cylinder, entity, point, pose, stamp

WORLD = "world"
_STYLES: dict[str, Colour] = {
    "table": (0.76, 0.60, 0.42, 1.0),
    "desk": (0.70, 0.56, 0.42, 1.0),
    "cabinet": (0.55, 0.58, 0.62, 1.0),
    "box": (0.72, 0.55, 0.36, 1.0),
    "wall": (0.85, 0.85, 0.83, 0.6),
}
_PLAIN: Colour = (0.66, 0.66, 0.66, 1.0)
_BIN: Colour = (0.22, 0.42, 0.68, 0.8)
_WHITE: Colour = (0.93, 0.93, 0.93, 1.0)
_DARK: Colour = (0.16, 0.17, 0.19, 1.0)
_MESHES = {
    "base_link": "base",
    **{f"panda_link{number}": f"link{number}" for number in range(8)},
    "panda_hand": "hand",
    "panda_leftfinger": "leftfinger",
    "panda_rightfinger": "rightfinger",
}
_ALL = 1


def furniture(scene: Scene, server_time: float) -> Json:
    """The solids and bins of a scene."""
    at = stamp(server_time)
    entities = [_solid(at, solid, number) for number, solid in enumerate(scene.solids)]
    entities += [entity(at, WORLD, f"bin {item.name}", cubes=_bin(item)) for item in scene.bins]
    return {"deletions": [{"timestamp": at, "type": _ALL, "id": ""}], "entities": entities}


def robot_model(server_time: float) -> Json:
    """The light meshes of the links, as triangles, each in the frame of its link."""
    at = stamp(server_time)
    return {"deletions": [], "entities": [_link(at, link, name) for link, name in _MESHES.items()]}


def _link(at: Json, link: str, name: str) -> Json:
    points, indices = _ghost(name)
    tint = _DARK if link == "base_link" or "finger" in link else _WHITE
    # Triangles, not an embedded model: viewers do not agree on which axis of a glTF file points up.
    shape = {
        "pose": pose(0.0, 0.0),
        "points": [point(*values) for values in points.tolist()],
        "color": colour(tint),
        "colors": [],
        "indices": indices.tolist(),
    }
    return entity(at, link, link, triangles=[shape])


def _ghost(name: str) -> tuple[NDArray[np.float32], NDArray[np.uint32]]:
    """Vertices (n, 3) and indices (3 m,) of a light mesh; its GLB holds one mesh of these two accessors only."""
    data = (web_assets_dir() / "ghost" / f"{name}.glb").read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    head, body = json.loads(data[20 : 20 + length]), data[28 + length :]
    (primitive,) = head["meshes"][0]["primitives"]

    def read(accessor: int, kind: type) -> NDArray:
        entry = head["accessors"][accessor]
        view = head["bufferViews"][entry["bufferView"]]
        columns = 3 if entry["type"] == "VEC3" else 1
        start = view.get("byteOffset", 0) + entry.get("byteOffset", 0)
        return np.frombuffer(body, dtype=kind, count=entry["count"] * columns, offset=start)

    vertices = read(primitive["attributes"]["POSITION"], np.float32)
    return vertices.reshape(-1, 3), read(primitive["indices"], np.uint32)


def _solid(at: Json, solid: Solid, number: int) -> Json:
    name, tint = f"{number} {solid.name}", _STYLES.get(solid.style, _PLAIN)
    middle, height = 0.5 * (solid.z_min + solid.z_max), solid.z_max - solid.z_min
    match solid.shape:
        case Box(centre=centre, size=size, yaw=yaw):
            return entity(at, WORLD, name, cubes=[cube((*centre, middle), (*size, height), tint, yaw)])
        case Cylinder(centre=centre, radius=radius):
            size = (2.0 * radius, 2.0 * radius, height)
            return entity(at, WORLD, name, cylinders=[cylinder((*centre, middle), size, tint)])
        case Prism():
            return entity(at, WORLD, name, triangles=[_walls(solid.shape, solid.z_min, solid.z_max, tint)])


def _walls(prism: Prism, z_min: float, z_max: float, tint: Colour) -> Json:
    """The upright faces of a prism: its top would need a triangulation, and is seen well enough without."""
    count = len(prism.corners)
    points = [point(x, y, z) for x, y in prism.corners for z in (z_min, z_max)]
    indices: list[int] = []
    for corner in range(count):
        a, b = 2 * corner, 2 * ((corner + 1) % count)
        indices += [a, b, b + 1, a, b + 1, a + 1]
    return {"pose": pose(0.0, 0.0), "points": points, "color": colour(tint), "colors": [], "indices": indices}


def _bin(item: Bin) -> list[Json]:
    """Floor and four walls."""
    height = item.rim_z - item.floor_z
    x, y = item.centre
    c, s = math.cos(item.yaw), math.sin(item.yaw)
    half, middle = 0.5 * (item.side - item.wall), item.floor_z + 0.5 * height
    floor = cube((x, y, item.floor_z), (item.side, item.side, item.wall), _BIN, item.yaw)
    walls = [
        cube(
            (x + c * dx - s * dy, y + s * dx + c * dy, middle),
            (item.wall, item.side, height) if dx else (item.side, item.wall, height),
            _BIN,
            item.yaw,
        )
        for dx, dy in ((half, 0.0), (-half, 0.0), (0.0, half), (0.0, -half))
    ]
    return [floor, *walls]
