"""ROS 2 messages as data, and CDR, their encoding: version 1, little endian, behind a header of four bytes.

Fields are in the order of the standard's .msg files, which is the order on the wire. Humble and Jazzy have the same
fields; constants do not travel and are left out. A message is a dict by field name, nested messages are dicts too.
Sequences of numbers may be anything that NumPy takes.
"""

import struct
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np

DEFINITIONS: dict[str, tuple[str, ...]] = {  # a type, and the names of the fields of this type that follow
    "builtin_interfaces/msg/Time": ("int32 sec", "uint32 nanosec"),
    "builtin_interfaces/msg/Duration": ("int32 sec", "uint32 nanosec"),
    "std_msgs/msg/Header": ("builtin_interfaces/msg/Time stamp", "string frame_id"),
    "std_msgs/msg/String": ("string data",),
    "std_msgs/msg/ColorRGBA": ("float32 r g b a",),
    "geometry_msgs/msg/Point": ("float64 x y z",),
    "geometry_msgs/msg/Vector3": ("float64 x y z",),
    "geometry_msgs/msg/Quaternion": ("float64 x y z w",),
    "geometry_msgs/msg/Pose": ("geometry_msgs/msg/Point position", "geometry_msgs/msg/Quaternion orientation"),
    "geometry_msgs/msg/PoseStamped": ("std_msgs/msg/Header header", "geometry_msgs/msg/Pose pose"),
    "geometry_msgs/msg/PoseWithCovariance": ("geometry_msgs/msg/Pose pose", "float64[36] covariance"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "std_msgs/msg/Header header",
        "geometry_msgs/msg/PoseWithCovariance pose",
    ),
    "geometry_msgs/msg/Twist": ("geometry_msgs/msg/Vector3 linear angular",),
    "geometry_msgs/msg/TwistWithCovariance": ("geometry_msgs/msg/Twist twist", "float64[36] covariance"),
    "geometry_msgs/msg/Transform": ("geometry_msgs/msg/Vector3 translation", "geometry_msgs/msg/Quaternion rotation"),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/msg/Header header",
        "string child_frame_id",
        "geometry_msgs/msg/Transform transform",
    ),
    "tf2_msgs/msg/TFMessage": ("geometry_msgs/msg/TransformStamped[] transforms",),
    "rosgraph_msgs/msg/Clock": ("builtin_interfaces/msg/Time clock",),
    "sensor_msgs/msg/JointState": ("std_msgs/msg/Header header", "string[] name", "float64[] position velocity effort"),
    "sensor_msgs/msg/LaserScan": (
        "std_msgs/msg/Header header",
        "float32 angle_min angle_max angle_increment time_increment scan_time range_min range_max",
        "float32[] ranges intensities",
    ),
    "sensor_msgs/msg/CompressedImage": ("std_msgs/msg/Header header", "string format", "uint8[] data"),
    "nav_msgs/msg/Odometry": (
        "std_msgs/msg/Header header",
        "string child_frame_id",
        "geometry_msgs/msg/PoseWithCovariance pose",
        "geometry_msgs/msg/TwistWithCovariance twist",
    ),
    "nav_msgs/msg/Path": ("std_msgs/msg/Header header", "geometry_msgs/msg/PoseStamped[] poses"),
    "nav_msgs/msg/MapMetaData": (
        "builtin_interfaces/msg/Time map_load_time",
        "float32 resolution",
        "uint32 width height",
        "geometry_msgs/msg/Pose origin",
    ),
    "nav_msgs/msg/OccupancyGrid": ("std_msgs/msg/Header header", "nav_msgs/msg/MapMetaData info", "int8[] data"),
    "visualization_msgs/msg/UVCoordinate": ("float32 u v",),
    "visualization_msgs/msg/MeshFile": ("string filename", "uint8[] data"),
    "visualization_msgs/msg/Marker": (
        "std_msgs/msg/Header header",
        "string ns",
        "int32 id type action",
        "geometry_msgs/msg/Pose pose",
        "geometry_msgs/msg/Vector3 scale",
        "std_msgs/msg/ColorRGBA color",
        "builtin_interfaces/msg/Duration lifetime",
        "bool frame_locked",
        "geometry_msgs/msg/Point[] points",
        "std_msgs/msg/ColorRGBA[] colors",
        "string texture_resource",
        "sensor_msgs/msg/CompressedImage texture",
        "visualization_msgs/msg/UVCoordinate[] uv_coordinates",
        "string text mesh_resource",
        "visualization_msgs/msg/MeshFile mesh_file",
        "bool mesh_use_embedded_materials",
    ),
    "visualization_msgs/msg/MarkerArray": ("visualization_msgs/msg/Marker[] markers",),
}

NONE, SEQUENCE = 0, -1  # counts of a field that is no array, and of one of any length


class Field(NamedTuple):
    """One field: ``count`` elements of ``base`` (`NONE`: a single value, `SEQUENCE`: any number)."""

    name: str
    base: str
    count: int


def fields(message: str) -> tuple[Field, ...]:
    """The fields of a message in order; raises KeyError for an unsupported one."""
    found = []
    for line in DEFINITIONS[message]:
        kind, *names = line.split(" ")
        base, is_array, length = kind.removesuffix("]").partition("[")
        count = (int(length) if length else SEQUENCE) if is_array else NONE
        found += [Field(name, base, count) for name in names]
    return tuple(found)


def dds_name(message: str) -> str:
    """``std_msgs/msg/String`` as DDS calls it: ``std_msgs::msg::dds_::String_``."""
    package, kind, name = message.split("/")
    return f"{package}::{kind}::dds_::{name}_"


@cache
def blank(base: str) -> Any:
    """A value of a type with nothing in it: zeros, empty texts and sequences; not to be changed."""
    if base not in DEFINITIONS:
        return "" if base == "string" else 0
    empty = {field.name: blank(field.base) for field in fields(base)}
    return empty | {field.name: [empty[field.name]] * max(0, field.count) for field in fields(base) if field.count}


HEADER = b"\x00\x01\x00\x00"  # CDR, little endian
_BIG_ENDIAN = b"\x00\x00"
_LITTLE_ENDIAN = b"\x00\x01"
_PADDING = 3  # bytes that may follow a message
_CODES = {
    "bool": "?", "int8": "b", "uint8": "B", "int16": "h", "uint16": "H", "int32": "i", "uint32": "I",
    "int64": "q", "uint64": "Q", "float32": "f", "float64": "d",
}  # fmt: skip

Message = dict[str, Any]
Write = Callable[[bytearray, Any], None]
Read = Callable[["_Reader"], Any]


class CdrError(ValueError):
    """Bytes that are not a message of the type, or values that do not fit it."""


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
    if field.base in _CODES:
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

    def write(out: bytearray, value: Message) -> None:
        numbers = [value[name] for name in names]
        for outer, inner in nested:
            numbers += [value[outer][name] for name in inner]
        out.extend(bytes(-len(out) % size))
        out.extend(pack(*numbers))

    return write


def _write_string(out: bytearray, value: str) -> None:
    text = value.encode()
    if b"\x00" in text:
        raise CdrError("text with a zero character")
    out.extend(bytes(-len(out) % 4))
    out.extend(struct.pack("<I", len(text) + 1))
    out.extend(text)
    out.append(0)


def _write_numbers(base: str, fixed: int) -> Write:
    dtype, size, length = np.dtype(f"<{_CODES[base]}"), struct.calcsize(_CODES[base]), _writer("uint32")

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
