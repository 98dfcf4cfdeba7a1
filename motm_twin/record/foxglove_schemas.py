"""JSON Schemas of the Foxglove messages in a recording, by their well-known names.

Foxglove and Lichtblick choose how to draw a topic by the name of its schema; the fields are those of their
documentation ("Message schemas"). Only the primitives that are used here are spelled out.
"""

from typing import Any

Json = dict[str, Any]


def _object(title: str, **properties: Json) -> Json:
    return {"title": title, "type": "object", "properties": properties}


def _array(items: Json) -> Json:
    return {"type": "array", "items": items}


def _choice(title: str, *names: str) -> Json:
    """An enumeration: each name is the number of its place."""
    return {"title": title, "oneOf": [{"title": name, "const": number} for number, name in enumerate(names)]}


_NUMBER: Json = {"type": "number"}
_COUNT: Json = {"type": "integer", "minimum": 0}
_STRING: Json = {"type": "string"}
_BOOLEAN: Json = {"type": "boolean"}
_BYTES: Json = {"type": "string", "contentEncoding": "base64"}
_NANOSECONDS: Json = {"type": "integer", "minimum": 0, "maximum": 999_999_999}

_TIME = _object("time", sec=_COUNT, nsec=_NANOSECONDS)
_DURATION = _object("duration", sec={"type": "integer"}, nsec=_NANOSECONDS)
_VECTOR2 = _object("foxglove.Vector2", x=_NUMBER, y=_NUMBER)
_VECTOR3 = _object("foxglove.Vector3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_POINT3 = _object("foxglove.Point3", x=_NUMBER, y=_NUMBER, z=_NUMBER)
_QUATERNION = _object("foxglove.Quaternion", x=_NUMBER, y=_NUMBER, z=_NUMBER, w=_NUMBER)
_POSE = _object("foxglove.Pose", position=_VECTOR3, orientation=_QUATERNION)
_COLOUR = _object("foxglove.Color", r=_NUMBER, g=_NUMBER, b=_NUMBER, a=_NUMBER)
_PAIR = _object("foxglove.KeyValuePair", key=_STRING, value=_STRING)

_CUBE = _object("foxglove.CubePrimitive", pose=_POSE, size=_VECTOR3, color=_COLOUR)
_SPHERE = _object("foxglove.SpherePrimitive", pose=_POSE, size=_VECTOR3, color=_COLOUR)
_CYLINDER = _object(
    "foxglove.CylinderPrimitive",
    pose=_POSE,
    size=_VECTOR3,
    bottom_scale=_NUMBER,
    top_scale=_NUMBER,
    color=_COLOUR,
)
_ARROW = _object(
    "foxglove.ArrowPrimitive",
    pose=_POSE,
    shaft_length=_NUMBER,
    shaft_diameter=_NUMBER,
    head_length=_NUMBER,
    head_diameter=_NUMBER,
    color=_COLOUR,
)
_LINE = _object(
    "foxglove.LinePrimitive",
    type=_choice("foxglove.LineType", "LINE_STRIP", "LINE_LOOP", "LINE_LIST"),
    pose=_POSE,
    thickness=_NUMBER,
    scale_invariant=_BOOLEAN,
    points=_array(_POINT3),
    color=_COLOUR,
    colors=_array(_COLOUR),
    indices=_array(_COUNT),
)
_TRIANGLES = _object(
    "foxglove.TriangleListPrimitive",
    pose=_POSE,
    points=_array(_POINT3),
    color=_COLOUR,
    colors=_array(_COLOUR),
    indices=_array(_COUNT),
)
_TEXT = _object(
    "foxglove.TextPrimitive",
    pose=_POSE,
    billboard=_BOOLEAN,
    font_size=_NUMBER,
    scale_invariant=_BOOLEAN,
    color=_COLOUR,
    text=_STRING,
)
_MODEL = _object(
    "foxglove.ModelPrimitive",
    pose=_POSE,
    scale=_VECTOR3,
    color=_COLOUR,
    override_color=_BOOLEAN,
    url=_STRING,
    media_type=_STRING,
    data=_BYTES,
)
_ENTITY = _object(
    "foxglove.SceneEntity",
    timestamp=_TIME,
    frame_id=_STRING,
    id=_STRING,
    lifetime=_DURATION,
    frame_locked=_BOOLEAN,
    metadata=_array(_PAIR),
    arrows=_array(_ARROW),
    cubes=_array(_CUBE),
    spheres=_array(_SPHERE),
    cylinders=_array(_CYLINDER),
    lines=_array(_LINE),
    triangles=_array(_TRIANGLES),
    texts=_array(_TEXT),
    models=_array(_MODEL),
)
_DELETION = _object(
    "foxglove.SceneEntityDeletion",
    timestamp=_TIME,
    type=_choice("foxglove.SceneEntityDeletionType", "MATCHING_ID", "ALL"),
    id=_STRING,
)
_TRANSFORM = _object(
    "foxglove.FrameTransform",
    timestamp=_TIME,
    parent_frame_id=_STRING,
    child_frame_id=_STRING,
    translation=_VECTOR3,
    rotation=_QUATERNION,
)
_FIELD = _object(
    "foxglove.PackedElementField",
    name=_STRING,
    offset=_COUNT,
    type=_choice(
        "foxglove.NumericType",
        *("UNKNOWN", "UINT8", "INT8", "UINT16", "INT16", "UINT32", "INT32", "FLOAT32", "FLOAT64"),
    ),
)

SCENE_UPDATE = _object("foxglove.SceneUpdate", deletions=_array(_DELETION), entities=_array(_ENTITY))
FRAME_TRANSFORMS = _object("foxglove.FrameTransforms", transforms=_array(_TRANSFORM))
POSES_IN_FRAME = _object("foxglove.PosesInFrame", timestamp=_TIME, frame_id=_STRING, poses=_array(_POSE))
GRID = _object(
    "foxglove.Grid",
    timestamp=_TIME,
    frame_id=_STRING,
    pose=_POSE,
    column_count=_COUNT,
    cell_size=_VECTOR2,
    row_stride=_COUNT,
    cell_stride=_COUNT,
    fields=_array(_FIELD),
    data=_BYTES,
)
LASER_SCAN = _object(
    "foxglove.LaserScan",
    timestamp=_TIME,
    frame_id=_STRING,
    pose=_POSE,
    start_angle=_NUMBER,
    end_angle=_NUMBER,
    ranges=_array(_NUMBER),
    intensities=_array(_NUMBER),
)
LOG = _object(
    "foxglove.Log",
    timestamp=_TIME,
    level=_choice("foxglove.LogLevel", "UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL"),
    message=_STRING,
    name=_STRING,
    file=_STRING,
    line=_COUNT,
)
