"""Type hashes of ROS 2 messages (REP 2016, "RIHS01"): rmw_zenoh puts them into its keys since Iron."""

import hashlib
import json
from functools import cache

from motm_twin.ros2.definitions import DEFINITIONS, NONE, SEQUENCE, Field, fields

UNSUPPORTED = "TypeHashNotSupported"  # what rmw_zenoh of Humble, which has no hashes, writes instead
_BASIC = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "bool": 15, "string": 17,
}  # fmt: skip
_NESTED, _ARRAY, _SEQUENCE = 1, 48, 144


@cache
def type_hash(message: str) -> str:
    """``RIHS01_`` and the SHA-256 of the message's description with everything it refers to."""
    described = {
        "type_description": _described(message),
        "referenced_type_descriptions": [_described(name) for name in sorted(_referred(message))],
    }
    text = json.dumps(described, separators=(", ", ": "))
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def _referred(message: str) -> set[str]:
    found: set[str] = set()
    for field in fields(message):
        if field.base in DEFINITIONS:
            found |= {field.base} | _referred(field.base)
    return found


def _described(message: str) -> dict:
    return {"type_name": message, "fields": [{"name": f.name, "type": _type(f)} for f in fields(message)]}


def _type(field: Field) -> dict:
    nested = field.base in DEFINITIONS
    offset = {NONE: 0, SEQUENCE: _SEQUENCE}.get(field.count, _ARRAY)
    return {
        "type_id": (_NESTED if nested else _BASIC[field.base]) + offset,
        "capacity": max(field.count, 0),
        "string_capacity": 0,
        "nested_type_name": field.base if nested else "",
    }
