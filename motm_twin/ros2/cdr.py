"""CDR, the encoding of ROS 2 messages: version 1, little endian, behind a header of four bytes.

A message is a dict by field name, nested messages are dicts too. Sequences of numbers may be anything that NumPy takes.
Encoders and decoders are made once from the table in `definitions`.
"""

import struct
from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from motm_twin.ros2.definitions import DEFINITIONS, NONE, SEQUENCE, Field, fields

HEADER = b"\x00\x01\x00\x00"  # CDR, little endian
_BIG_ENDIAN = b"\x00\x00"
_LITTLE_ENDIAN = b"\x00\x01"
_PADDING = 3  # bytes that may follow a message
_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip
_DTYPES = {"bool": "?", "float32": "f4", "float64": "f8", "int8": "i1", "uint8": "u1"}

Message = dict[str, Any]
Write = Callable[[bytearray, Any], None]
Read = Callable[["_Reader"], Any]


class CdrError(ValueError):
    """Bytes that are no message of the type, or values that do not fit it."""


def encode(message: str, value: Message) -> bytes:
    """The bytes of a message of the given type ("std_msgs/msg/String"). Raises CdrError."""
    out = bytearray()
    try:
        _writer(message)(out, value)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, struct.error) as error:
        raise CdrError(f"{message}: {type(error).__name__}: {error}") from error
    return HEADER + bytes(out)


def decode(message: str, data: bytes) -> Message:
    """A message of the given type from its bytes, of either byte order. Raises CdrError."""
    if len(data) < len(HEADER) or data[:2] not in (_LITTLE_ENDIAN, _BIG_ENDIAN):
        raise CdrError(f"{message}: no CDR header of version 1")
    reader = _Reader(data[4:], "<" if data[:2] == _LITTLE_ENDIAN else ">")
    value = _reader(message)(reader)
    if len(reader.data) - reader.at > _PADDING:
        raise CdrError(f"{message}: {len(reader.data) - reader.at} bytes too many")
    return value


@cache
def _writer(base: str) -> Write:
    """Function that appends one value of a type."""
    if base == "string":
        return _write_string
    if base not in DEFINITIONS:
        return _write_number(base)
    kind = _flat(base)
    if kind is not None:
        return _write_flat(base, kind)
    members = [(field.name, _field_writer(field)) for field in fields(base)]

    def write(out: bytearray, value: Message) -> None:
        for name, member in members:
            member(out, value[name])

    return write


def _field_writer(field: Field) -> Write:
    if field.count == NONE:
        return _writer(field.base)
    if field.base in _DTYPES:
        return _write_numbers(field.base, field.count)
    element, length, fixed = _writer(field.base), _writer("uint32"), field.count

    def write(out: bytearray, values: Any) -> None:
        if fixed == SEQUENCE:
            length(out, len(values))
        elif len(values) != fixed:
            raise CdrError(f"{field.name}: {len(values)} elements, {fixed} are needed")
        for value in values:
            element(out, value)

    return write


def _write_number(base: str) -> Write:
    pack = struct.Struct("<" + _CODES[base])
    size, packed = pack.size, pack.pack

    def write(out: bytearray, value: float) -> None:
        out.extend(bytes(-len(out) % size))
        out.extend(packed(value))

    return write


def _flat(base: str) -> str | None:
    """The one type of all numbers of a message that is nothing but numbers, two levels deep at most; else None."""
    kinds = set()
    for field in fields(base):
        leaves = fields(field.base) if field.base in DEFINITIONS else (field,)
        if field.count != NONE or any(leaf.count != NONE or leaf.base not in _CODES for leaf in leaves):
            return None
        kinds |= {leaf.base for leaf in leaves}
    return kinds.pop() if len(kinds) == 1 else None


