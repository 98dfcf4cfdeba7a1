"""JSON Schemas of everything that travels on Zenoh, made from the types that encode and decode it."""

import contextlib
import functools
import inspect
import re
import textwrap
from typing import Any

import msgspec

from motm_twin.bus.commands import ANSWER_VERSION, COMMAND_VERSION, EDITS, SERVER_COMMANDS, Answer, Envelope
from motm_twin.bus.messages import (
    EVENT_VERSION,
    EVENTS_VERSION,
    GRID_VERSION,
    METRICS_VERSION,
    ROBOT_VERSION,
    SCAN_VERSION,
    SCENE_VERSION,
    SESSION_INFO_VERSION,
    STATUS_VERSION,
    TICK_VERSION,
    EventsMessage,
    GridInfo,
    MetricsMessage,
    NumberedEvent,
    RobotStateMessage,
    ScanMessage,
    SessionInfo,
    StatusMessage,
    TickMessage,
)
from motm_twin.model.bounds import bounds_of
from motm_twin.model.scene import Scene
from motm_twin.record.observations import OBSERVATIONS_VERSION, ObservationsMessage
from motm_twin.record.session import SESSION_VERSION, Session

DIALECT = "https://json-schema.org/draft/2020-12/schema"

MESSAGES: dict[str, tuple[str, type[msgspec.Struct]]] = {
    "tick": (TICK_VERSION, TickMessage),
    "robot": (ROBOT_VERSION, RobotStateMessage),
    "scan": (SCAN_VERSION, ScanMessage),
    "grid": (GRID_VERSION, GridInfo),  # of the attachment
    "observations": (OBSERVATIONS_VERSION, ObservationsMessage),  # of an external robot
    "event": (EVENT_VERSION, NumberedEvent),
    "events": (EVENTS_VERSION, EventsMessage),  # answer to event?from=SEQ
    "metrics": (METRICS_VERSION, MetricsMessage),
    "status": (STATUS_VERSION, StatusMessage),
    "scene": (SCENE_VERSION, Scene),
    "session": (SESSION_VERSION, Session),
    "session_info": (SESSION_INFO_VERSION, SessionInfo),  # of the attachment
    "command": (COMMAND_VERSION, Envelope),  # payload of every command
    "answer": (ANSWER_VERSION, Answer),  # to every command
}
COMMANDS = {f"cmd/{kind.__struct_config__.tag}": kind for kind in (*SERVER_COMMANDS, *EDITS)}

_FIELD = re.compile(r"^(\w+): .*?  # (.+)$")


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of a message, or of ``cmd/<type>``: the ``command`` in the envelope. Raises KeyError."""
    if name in COMMANDS:
        return schema_of(COMMANDS[name], COMMAND_VERSION)
    version, kind = MESSAGES[name]
    return schema_of(kind, version)


def names() -> list[str]:
    """Of all schemas."""
    return [*MESSAGES, *COMMANDS]


def file_name(name: str) -> str:
    """File in ``docs/schemas`` that keeps the schema of a message in its version: "tick.1.json"."""
    return f"{name}.{MESSAGES[name][0].rsplit('/', 1)[-1]}.json"


def field_notes(kind: type[msgspec.Struct]) -> dict[str, str]:
    """The bounds of the fields of a struct and the comments beside them, which are missing where there is no source."""
    notes = {name: [bound.allowed() for bound in found] for name, found in bounds_of(kind).items()}
    for name, comment in _comments(kind).items():
        notes.setdefault(name, []).append(comment)
    return {name: "; ".join(parts) for name, parts in notes.items()}


def _comments(kind: type) -> dict[str, str]:
    comments: dict[str, str] = {}
    for each in reversed(kind.__mro__):
        with contextlib.suppress(OSError, TypeError):
            lines = textwrap.dedent(inspect.getsource(each)).splitlines()
            comments |= {match[1]: match[2] for line in lines if (match := _FIELD.match(line.strip()))}
    return comments


def schema_of(kind: type[msgspec.Struct], version: str) -> dict[str, Any]:
    """The schema of a struct under this ``$id``, with what the comments beside all fields say."""
    made = msgspec.json.decode(msgspec.json.encode(msgspec.json.schema(kind)))  # as its readers get it: no tuples
    kinds = _structs(kind, {})
    for name, part in made.get("$defs", {}).items():
        notes = field_notes(kinds[name]) if name in kinds else {}
        for field, about in part.get("properties", {}).items():
            if field in notes:
                about["description"] = notes[field]
    return {"$schema": DIALECT, "$id": version, **made}


def _structs(kind: Any, found: dict[str, type]) -> dict[str, type]:
    """Every struct that a type leads to, by name."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        if kind.__name__ not in found:
            found[kind.__name__] = kind
            for field in msgspec.structs.fields(kind):
                _structs(field.type, found)
    else:
        for part in getattr(kind, "__args__", ()):
            _structs(part, found)
    return found
