"""JSON Schemas of all messages on Zenoh, made from the types that encode and decode them.

A version allows some changes of a schema (`breaking_changes`): a field or a kind may be added; nothing may go or become
another type. A program written for one version keeps working: it reads every field that it knows, and the server
takes every command that it sends. So a field added to a command must be optional.
"""

import contextlib
import functools
import inspect
import re
import textwrap
from typing import Any

import msgspec

from motm_twin.bus.commands import ANSWER_VERSION, COMMAND_VERSION, EDITS, SERVER_COMMANDS, Answer, Envelope
from motm_twin.bus.encode import OBSERVATIONS_VERSION, ObservationsMessage
from motm_twin.bus.messages import (
    EVENT_VERSION,
    EVENTS_VERSION,
    GRID_VERSION,
    METRICS_VERSION,
    ROBOT_VERSION,
    SCAN_VERSION,
    SCENE_INFO_VERSION,
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
    SceneInfo,
    SessionInfo,
    StatusMessage,
    TickMessage,
)
from motm_twin.bus.plant_messages import (
    VERSION,
    ClockGrant,
    ClockReached,
    DetectionList,
    EditRequest,
    Info,
    PlantAnswer,
    ResetRequest,
    RobotCommand,
    RobotState,
    ScanData,
    TaskNotice,
    TruthData,
)
from motm_twin.model.bounds import bounds_of
from motm_twin.model.scene import Scene
from motm_twin.sessions.session import SESSION_VERSION, Session

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
    "scene_info": (SCENE_INFO_VERSION, SceneInfo),  # of the attachment
    "session": (SESSION_VERSION, Session),
    "session_info": (SESSION_INFO_VERSION, SessionInfo),  # of the attachment
    "command": (COMMAND_VERSION, Envelope),  # payload of every command
    "answer": (ANSWER_VERSION, Answer),  # to every command
}
PLANT_MESSAGES: dict[
    str, tuple[str, type[msgspec.Struct]]
] = {  # of the keys below ``plant/``, and the answer to a request
    f"plant/{name}": (f"{VERSION}/{name}", kind)
    for name, kind in (
        ("info", Info),
        ("state", RobotState),
        ("scan", ScanData),
        ("detections", DetectionList),
        ("command", RobotCommand),
        ("clock", ClockReached),
        ("grant", ClockGrant),
        ("truth", TruthData),
        ("reset", ResetRequest),
        ("edit", EditRequest),
        ("tasks", TaskNotice),
        ("answer", PlantAnswer),
    )
}
COMMANDS = {f"cmd/{kind.__struct_config__.tag}": kind for kind in (*SERVER_COMMANDS, *EDITS)}
_FIELD = re.compile(r"^(\w+): .*?  # (.+)$")
Schema = dict[str, Any]
_WORDS = {"description", "title", "$schema", "$id"}  # annotations without effect on validity
_COMPARED = {"properties", "required", "$defs", "anyOf", "enum", "items", "prefixItems", "discriminator"}


@functools.cache
def schema(name: str) -> dict[str, Any]:
    """The schema of a message, or of ``cmd/<type>``: the ``command`` in the envelope. Raises KeyError."""
    if name in COMMANDS:
        return schema_of(COMMANDS[name], COMMAND_VERSION)
    version, kind = {**MESSAGES, **PLANT_MESSAGES}[name]
    return schema_of(kind, version)


def names() -> list[str]:
    """Of all schemas."""
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
    made = msgspec.json.decode(msgspec.json.encode(msgspec.json.schema(kind)))  # as its readers get it: no tuples
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


def breaking_changes(old: Schema, new: Schema, place: str = "") -> list[str]:
    """Changes from ``old`` to ``new`` that need another version, one sentence each; [] when there are none."""
    problems = _by_name(old, new, "$defs", place) + _by_name(old, new, "properties", place) + _required(old, new, place)
    problems += _options(old, new, place) + _enum(old, new, place) + _items(old, new, place)
    for word in sorted((old.keys() | new.keys()) - _WORDS - _COMPARED):
        before, after = old.get(word), new.get(word)
        if word == "default" and isinstance(before, dict) and isinstance(after, dict):
            after = {name: value for name, value in after.items() if name in before}  # the others are of added fields
        if isinstance(before, dict) and isinstance(after, dict):
            problems += breaking_changes(before, after, f"{place}/{word}")
        elif before != after:
            problems.append(f"{place or '/'}: {word!r} was {before!r} and is {after!r}")
    return problems


def _by_name(old: Schema, new: Schema, word: str, place: str) -> list[str]:
    problems, now = [], new.get(word, {})
    for name, part in old.get(word, {}).items():
        if name in now:
            problems += breaking_changes(part, now[name], f"{place}/{name}")
        else:
            problems.append(f"{place}/{name}: was removed")
    return problems


def _required(old: Schema, new: Schema, place: str) -> list[str]:
    known, before, after = set(old.get("properties", {})), set(old.get("required", [])), set(new.get("required", []))
    problems = [f"{place}/{name}: was always there, and is no more" for name in sorted(before - after)]
    problems += [f"{place}/{name}: was optional, and is required" for name in sorted((after - before) & known)]
    if new.get("additionalProperties") is False:  # strictly read by us: others send it
        added = sorted(after - known) if "properties" in old else []
        problems += [f"{place}/{name}: was added as a required field of what programs send" for name in added]
    return problems


def _options(old: Schema, new: Schema, place: str) -> list[str]:
    """Kinds of a union: structs may be added, other types not (a number does not become null)."""
    before, after = old.get("anyOf", []), new.get("anyOf", [])
    if not before and not after:
        return []
    problems = [f"{place}: no longer {_shown(option)}" for option in before if option not in after]
    if not before:
        return [f"{place}: became one of several types"]
    problems += [
        f"{place}: may now be {_shown(option)}" for option in after if option not in before and "$ref" not in option
    ]
    return problems


def _enum(old: Schema, new: Schema, place: str) -> list[str]:
    if ("enum" in old) != ("enum" in new):
        return [f"{place}: became {'one of a list' if 'enum' in new else 'free'}"]
    return [f"{place}: no longer {value!r}" for value in old.get("enum", []) if value not in new["enum"]]


def _items(old: Schema, new: Schema, place: str) -> list[str]:
    problems = []
    if isinstance(old.get("items"), dict) and isinstance(new.get("items"), dict):
        problems += breaking_changes(old["items"], new["items"], f"{place}[]")
    elif old.get("items") != new.get("items"):
        problems.append(f"{place}: its items were {old.get('items')!r} and are {new.get('items')!r}")
    before, after = old.get("prefixItems", []), new.get("prefixItems", [])
    if len(before) != len(after):
        return [*problems, f"{place}: had {len(before)} items and has {len(after)}"]
    for number, (one, other) in enumerate(zip(before, after, strict=True)):
        problems += breaking_changes(one, other, f"{place}[{number}]")
    return problems


def _shown(option: Schema) -> str:
    return str(option.get("$ref", option.get("type", option))).rsplit("/", 1)[-1]
