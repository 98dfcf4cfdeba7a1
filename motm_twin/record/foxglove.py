"""Conversion of our messages and scenes to messages that Foxglove and Lichtblick draw, at 10 Hz.

Frames: ``world``, and the links of the robot. Lengths [m], angles [rad]; times are the server's, as on the bus.
"""

import base64
import json
import math
import struct
from collections.abc import Callable, Iterable, Sequence

import msgspec
import numpy as np
from numpy.typing import NDArray

from motm_twin.bus import messages as bus
from motm_twin.model.assets import web_assets_dir
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene, Solid
from motm_twin.record import channels as ch
from motm_twin.record.channels import Json

Colour = tuple[float, float, float, float]  # red, green, blue, opacity, 0 to 1
_DIGITS, _PLOT_DIGITS = 4, 5  # decimals: 0.1 mm; of curves
INTERVAL = 0.1  # [s] between two messages of a drawn topic
SLOW = 0.25  # [s] for candidates
_TOLERANCE = 0.01  # [s] by which a message may be early
Add = Callable[[ch.Channel, float, bytes], None]
_FOR_EVER: Json = {"sec": 0, "nsec": 0}
WORLD = "world"
PATH_HEIGHT = 0.03  # [m] paths float above the floor and the grid
LOCAL_HEIGHT = 0.05
CANDIDATE_SIZE = 0.07  # [m]
_KINDS_ROUND = ("temi", "person", "cylinder")
_UINT8 = 1
_INFO, _WARNING = 2, 3
_BAD_EVENTS = ("failed", "contact", "stop", "missed", "lost", "postponed")
_DEAR: Colour = (0.27, 0.0, 0.33, 1.0)
_MIDDLE: Colour = (0.13, 0.57, 0.55, 1.0)
_CHEAP: Colour = (0.99, 0.91, 0.14, 1.0)
_REJECTED: Colour = (0.62, 0.64, 0.66, 0.5)
_CHOSEN: Colour = (0.9, 0.22, 0.49, 1.0)
_BODY_COLOURS: dict[str, Colour] = {"cube": (0.91, 0.09, 0.11, 1.0), "temi": (0.95, 0.95, 0.97, 1.0)}
_OTHER_BODY: Colour = (0.9, 0.55, 0.2, 1.0)
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
_OF_ARM = (*(f"link{number}" for number in range(8)), "hand", "leftfinger", "rightfinger")
_MESHES = {"base_link": "base", **{f"panda_{name}": name for name in _OF_ARM}}
_ALL = 1


def stamp(seconds: float) -> Json:
    """A time since 1970; an earlier one counts as 0."""
    nanoseconds = max(0, round(seconds * 1e9))
    return {"sec": nanoseconds // 1_000_000_000, "nsec": nanoseconds % 1_000_000_000}


def point(x: float, y: float, z: float) -> Json:
    """A point, or the extents of something."""
    return {"x": round(x, _DIGITS), "y": round(y, _DIGITS), "z": round(z, _DIGITS)}


def quaternion(yaw: float) -> Json:
    """A rotation about the vertical [rad]."""
    return {"x": 0.0, "y": 0.0, "z": round(math.sin(yaw / 2.0), 6), "w": round(math.cos(yaw / 2.0), 6)}


def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> Json:
    """A position and a rotation about the vertical."""
    return {"position": point(x, y, z), "orientation": quaternion(yaw)}


def colour(values: Colour) -> Json:
    """Red, green, blue and opacity."""
    return dict(zip("rgba", values, strict=True))


def cube(centre: Sequence[float], size: Sequence[float], tint: Colour, yaw: float = 0.0) -> Json:
    """A box."""
    x, y, z = centre
    return {"pose": pose(x, y, z, yaw), "size": point(size[0], size[1], size[2]), "color": colour(tint)}


def cylinder(centre: Sequence[float], size: Sequence[float], tint: Colour, yaw: float = 0.0) -> Json:
    """An upright cylinder of these extents."""
    return {**cube(centre, size, tint, yaw), "bottom_scale": 1.0, "top_scale": 1.0}


def entity(at: Json, frame: str, name: str, **primitives: list[Json]) -> Json:
    """An entity that is drawn until it is replaced, and moves with its frame."""
    kinds = ("arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models")
    about = {"timestamp": at, "frame_id": frame, "id": name, "lifetime": _FOR_EVER, "frame_locked": True}
    return {**about, "metadata": [], **{kind: primitives.get(kind, []) for kind in kinds}}


def _in_world(server_time: float, **fields: object) -> Json:
    return {"timestamp": stamp(server_time), "frame_id": WORLD, **fields}


def transforms(robot: bus.RobotStateMessage) -> Json:
    """Every frame of the robot in the world."""
    at = stamp(robot.server_time)
    return {"transforms": [_transform(at, name, values[:3], values[3:]) for name, values in robot.frames.items()]}


def base_transform(tick: bus.TickMessage) -> Json:
    """The base only, from a tick: for servers that send no robot state."""
    x, y, heading = tick.robot.pose
    turn = [math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0)]
    return {"transforms": [_transform(stamp(tick.server_time), "base_link", [x, y, 0.0], turn)]}


