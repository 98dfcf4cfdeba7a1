"""The ROS 2 messages that are spoken here, as data: every field in the order of the standard's .msg files.

The order is the order on the wire. Humble and Jazzy have the same fields; constants do not travel and are left out.
"""

from typing import NamedTuple

DEFINITIONS: dict[str, tuple[str, ...]] = {
    "builtin_interfaces/msg/Time": ("int32 sec", "uint32 nanosec"),
    "builtin_interfaces/msg/Duration": ("int32 sec", "uint32 nanosec"),
    "std_msgs/msg/Header": ("builtin_interfaces/msg/Time stamp", "string frame_id"),
    "std_msgs/msg/String": ("string data",),
    "std_msgs/msg/ColorRGBA": ("float32 r", "float32 g", "float32 b", "float32 a"),
    "geometry_msgs/msg/Point": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Vector3": ("float64 x", "float64 y", "float64 z"),
    "geometry_msgs/msg/Quaternion": ("float64 x", "float64 y", "float64 z", "float64 w"),
    "geometry_msgs/msg/Pose": ("geometry_msgs/msg/Point position", "geometry_msgs/msg/Quaternion orientation"),
    "geometry_msgs/msg/PoseStamped": ("std_msgs/msg/Header header", "geometry_msgs/msg/Pose pose"),
    "geometry_msgs/msg/PoseWithCovariance": ("geometry_msgs/msg/Pose pose", "float64[36] covariance"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (
        "std_msgs/msg/Header header",
        "geometry_msgs/msg/PoseWithCovariance pose",
    ),
    "geometry_msgs/msg/Twist": ("geometry_msgs/msg/Vector3 linear", "geometry_msgs/msg/Vector3 angular"),
    "geometry_msgs/msg/TwistWithCovariance": ("geometry_msgs/msg/Twist twist", "float64[36] covariance"),
    "geometry_msgs/msg/Transform": (
        "geometry_msgs/msg/Vector3 translation",
        "geometry_msgs/msg/Quaternion rotation",
    ),
    "geometry_msgs/msg/TransformStamped": (
        "std_msgs/msg/Header header",
        "string child_frame_id",
        "geometry_msgs/msg/Transform transform",
    ),
    "tf2_msgs/msg/TFMessage": ("geometry_msgs/msg/TransformStamped[] transforms",),
    "rosgraph_msgs/msg/Clock": ("builtin_interfaces/msg/Time clock",),
    "sensor_msgs/msg/JointState": (
        "std_msgs/msg/Header header",
        "string[] name",
        "float64[] position",
        "float64[] velocity",
        "float64[] effort",
    ),
    "sensor_msgs/msg/LaserScan": (
        "std_msgs/msg/Header header",
        "float32 angle_min",
        "float32 angle_max",
        "float32 angle_increment",
        "float32 time_increment",
        "float32 scan_time",
        "float32 range_min",
        "float32 range_max",
        "float32[] ranges",
        "float32[] intensities",
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
        "uint32 width",
        "uint32 height",
        "geometry_msgs/msg/Pose origin",
    ),
    "nav_msgs/msg/OccupancyGrid": (
        "std_msgs/msg/Header header",
        "nav_msgs/msg/MapMetaData info",
        "int8[] data",
    ),
    "visualization_msgs/msg/UVCoordinate": ("float32 u", "float32 v"),
    "visualization_msgs/msg/MeshFile": ("string filename", "uint8[] data"),
    "visualization_msgs/msg/Marker": (
        "std_msgs/msg/Header header",
        "string ns",
        "int32 id",
        "int32 type",
        "int32 action",
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
        "string text",
        "string mesh_resource",
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
    """The fields of a message in order; raises KeyError for one that is not spoken here."""
    return tuple(_field(line) for line in DEFINITIONS[message])


def dds_name(message: str) -> str:
    """``std_msgs/msg/String`` as DDS calls it: ``std_msgs::msg::dds_::String_``."""
    package, kind, name = message.split("/")
    return f"{package}::{kind}::dds_::{name}_"


def _field(line: str) -> Field:
    kind, name = line.split(" ")
    if not kind.endswith("]"):
        return Field(name, kind, NONE)
    base, length = kind[:-1].split("[")
    return Field(name, base, int(length) if length else SEQUENCE)