def _write_flat(base: str, kind: str) -> Write:
    """All numbers at once: most of what is sent are points and poses."""
    names = [field.name for field in fields(base) if field.base not in DEFINITIONS]
    nested = [(field.name, [f.name for f in fields(field.base)]) for field in fields(base) if field.base in DEFINITIONS]
    if names and nested:
        raise ValueError(f"{base}: numbers beside messages are not written at once")
    count = len(names) + sum(len(inner) for _, inner in nested)
    pack, size = struct.Struct(f"<{count}{_CODES[kind]}").pack, struct.calcsize(_CODES[kind])

    def write_numbers(out: bytearray, value: Message) -> None:
        out.extend(bytes(-len(out) % size))
        out.extend(pack(*[value[name] for name in names]))

    def write_nested(out: bytearray, value: Message) -> None:
        out.extend(bytes(-len(out) % size))
        out.extend(pack(*[value[outer][name] for outer, inner in nested for name in inner]))

    return write_nested if nested else write_numbers


def _write_string(out: bytearray, value: str) -> None:
    text = value.encode()
    if b"\x00" in text:
        raise CdrError("text with a zero character")
    out.extend(bytes(-len(out) % 4))
    out.extend(struct.pack("<I", len(text) + 1))
    out.extend(text)
    out.append(0)


def _write_numbers(base: str, fixed: int) -> Write:
    dtype, size, length = np.dtype(f"<{_DTYPES[base]}"), struct.calcsize(_CODES[base]), _writer("uint32")

    def write(out: bytearray, values: Any) -> None:
        array = _as(values, dtype)
        if fixed == SEQUENCE:
            length(out, array.size)
        elif array.size != fixed:
            raise CdrError(f"{array.size} numbers, {fixed} are needed")
        if array.size:
            out.extend(bytes(-len(out) % size))
            out.extend(array.tobytes())

    return write


def _as(values: Any, dtype: np.dtype) -> np.ndarray:
    """Numbers in the type of the wire; raises CdrError when whole numbers do not fit."""
    array = np.asarray(values)
    if array.dtype == dtype:
        return array
    cast = array.astype(dtype)
    if dtype.kind in "iu" and not np.array_equal(cast, array):
        raise CdrError(f"numbers that do not fit {dtype}")
    return cast


class _Reader:
    """Bytes after the header, and how far they have been read."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data, self.order, self.at = data, order, 0

    def take(self, size: int, alignment: int) -> bytes:
        """The next bytes, from the next multiple of ``alignment`` on."""
        start = self.at + (-self.at % alignment)
        end = start + size
        if end > len(self.data):
            raise CdrError(f"{len(self.data)} bytes, at least {end} are needed")
        self.at = end
        return self.data[start:end]


@cache
def _reader(base: str) -> Read:
    """Function that reads one value of a type."""
    if base == "string":
        return _read_string
    if base not in DEFINITIONS:
        return _read_number(base)
    members = [(field.name, _field_reader(field)) for field in fields(base)]
    return lambda reader: {name: member(reader) for name, member in members}


def _field_reader(field: Field) -> Read:
    element, length, fixed = _reader(field.base), _reader("uint32"), field.count
    if fixed == NONE:
        return element

    def read(reader: _Reader) -> list:
        count = length(reader) if fixed == SEQUENCE else fixed
        if count > len(reader.data) - reader.at:  # every element has a byte at least
            raise CdrError(f"{field.name}: {count} elements in {len(reader.data) - reader.at} bytes")
        return [element(reader) for _ in range(count)]

    return read


def _read_number(base: str) -> Read:
    code = _CODES[base]
    size = struct.calcsize(code)
    return lambda reader: struct.unpack(reader.order + code, reader.take(size, size))[0]


def _read_string(reader: _Reader) -> str:
    length = _reader("uint32")(reader)
    text = reader.take(length, 1)
    if text and text[-1]:
        raise CdrError("text without its end")
    try:
        return text[:-1].decode()
    except UnicodeDecodeError as error:
        raise CdrError(f"text that is no UTF-8: {error}") from error
