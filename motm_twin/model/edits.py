"""What a person or program may do to the simulated world while it runs. Applied at the start of a period and logged."""

import msgspec


class AddObstacle(msgspec.Struct, frozen=True, kw_only=True, tag="add_obstacle", forbid_unknown_fields=True):
    """Put a box or a standing Temi into the world, unknown to the map."""

    name: str
    shape: str = "box"  # box | cylinder | temi
    x: float
    y: float
    heading: float = 0.0  # [rad]
    size: tuple[float, float, float] = (0.5, 0.5, 0.6)  # box: x, y, z [m]; cylinder: diameter, diameter, height


class MoveBody(msgspec.Struct, frozen=True, kw_only=True, tag="move_body", forbid_unknown_fields=True):
    """Move an obstacle or agent; while ``held`` an agent does not drive by itself."""

    name: str
    x: float
    y: float
    heading: float | None = None  # [rad]; None keeps it
    held: bool = True


class ReleaseBody(msgspec.Struct, frozen=True, kw_only=True, tag="release_body", forbid_unknown_fields=True):
    """Let go of a dragged agent or obstacle."""

    name: str


class RemoveObstacle(msgspec.Struct, frozen=True, kw_only=True, tag="remove_obstacle", forbid_unknown_fields=True):
    """Take an added obstacle away."""

    name: str


WorldEdit = AddObstacle | MoveBody | ReleaseBody | RemoveObstacle
