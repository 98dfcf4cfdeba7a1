"""JSON Schemas of all messages on Zenoh, made from the types that encode and decode them.

A version allows some changes of a schema (`breaking_changes` of tools/schemas.py): a field or a kind may be added;
nothing may go or become another type. A program written for one version keeps working: it reads every field that it
knows, and the server takes every command that it sends. So a field added to a command must be optional.
"""

import contextlib
import functools
import inspect
import re
import textwrap
from typing import Any

import msgspec

from motm_twin.bus import messages, plant_messages
from motm_twin.bus.commands import ANSWER_VERSION, COMMAND_VERSION, EDITS, SERVER_COMMANDS, Answer, Envelope
from motm_twin.model.bounds import bounds_of
from motm_twin.model.scene import Scene
from motm_twin.sessions.session import SESSION_VERSION, Session

DIALECT = "https://json-schema.org/draft/2020-12/schema"
MESSAGES: dict[str, tuple[str, type[msgspec.Struct]]] = {
    "tick": (messages.TICK_VERSION, messages.TickMessage),
    "robot": (messages.ROBOT_VERSION, messages.RobotStateMessage),
    "scan": (messages.SCAN_VERSION, messages.ScanMessage),
    "grid": (messages.GRID_VERSION, messages.GridInfo),  # of the attachment
    "observations": (messages.OBSERVATIONS_VERSION, messages.ObservationsMessage),  # of an external robot
    "event": (messages.EVENT_VERSION, messages.NumberedEvent),
    "events": (messages.EVENTS_VERSION, messages.EventsMessage),  # answer to event?from=SEQ
    "metrics": (messages.METRICS_VERSION, messages.MetricsMessage),
    "status": (messages.STATUS_VERSION, messages.StatusMessage),
    "scene": (messages.SCENE_VERSION, Scene),
    "scene_info": (messages.SCENE_INFO_VERSION, messages.SceneInfo),  # of the attachment
    "session": (SESSION_VERSION, Session),
    "session_info": (messages.SESSION_INFO_VERSION, messages.SessionInfo),  # of the attachment
    "command": (COMMAND_VERSION, Envelope),  # payload of every command
    "answer": (ANSWER_VERSION, Answer),  # to every command
}
# Messages on the keys below ``plant/``, and the answer to a request.
PLANT_MESSAGES: dict[str, tuple[str, type[msgspec.Struct]]] = {
    f"plant/{name}": (f"{plant_messages.VERSION}/{name}", kind)
    for name, kind in (
        ("info", plant_messages.Info),
        ("state", plant_messages.RobotState),
        ("scan", plant_messages.ScanData),
        ("detections", plant_messages.DetectionList),
        ("command", plant_messages.RobotCommand),
        ("clock", plant_messages.ClockReached),
        ("grant", plant_messages.ClockGrant),
        ("truth", plant_messages.TruthData),
        ("reset", plant_messages.ResetRequest),
        ("edit", plant_messages.EditRequest),
        ("tasks", plant_messages.TaskNotice),
        ("answer", plant_messages.PlantAnswer),
    )
}
COMMANDS = {f"cmd/{kind.__struct_config__.tag}": kind for kind in (*SERVER_COMMANDS, *EDITS)}
_FIELD = re.compile(r"^(\w+): .*?  # (.+)$")


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of a message, or of ``cmd/<type>``: the ``command`` in the envelope. Raises KeyError."""
    if name in COMMANDS:
        return schema_of(COMMANDS[name], COMMAND_VERSION)
    version, kind = {**MESSAGES, **PLANT_MESSAGES}[name]
    return schema_of(kind, version)


def names() -> list[str]:
    """Names of all schemas."""
    return [*MESSAGES, *COMMANDS, *PLANT_MESSAGES]


def file_name(name: str) -> str:
    """File in ``docs/schemas`` that keeps the schema of a message in its version: "tick.1.json"."""
    return f"{name}.{schema(name)['$id'].split('/')[1]}.json"


def field_notes(kind: type[msgspec.Struct]) -> dict[str, str]:
    """Bounds of the fields of a struct, and the comments beside them where the source is available."""
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
    """The schema of a struct under this ``$id``, with the comments of its fields as descriptions."""
    made = msgspec.json.decode(msgspec.json.encode(msgspec.json.schema(kind)))  # as readers get it: without tuples
    kinds = _structs(kind, {})
    for name, part in made.get("$defs", {}).items():
        notes = field_notes(kinds[name]) if name in kinds else {}
        for field, about in part.get("properties", {}).items():
            if field in notes:
                about["description"] = notes[field]
    return {"$schema": DIALECT, "$id": version, **made}


def _structs(kind: Any, found: dict[str, type]) -> dict[str, type]:
    """All structs reachable from a type, by name."""
    if isinstance(kind, type) and issubclass(kind, msgspec.Struct):
        if kind.__name__ not in found:
            found[kind.__name__] = kind
            for field in msgspec.structs.fields(kind):
                _structs(field.type, found)
    else:
        for part in getattr(kind, "__args__", ()):
            _structs(part, found)
    return found
