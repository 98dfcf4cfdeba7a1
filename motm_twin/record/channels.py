"""The topics of a recording, with their JSON Schemas."""

import functools
from dataclasses import dataclass
from typing import Any

import msgspec

from motm_twin.bus import messages as bus
from motm_twin.bus.encode import ObservationsMessage
from motm_twin.model.scene import Scene
from motm_twin.record import foxglove as drawn
from motm_twin.sessions.session import Session

RECORDED_SESSION_VERSION = "motm.recorded_session/1"
RECORDED_GRID_VERSION = "motm.recorded_grid/1"
PLOTS_VERSION = "motm.plots/1"
Maybe = float | msgspec.UnsetType


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
    schema: dict[str, Any] | None = None  # of others

    def json_schema(self) -> bytes:
        """The schema as it is stored."""
        return _encoded(self.topic)


CHANNELS: dict[str, Channel] = {}


def _ours(topic: str, schema_name: str, struct: Any) -> Channel:
    return CHANNELS.setdefault(topic, Channel(topic, schema_name, struct))


def _drawn(topic: str, schema: dict[str, Any]) -> Channel:
    return CHANNELS.setdefault(topic, Channel(topic, schema["title"], schema=schema))


TICK = _ours("/motm/tick", "motm.Tick", bus.TickMessage)
STATUS = _ours("/motm/status", "motm.Status", bus.StatusMessage)
SCENE = _ours("/motm/scene", "motm.Scene", RecordedScene)
GRID = _ours("/motm/grid", "motm.Grid", RecordedGrid)
ROBOT = _ours("/motm/robot", "motm.Robot", bus.RobotStateMessage)
SCAN = _ours("/motm/scan", "motm.Scan", bus.ScanMessage)
EVENT = _ours("/motm/event", "motm.Event", bus.NumberedEvent)
OBSERVATIONS = _ours("/motm/observations", "motm.Observations", ObservationsMessage)
METRICS = _ours("/motm/metrics", "motm.Metrics", bus.MetricsMessage)
SESSION = _ours("/motm/session", "motm.Session", RecordedSession)
PLOTS = _ours("/motm/plots", "motm.Plots", PlotsMessage)
DRAWN_FRAMES = _drawn("/tf", drawn.FRAME_TRANSFORMS)
DRAWN_ROBOT = _drawn("/robot_model", drawn.SCENE_UPDATE)
DRAWN_FURNITURE = _drawn("/furniture", drawn.SCENE_UPDATE)
DRAWN_BODIES = _drawn("/bodies", drawn.SCENE_UPDATE)
DRAWN_CANDIDATES = _drawn("/candidates", drawn.SCENE_UPDATE)
DRAWN_GRID = _drawn("/grid", drawn.GRID)
DRAWN_SCAN = _drawn("/scan", drawn.LASER_SCAN)
DRAWN_GLOBAL = _drawn("/path/global", drawn.POSES_IN_FRAME)
DRAWN_NEXT = _drawn("/path/next", drawn.POSES_IN_FRAME)
DRAWN_LOCAL = _drawn("/path/local", drawn.POSES_IN_FRAME)
DRAWN_LOG = _drawn("/log", drawn.LOG)


@functools.cache
def _encoded(topic: str) -> bytes:
    channel = CHANNELS[topic]
    return msgspec.json.encode(channel.schema if channel.schema is not None else schema_of(channel.struct))


@functools.cache
def schema_of(struct: Any) -> dict[str, Any]:
    """JSON Schema of one of our messages, in a form that Foxglove and Lichtblick take.

    They read only ``type`` and ``properties``, refuse references there, and know no null or lists of lists. So the
    fields that they understand come first, and the whole schema follows under ``allOf``, which they ignore.
    """
    (whole,), definitions = msgspec.json.schema_components([struct], ref_template="#/$defs/{name}")
    name = whole["$ref"].rsplit("/", 1)[-1]
    root = definitions[name]
    properties = {key: shown for key, part in root["properties"].items() if (shown := _shown(part, definitions))}
    return {"title": name, "type": "object", "properties": properties, "allOf": [whole], "$defs": definitions}


def _shown(part: dict[str, Any], definitions: dict[str, Any]) -> dict[str, Any] | None:
    """The part of a schema that viewers understand; None when there is nothing of it."""
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