def scan(message: bus.ScanMessage) -> Json:
    """One sweep in the world frame; a beam without return is drawn beyond the range."""
    x, y, heading = message.pose
    ox, oy = message.origin
    c, s = math.cos(heading), math.sin(heading)
    beyond = message.range_max * 10.0
    return _in_world(
        message.server_time,
        pose=pose(x + c * ox - s * oy, y + s * ox + c * oy, 0.2, heading),
        start_angle=message.angle_min,
        end_angle=message.angle_min + message.angle_step * max(0, len(message.ranges) - 1),
        ranges=[beyond if value is None else round(value, 3) for value in message.ranges],
        intensities=[],
    )


def grid(info: bus.GridInfo, cells: bytes, server_time: float) -> Json:
    """The map as bytes: 255 occupied, else 254 times the proximity to an obstacle."""
    place, cell = pose(info.origin[0], info.origin[1], 0.0), {"x": info.resolution, "y": info.resolution}
    shape = {"column_count": info.width, "cell_size": cell, "row_stride": info.width, "cell_stride": 1}
    fields = [{"name": "proximity", "offset": 0, "type": _UINT8}]
    return _in_world(server_time, pose=place, **shape, fields=fields, data=base64.b64encode(cells).decode())


def path(points: Iterable[Sequence[float]], server_time: float, height: float = PATH_HEIGHT) -> Json:
    """A path of points x, y (and heading), each pose turned along it."""
    listed = [list(values) for values in points]
    poses = [pose(values[0], values[1], height, _heading(listed, at)) for at, values in enumerate(listed)]
    return _in_world(server_time, poses=poses)


def bodies(tick: bus.TickMessage) -> Json:
    """True objects, agents and added obstacles; they replace the earlier ones."""
    listed, at = [], stamp(tick.server_time)
    for body in (*tick.objects, *tick.agents, *tick.obstacles):
        x, y, z = body.position
        middle = (x, y, z if body.kind == "cube" else z + 0.5 * body.size[2])
        tint = _BODY_COLOURS.get(body.kind, _OTHER_BODY)
        shapes, shape = ("cylinders", cylinder) if body.kind in _KINDS_ROUND else ("cubes", cube)
        listed.append(entity(at, WORLD, body.name, **{shapes: [shape(middle, body.size, tint, body.yaw)]}))
    return {"deletions": [{"timestamp": at, "type": _ALL, "id": ""}], "entities": listed}


def candidates(placement: bus.PlacementMessage, server_time: float) -> Json:
    """Base poses: cheap ones yellow, expensive ones violet, rejected ones grey, the chosen one large."""
    known = [cost for cost in placement.cost if cost is not None]
    least, most = min(known, default=0.0), max(known, default=1.0)
    spheres = []
    for index, (values, cost) in enumerate(zip(placement.poses, placement.cost, strict=True)):
        chosen = index == placement.chosen
        tint = _CHOSEN if chosen else _REJECTED if cost is None else _scale((cost - least) / max(most - least, 1e-9))
        size = CANDIDATE_SIZE * (2.0 if chosen else 1.0 if cost is not None else 0.6)
        place = pose(values[0], values[1], PATH_HEIGHT)
        spheres.append({"pose": place, "size": point(size, size, size), "color": colour(tint)})
    return {"deletions": [], "entities": [entity(stamp(server_time), WORLD, "candidates", spheres=spheres)]}


def log(event: bus.NumberedEvent) -> Json:
    """An event as a line of a log."""
    level = _WARNING if event.kind in _BAD_EVENTS else _INFO
    content = {"message": event.text or event.kind, "name": event.kind, "file": "", "line": 0}
    return {"timestamp": stamp(event.server_time), "level": level, **content}


