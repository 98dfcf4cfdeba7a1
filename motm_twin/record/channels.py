"""The topics of a recording, with their JSON Schemas: our own messages, and those that Foxglove and Lichtblick draw.

Both viewers choose how to draw a topic by the well-known name of its schema, and read only the fields that it lists.
"""

import functools
from dataclasses import dataclass
from typing import Any

import msgspec

from motm_twin.bus import messages as bus
from motm_twin.model.scene import Scene
from motm_twin.sessions.session import Session

RECORDED_SESSION_VERSION = "motm.recorded_session/1"
RECORDED_GRID_VERSION = "motm.recorded_grid/1"
PLOTS_VERSION = "motm.plots/1"
Maybe = float | msgspec.UnsetType
Json = dict[str, Any]


class RecordedSession(msgspec.Struct, frozen=True, kw_only=True):
    """The session of a run as sent by the server: everything that repeats the run until then."""

    version: str = RECORDED_SESSION_VERSION
    run: int
    began: float  # [s] server time of the load or reset, as in the ticks
    session: Session


class RecordedScene(msgspec.Struct, frozen=True, kw_only=True):
    """The resolved scene, as the server sent it."""

    scene: Scene


class RecordedGrid(msgspec.Struct, frozen=True, kw_only=True):
    """A map, as the server sent it: the attachment, and the cells (see its ``encoding``) in base64."""

    version: str = RECORDED_GRID_VERSION
    info: bus.GridInfo
    cells: bytes


class PlotsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The numbers of a period to plot; missing ones are left out."""

    version: str = PLOTS_VERSION
    time: float  # [s] simulated
    run: int
    index: int
    speed: float  # forward [m/s]
    yaw_rate: float  # [rad/s]
    acceleration: float  # planned, forward [m/s^2]
    joint_rate: float  # largest of the arm [rad/s]
    gripper_width: float  # [m]
    path_length: Maybe = msgspec.UNSET  # [m] driven so far
    manipulability: Maybe = msgspec.UNSET
    position_slack: Maybe = msgspec.UNSET  # largest of the period [m/s]
    turn_slack: Maybe = msgspec.UNSET  # [rad/s]
    obstacle_distance: Maybe = msgspec.UNSET  # [m] gripper to the nearest seen obstacle
    base_clearance: Maybe = msgspec.UNSET  # [m] least so far, by the referee
    chosen_cost: Maybe = msgspec.UNSET  # [s] of the chosen base pose
    period_ms: Maybe = msgspec.UNSET  # [ms] of wall time
    plan_ms: Maybe = msgspec.UNSET
    expansions: int
    stopped: bool


@dataclass(frozen=True)
class Channel:
    """One topic."""

    topic: str
    schema_name: str
    struct: Any = None  # ours: the type of its messages
    schema: Json | None = None  # of topics without a struct

    @functools.cached_property
    def json_schema(self) -> bytes:
        """The schema as it is stored."""
        return msgspec.json.encode(schema_of(self.struct) if self.schema is None else self.schema)


CHANNELS: dict[str, Channel] = {}


def _ours(topic: str, schema_name: str, struct: Any) -> Channel:
    return CHANNELS.setdefault(topic, Channel(topic, schema_name, struct))


def _drawn(topic: str, schema_name: str, fields: str) -> Channel:
    return CHANNELS.setdefault(topic, Channel(topic, schema_name, schema=_object(schema_name, fields)))


_NUMBER: Json = {"type": "number"}
_COUNT: Json = {"type": "integer", "minimum": 0}
_STRING: Json = {"type": "string"}
_NANOSECONDS: Json = {"type": "integer", "minimum": 0, "maximum": 999_999_999}
_OTHER: Json = {"type": "object"}  # schema of a primitive that is never drawn here
_TYPES: dict[str, Json] = {  # schema of a field by its name
    **dict.fromkeys(("x", "y", "z", "w", "r", "g", "b", "a", "bottom_scale", "top_scale"), _NUMBER),
    **dict.fromkeys(("start_angle", "end_angle"), _NUMBER),
    **dict.fromkeys(("column_count", "row_stride", "cell_stride", "offset", "line"), _COUNT),
    **dict.fromkeys(("frame_id", "parent_frame_id", "child_frame_id", "id", "name", "message", "file"), _STRING),
}


def _object(title: str, names: str = "", **properties: Json) -> Json:
    """A schema with these properties; ``names``: names in `_TYPES`, which come first."""
    return {"title": title, "type": "object", "properties": {name: _TYPES[name] for name in names.split()} | properties}


def _array(items: Json) -> Json:
    return {"type": "array", "items": items}


def _choice(title: str, *names: str) -> Json:
    """An enumeration: each name stands for its index."""
    return {"title": title, "oneOf": [{"title": name, "const": number} for number, name in enumerate(names)]}


_TYPES["timestamp"] = _object("time", sec=_COUNT, nsec=_NANOSECONDS)
_TYPES["lifetime"] = _object("duration", sec={"type": "integer"}, nsec=_NANOSECONDS)
_TYPES["size"] = _TYPES["position"] = _TYPES["translation"] = _object("foxglove.Vector3", "x y z")
_TYPES["orientation"] = _TYPES["rotation"] = _object("foxglove.Quaternion", "x y z w")
_TYPES["pose"] = _object("foxglove.Pose", "position orientation")
_TYPES["color"] = _object("foxglove.Color", "r g b a")
_TYPES["points"] = _array(_object("foxglove.Point3", "x y z"))
_TYPES["colors"], _TYPES["indices"] = _array(_TYPES["color"]), _array(_COUNT)
_TYPES["frame_locked"] = {"type": "boolean"}
_TYPES["metadata"] = _array(_object("foxglove.KeyValuePair", key=_STRING, value=_STRING))
_TYPES["arrows"] = _TYPES["lines"] = _TYPES["texts"] = _TYPES["models"] = _array(_OTHER)
_TYPES["cubes"] = _array(_object("foxglove.CubePrimitive", "pose size color"))
_TYPES["spheres"] = _array(_object("foxglove.SpherePrimitive", "pose size color"))
_TYPES["cylinders"] = _array(_object("foxglove.CylinderPrimitive", "pose size bottom_scale top_scale color"))
_TYPES["triangles"] = _array(_object("foxglove.TriangleListPrimitive", "pose points color colors indices"))
_TYPES["cell_size"] = _object("foxglove.Vector2", "x y")
_TYPES["data"] = {"type": "string", "contentEncoding": "base64"}
_TYPES["ranges"] = _TYPES["intensities"] = _array(_NUMBER)
_TYPES["level"] = _choice("foxglove.LogLevel", "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")
_DELETED = _choice("foxglove.SceneEntityDeletionType", "MATCHING_ID", "ALL")
_DELETION = _object("foxglove.SceneEntityDeletion", "timestamp", type=_DELETED, id=_STRING)
_ENTITY = _object(
    "foxglove.SceneEntity",
    "timestamp frame_id id lifetime frame_locked metadata arrows cubes spheres cylinders lines triangles texts models",
)
_TRANSFORM = _object("foxglove.FrameTransform", "timestamp parent_frame_id child_frame_id translation rotation")
_NUMERIC = ("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64")
_FIELD = _object("foxglove.PackedElementField", "name offset", type=_choice("foxglove.NumericType", *_NUMERIC))
_TYPES["deletions"], _TYPES["entities"], _TYPES["fields"] = _array(_DELETION), _array(_ENTITY), _array(_FIELD)
_TYPES["transforms"], _TYPES["poses"] = _array(_TRANSFORM), _array(_TYPES["pose"])

TICK = _ours("/motm/tick", "motm.Tick", bus.TickMessage)
STATUS = _ours("/motm/status", "motm.Status", bus.StatusMessage)
SCENE = _ours("/motm/scene", "motm.Scene", RecordedScene)
GRID = _ours("/motm/grid", "motm.Grid", RecordedGrid)
ROBOT = _ours("/motm/robot", "motm.Robot", bus.RobotStateMessage)
SCAN = _ours("/motm/scan", "motm.Scan", bus.ScanMessage)
EVENT = _ours("/motm/event", "motm.Event", bus.NumberedEvent)
OBSERVATIONS = _ours("/motm/observations", "motm.Observations", bus.ObservationsMessage)
METRICS = _ours("/motm/metrics", "motm.Metrics", bus.MetricsMessage)
SESSION = _ours("/motm/session", "motm.Session", RecordedSession)
PLOTS = _ours("/motm/plots", "motm.Plots", PlotsMessage)
_SCENE_UPDATE = ("foxglove.SceneUpdate", "deletions entities")
_POSES = ("foxglove.PosesInFrame", "timestamp frame_id poses")
_CELLS = "timestamp frame_id pose column_count cell_size row_stride cell_stride fields data"
_SWEEP = "timestamp frame_id pose start_angle end_angle ranges intensities"
DRAWN_FRAMES = _drawn("/tf", "foxglove.FrameTransforms", "transforms")
DRAWN_ROBOT = _drawn("/robot_model", *_SCENE_UPDATE)
DRAWN_FURNITURE = _drawn("/furniture", *_SCENE_UPDATE)
DRAWN_BODIES = _drawn("/bodies", *_SCENE_UPDATE)
DRAWN_CANDIDATES = _drawn("/candidates", *_SCENE_UPDATE)
DRAWN_GRID = _drawn("/grid", "foxglove.Grid", _CELLS)
DRAWN_SCAN = _drawn("/scan", "foxglove.LaserScan", _SWEEP)
DRAWN_GLOBAL = _drawn("/path/global", *_POSES)
DRAWN_NEXT = _drawn("/path/next", *_POSES)
DRAWN_LOCAL = _drawn("/path/local", *_POSES)
DRAWN_LOG = _drawn("/log", "foxglove.Log", "timestamp level message name file line")


def schema_of(struct: Any) -> Json:
    """JSON Schema of one of our messages, in a form that Foxglove and Lichtblick take.

    They read only ``type`` and ``properties``, refuse references there, and support neither null nor lists of lists. So
    the fields that they understand come first, and the whole schema follows under ``allOf``, which they ignore.
    """
    (whole,), definitions = msgspec.json.schema_components([struct], ref_template="#/$defs/{name}")
    name = whole["$ref"].rsplit("/", 1)[-1]
    root = definitions[name]
    properties = {key: shown for key, part in root["properties"].items() if (shown := _shown(part, definitions))}
    return {"title": name, "type": "object", "properties": properties, "allOf": [whole], "$defs": definitions}


def _shown(part: Json, definitions: Json) -> Json | None:
    """The part of a schema that viewers understand; None when there is no such part."""
    if "$ref" in part:
        part = definitions[part["$ref"].rsplit("/", 1)[-1]]
    kind = part.get("type")
    if kind in ("number", "integer", "string", "boolean"):
        return {"type": kind}
    if kind == "array" and isinstance(part.get("items"), dict):
        items = _shown(part["items"], definitions)
        return None if items is None or items["type"] == "array" else {"type": "array", "items": items}
    if kind == "object" and "properties" in part:
        inner = {key: shown for key, value in part["properties"].items() if (shown := _shown(value, definitions))}
        return {"type": "object", "properties": inner}
    return None
