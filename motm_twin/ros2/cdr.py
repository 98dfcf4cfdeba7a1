"""ROS 2 messages as data, and CDR, their encoding: version 1, little endian, behind a header of four bytes.

Fields are in the order of the standard's .msg files, which is the order on the wire. Humble and Jazzy have the same
fields; constants are not sent and are left out. A message is a dict by field name, nested messages are dicts too.
Sequences of numbers may be anything that NumPy takes.
"""

import struct
from functools import cache
from typing import Any, NamedTuple

import numpy as np

DEFINITIONS: dict[str, tuple[str, ...]] = {  # a type, then the names of the fields that have it
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

NONE, SEQUENCE = 0, -1  # counts of a field that is no array, and of a sequence of any length


class Field(NamedTuple):
    """One field: ``count`` elements of ``base`` (`NONE`: a single value, `SEQUENCE`: any number)."""

    name: str
    base: str
    count: int


@cache
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
    """The default value of a type: zeros, empty texts and sequences; shared, so do not change it."""
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

_NUMBERS = {base: struct.Struct("<" + code) for base, code in _CODES.items()}

Message = dict[str, Any]


class CdrError(ValueError):
    """Bytes that are not a message of the type, or values that do not fit it."""


def encode(message: str, value: Message) -> bytes:
    """The bytes of a message of the given type ("std_msgs/msg/String"). Raises CdrError."""
    out = bytearray()
    try:
        _write(out, message, value)
    except (AttributeError, KeyError, TypeError, ValueError, OverflowError, struct.error) as error:
        raise CdrError(f"{message}: {type(error).__name__}: {error}") from error
    return HEADER + bytes(out)


def decode(message: str, data: bytes) -> Message:
    """A message of the given type from its bytes, of either byte order. Raises CdrError."""
    if len(data) < len(HEADER) or data[:2] not in (_LITTLE_ENDIAN, _BIG_ENDIAN):
        raise CdrError(f"{message}: no CDR header of version 1")
    reader = _Reader(data[4:], "<" if data[:2] == _LITTLE_ENDIAN else ">")
    value = _read(reader, message)
    if len(reader.data) - reader.at > _PADDING:
        raise CdrError(f"{message}: {len(reader.data) - reader.at} bytes too many")
    return value


def _write(out: bytearray, base: str, value: Any) -> None:
    """Append one value of a type."""
    if base == "string":
        text = value.encode()
        if b"\x00" in text:
            raise CdrError("text with a zero character")
        _write(out, "uint32", len(text) + 1)
        out.extend(text + b"\x00")
    elif base in _CODES:
        number = _NUMBERS[base]
        out.extend(bytes(-len(out) % number.size))
        out.extend(number.pack(value))
    elif (flat := _flat(base)) is not None:
        (pack, size), names, nested = flat
        numbers = [value[name] for name in names]
        for outer, inner in nested:
            numbers += [value[outer][name] for name in inner]
        out.extend(bytes(-len(out) % size))
        out.extend(pack(*numbers))
    else:
        for field in fields(base):
            _write_field(out, field, value[field.name])


def _write_field(out: bytearray, field: Field, value: Any) -> None:
    if field.count == NONE:
        _write(out, field.base, value)
        return
    array = _as(value, np.dtype(f"<{_CODES[field.base]}")) if field.base in _CODES else None
    count = len(value) if array is None else array.size
    if field.count == SEQUENCE:
        _write(out, "uint32", count)
    elif count != field.count:
        raise CdrError(f"{field.name}: {count} elements, {field.count} are needed")
    if array is None:
        for item in value:
            _write(out, field.base, item)
    elif count:
        out.extend(bytes(-len(out) % array.itemsize))
        out.extend(array.tobytes())


@cache
def _flat(base: str) -> Any:
    """Packing function, alignment and field names to write a message in one call, such as a point or a pose.

    None unless its fields are all numbers of one size, or all messages of such numbers.
    """
    names = [field for field in fields(base) if field.base not in DEFINITIONS]
    nested = [(field.name, fields(field.base)) for field in fields(base) if field.base in DEFINITIONS]
    leaves = [*names, *(leaf for _, inner in nested for leaf in inner)]
    arrays = any(field.count != NONE for field in (*fields(base), *leaves))
    if arrays or (names and nested) or not {leaf.base for leaf in leaves} <= set(_CODES):
        return None
    sizes = {_NUMBERS[leaf.base].size for leaf in leaves}
    if len(sizes) > 1:
        return None
    how = struct.Struct("<" + "".join(_CODES[leaf.base] for leaf in leaves)).pack, sizes.pop()
    return how, [field.name for field in names], [(name, [leaf.name for leaf in inner]) for name, inner in nested]


def _as(values: Any, dtype: np.dtype) -> np.ndarray:
    """Numbers in the type of the wire; raises CdrError for values that an integer type cannot hold."""
    array = np.asarray(values)
    if array.dtype == dtype:
        return array
    cast = array.astype(dtype)
    if dtype.kind in "iu" and not np.array_equal(cast, array):
        raise CdrError(f"numbers that do not fit {dtype}")
    return cast


class _Reader:
    """Bytes after the header, and the position of the next one to read."""

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


def _read(reader: _Reader, base: str) -> Any:
    """The next value of a type."""
    if base == "string":
        text = reader.take(_read(reader, "uint32"), 1)
        if text and text[-1]:
            raise CdrError("text without its end")
        try:
            return text[:-1].decode()
        except UnicodeDecodeError as error:
            raise CdrError(f"text that is no UTF-8: {error}") from error
    if base in _CODES:
        size = _NUMBERS[base].size
        return struct.unpack(reader.order + _CODES[base], reader.take(size, size))[0]
    return {field.name: _read_field(reader, field) for field in fields(base)}


def _read_field(reader: _Reader, field: Field) -> Any:
    if field.count == NONE:
        return _read(reader, field.base)
    count = _read(reader, "uint32") if field.count == SEQUENCE else field.count
    left = len(reader.data) - reader.at
    if count > left:  # every element has a byte at least
        raise CdrError(f"{field.name}: {count} elements in {left} bytes")
    return [_read(reader, field.base) for _ in range(count)]