def _transform(at: Json, child: str, position: Sequence[float], turn: Sequence[float]) -> Json:
    moved = {"translation": point(*position), "rotation": dict(zip("wxyz", turn, strict=True))}
    return {"timestamp": at, "parent_frame_id": WORLD, "child_frame_id": child, **moved}


def _heading(points: list[list[float]], at: int) -> float:
    if len(points[at]) > 2:
        return points[at][2]
    if len(points) < 2:
        return 0.0
    one, other = (points[at], points[at + 1]) if at + 1 < len(points) else (points[at - 1], points[at])
    return math.atan2(other[1] - one[1], other[0] - one[0])


def _scale(part: float) -> Colour:
    """Colour of a cost from 0 (cheap) to 1 (expensive)."""
    low, high, rest = (_CHEAP, _MIDDLE, 2.0 * part) if part < 0.5 else (_MIDDLE, _DEAR, 2.0 * part - 1.0)
    r, g, b, a = (round(one + (other - one) * rest, 3) for one, other in zip(low, high, strict=True))
    return r, g, b, a


def furniture(scene: Scene, server_time: float) -> Json:
    """The solids and bins of a scene."""
    at = stamp(server_time)
    entities = [_solid(at, solid, number) for number, solid in enumerate(scene.solids)]
    entities += [entity(at, WORLD, f"bin {item.name}", cubes=_bin(item)) for item in scene.bins]
    return {"deletions": [{"timestamp": at, "type": _ALL, "id": ""}], "entities": entities}


def robot_model(server_time: float) -> Json:
    """The light meshes of the links, as triangles, each in the frame of its link."""
    entities = []  # no embedded models: viewers disagree about the axis of a glTF file that points up
    for link, name in _MESHES.items():
        points, indices = _ghost(name)
        tint = _DARK if link == "base_link" or "finger" in link else _WHITE
        shape = _triangles(points.tolist(), indices.tolist(), tint)
        entities.append(entity(stamp(server_time), link, link, triangles=[shape]))
    return {"deletions": [], "entities": entities}


def _triangles(corners: Iterable[Sequence[float]], indices: list[int], tint: Colour) -> Json:
    points = [point(*corner) for corner in corners]
    return {"pose": pose(0.0, 0.0), "points": points, "color": colour(tint), "colors": [], "indices": indices}


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
    """The upright faces of a prism, without a top, which would need triangulation."""
    count, indices = len(prism.corners), []
    for corner in range(count):
        a, b = 2 * corner, 2 * ((corner + 1) % count)
        indices += [a, b, b + 1, a, b + 1, a + 1]
    return _triangles([(x, y, z) for x, y in prism.corners for z in (z_min, z_max)], indices, tint)


def _bin(item: Bin) -> list[Json]:
    """Floor and four walls of a bin."""
    (x, y), height, half = item.centre, item.rim_z - item.floor_z, 0.5 * (item.side - item.wall)
    c, s = math.cos(item.yaw), math.sin(item.yaw)
    found = [cube((x, y, item.floor_z), (item.side, item.side, item.wall), _BIN, item.yaw)]
    for dx, dy in ((half, 0.0), (-half, 0.0), (0.0, half), (0.0, -half)):
        place = (x + c * dx - s * dy, y + s * dx + c * dy, item.floor_z + 0.5 * height)
        size = (item.wall, item.side, height) if dx else (item.side, item.wall, height)
        found.append(cube(place, size, _BIN, item.yaw))
    return found


