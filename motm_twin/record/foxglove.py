"""From our messages to those that Foxglove and Lichtblick draw. Frames: ``world``, and the links of the robot.

Lengths [m], angles [rad]; times are those of the server, as in the messages of the bus.
"""

import base64
import math
from collections.abc import Iterable, Sequence

from motm_twin.bus.messages import GridInfo, PlacementMessage, RobotStateMessage, ScanMessage, TickMessage
from motm_twin.record.foxglove_shapes import Colour, Json, colour, cube, cylinder, entity, point, pose, stamp

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


def transforms(robot: RobotStateMessage) -> Json:
    """Every frame of the robot in the world."""
    at = stamp(robot.server_time)
    return {"transforms": [_transform(at, name, values[:3], values[3:]) for name, values in robot.frames.items()]}


def base_transform(tick: TickMessage) -> Json:
    """The base alone, from a tick: for servers that send no robot state."""
    x, y, heading = tick.robot.pose
    turn = [math.cos(heading / 2.0), 0.0, 0.0, math.sin(heading / 2.0)]
    return {"transforms": [_transform(stamp(tick.server_time), "base_link", [x, y, 0.0], turn)]}


def scan(message: ScanMessage) -> Json:
    """One sweep in the frame of the world; no return is beyond the range."""
    x, y, heading = message.pose
    ox, oy = message.origin
    c, s = math.cos(heading), math.sin(heading)
    beyond = message.range_max * 10.0
    last = message.angle_min + message.angle_step * max(0, len(message.ranges) - 1)
    return {
        "timestamp": stamp(message.server_time),
        "frame_id": WORLD,
        "pose": pose(x + c * ox - s * oy, y + s * ox + c * oy, 0.2, heading),
        "start_angle": message.angle_min,
        "end_angle": last,
        "ranges": [beyond if value is None else round(value, 3) for value in message.ranges],
        "intensities": [],
    }


def grid(info: GridInfo, cells: bytes, server_time: float) -> Json:
    """The map as bytes: 255 occupied, else 254 times the proximity of something."""
    return {
        "timestamp": stamp(server_time),
        "frame_id": WORLD,
        "pose": pose(info.origin[0], info.origin[1], 0.0),
        "column_count": info.width,
        "cell_size": {"x": info.resolution, "y": info.resolution},
        "row_stride": info.width,
        "cell_stride": 1,
        "fields": [{"name": "proximity", "offset": 0, "type": _UINT8}],
        "data": base64.b64encode(cells).decode(),
    }


def path(points: Iterable[Sequence[float]], server_time: float, height: float = PATH_HEIGHT) -> Json:
    """A path of points x, y (and heading), each pose turned along it."""
    listed = [list(values) for values in points]
    return {
        "timestamp": stamp(server_time),
        "frame_id": WORLD,
        "poses": [pose(values[0], values[1], height, _heading(listed, at)) for at, values in enumerate(listed)],
    }


def bodies(tick: TickMessage) -> Json:
    """Objects, agents and added obstacles as they truly are; whatever was there before is replaced."""
    listed = []
    at = stamp(tick.server_time)
    for group in (tick.objects, tick.agents, tick.obstacles):
        for body in group:
            centred = body.kind == "cube"
            x, y, z = body.position
            middle = (x, y, z if centred else z + 0.5 * body.size[2])
            tint = _BODY_COLOURS.get(body.kind, _OTHER_BODY)
            if body.kind in _KINDS_ROUND:
                listed.append(entity(at, WORLD, body.name, cylinders=[cylinder(middle, body.size, tint, body.yaw)]))
            else:
                listed.append(entity(at, WORLD, body.name, cubes=[cube(middle, body.size, tint, body.yaw)]))
    return {"deletions": [{"timestamp": at, "type": 1, "id": ""}], "entities": listed}


def candidates(placement: PlacementMessage, server_time: float) -> Json:
    """Base poses, cheap ones yellow, dear ones violet, rejected ones grey, the chosen one large."""
    known = [cost for cost in placement.cost if cost is not None]
    least, most = min(known, default=0.0), max(known, default=1.0)
    spheres = []
    for index, (values, cost) in enumerate(zip(placement.poses, placement.cost, strict=True)):
        chosen = index == placement.chosen
        tint = _CHOSEN if chosen else _REJECTED if cost is None else _scale((cost - least) / max(most - least, 1e-9))
        size = CANDIDATE_SIZE * (2.0 if chosen else 1.0 if cost is not None else 0.6)
        spheres.append(
            {"pose": pose(values[0], values[1], PATH_HEIGHT), "size": point(size, size, size), "color": colour(tint)}
        )
    return {"deletions": [], "entities": [entity(stamp(server_time), WORLD, "candidates", spheres=spheres)]}


def log(server_time: float, kind: str, text: str) -> Json:
    """An event as a line of a log."""
    return {
        "timestamp": stamp(server_time),
        "level": _WARNING if kind in _BAD_EVENTS else _INFO,
        "message": text or kind,
        "name": kind,
        "file": "",
        "line": 0,
    }


def _transform(at: Json, child: str, position: Sequence[float], turn: Sequence[float]) -> Json:
    return {
        "timestamp": at,
        "parent_frame_id": WORLD,
        "child_frame_id": child,
        "translation": point(*position),
        "rotation": {"w": turn[0], "x": turn[1], "y": turn[2], "z": turn[3]},
    }


def _heading(points: list[list[float]], at: int) -> float:
    if len(points[at]) > 2:
        return points[at][2]
    if len(points) < 2:
        return 0.0
    one, other = (points[at], points[at + 1]) if at + 1 < len(points) else (points[at - 1], points[at])
    return math.atan2(other[1] - one[1], other[0] - one[0])


def _scale(part: float) -> Colour:
    """0 (cheap) to 1 (dear)."""
    low, high, rest = (_CHEAP, _MIDDLE, 2.0 * part) if part < 0.5 else (_MIDDLE, _DEAR, 2.0 * part - 1.0)
    r, g, b, a = (round(one + (other - one) * rest, 3) for one, other in zip(low, high, strict=True))
    return r, g, b, a