class Drawer:
    """Adds drawn messages to a recording, through ``add`` (channel, server time, JSON)."""

    def __init__(self, add: Add) -> None:
        self._add = add
        self._next: dict[str, float] = {}
        self._robot_shown, self._frames_known = False, False
        self._placement: bus.PlacementMessage | None = None

    def tick(self, tick: bus.TickMessage) -> None:
        """Add bodies, paths, candidates and curves of a period."""
        now = tick.server_time
        if not self._frames_known and self._due(ch.DRAWN_FRAMES, now):
            self.put(ch.DRAWN_FRAMES, now, base_transform(tick))
        if self._due(ch.DRAWN_CANDIDATES, now, SLOW) and tick.placement != self._placement:
            self._placement = tick.placement
            self.put(ch.DRAWN_CANDIDATES, now, candidates(tick.placement, now))
        if self._due(ch.PLOTS, now):
            self.put(ch.PLOTS, now, plots(tick))
            self.put(ch.DRAWN_BODIES, now, bodies(tick))
            self.put(ch.DRAWN_GLOBAL, now, path(tick.plan.global_path, now))
            self.put(ch.DRAWN_NEXT, now, path(tick.plan.next_path, now))
            self.put(ch.DRAWN_LOCAL, now, path([row[:3] for row in tick.plan.local_poses], now, LOCAL_HEIGHT))

    def wants_tick(self, server_time: float) -> bool:
        """True when `tick` would add anything now."""
        return any(self._is_due(channel, server_time, INTERVAL) for channel in _FROM_TICK)

    def robot(self, robot: bus.RobotStateMessage) -> None:
        """Add the frames of the robot, and once its shape."""
        self._frames_known = True
        if not self._robot_shown:
            self._robot_shown = True
            self.put(ch.DRAWN_ROBOT, robot.server_time, robot_model(robot.server_time))
        if self._due(ch.DRAWN_FRAMES, robot.server_time, INTERVAL / 2):
            self.put(ch.DRAWN_FRAMES, robot.server_time, transforms(robot))

    def scan(self, sweep: bus.ScanMessage) -> None:
        """Add a sweep."""
        if self._due(ch.DRAWN_SCAN, sweep.server_time):
            self.put(ch.DRAWN_SCAN, sweep.server_time, scan(sweep))

    def event(self, event: bus.NumberedEvent) -> None:
        """Add a line of the log."""
        self.put(ch.DRAWN_LOG, event.server_time, log(event))

    def _is_due(self, channel: ch.Channel, now: float, interval: float) -> bool:
        due = self._next.get(channel.topic, 0.0)
        return not due - 10.0 * interval < now < due - _TOLERANCE  # even earlier: another server with its own clock

    def _due(self, channel: ch.Channel, now: float, interval: float = INTERVAL) -> bool:
        if not self._is_due(channel, now, interval):
            return False
        due = self._next.get(channel.topic, 0.0)
        self._next[channel.topic] = due + interval if due <= now < due + interval else now + interval
        return True

    def put(self, channel: ch.Channel, server_time: float, message: object) -> None:
        """Add a message now, whether or not it is due."""
        self._add(channel, server_time, msgspec.json.encode(message))


_FROM_TICK = (ch.DRAWN_CANDIDATES, ch.PLOTS)


def plots(tick: bus.TickMessage) -> ch.PlotsMessage:
    """The numbers of one period."""
    steps, score, placement = tick.arm, tick.score, tick.placement
    slacks = [[value or 0.0 for value in step.slack] for step in steps if len(step.slack) == 6]
    distances = [step.obstacle_distance for step in steps if step.obstacle_distance is not None]
    costs, chosen = placement.cost, placement.chosen
    return ch.PlotsMessage(
        time=tick.time,
        run=tick.run,
        index=tick.index,
        speed=round(tick.robot.twist[0], _PLOT_DIGITS),
        yaw_rate=round(tick.robot.twist[1], _PLOT_DIGITS),
        acceleration=round(tick.plan.acceleration[0], _PLOT_DIGITS),
        joint_rate=round(max((abs(rate) for rate in tick.robot.dq), default=0.0), _PLOT_DIGITS),
        gripper_width=round(tick.robot.gripper_width, _PLOT_DIGITS),
        path_length=_known(None if score is None else score.path_length),
        manipulability=_known(steps[-1].manipulability if steps else None),
        position_slack=_known(max((math.hypot(*slack[:3]) for slack in slacks), default=None)),
        turn_slack=_known(max((math.hypot(*slack[3:]) for slack in slacks), default=None)),
        obstacle_distance=_known(min(distances, default=None)),
        base_clearance=_known(None if score is None else score.min_base_clearance),
        chosen_cost=_known(costs[chosen] if 0 <= chosen < len(costs) else None),
        period_ms=_known(tick.stage_ms.get("period")),
        plan_ms=_known(tick.stage_ms.get("plan")),
        expansions=tick.plan.expansions,
        stopped=bool(tick.stop_reason),
    )


def _known(value: float | None) -> float | msgspec.UnsetType:
    return msgspec.UNSET if value is None else round(value, _PLOT_DIGITS)
