"""The scene file, format ``motm-scene/1``: every section and key of the YAML, with units and limits.

Lengths are in [m] and times in [s]. Every other quantity carries its unit in its key: ``_deg``, ``_mps`` (m/s),
``_dps`` (deg/s), ``_mps2``, ``_dps2``, ``_hz``. The JSON Schema is generated from these types.
"""

import functools
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from motm_twin.model import faults
from motm_twin.model.bounds import FARTHEST, SEED
from motm_twin.model.profile import DEG

FORMAT = "motm-scene/1"
MOST_TASKS = 200  # of a scene, and still to be done in a list
UNITS = {"deg": DEG, "dps": DEG, "dps2": DEG, "mps": 1.0, "mps2": 1.0, "hz": 1.0}  # by the end of a key
COLOURS = {  # of cubes, as page and markers draw them
    "red": (232, 22, 28), "green": (52, 148, 82), "blue": (46, 100, 190), "yellow": (236, 190, 44),
    "orange": (236, 130, 40), "purple": (122, 63, 160), "brown": (134, 88, 54), "white": (240, 240, 240),
    "black": (40, 40, 40), "grey": (140, 140, 140),
}  # fmt: skip

Coordinate = Annotated[float, FARTHEST.meta]
Height = Annotated[float, Meta(ge=0, le=5, description="[m] above the floor")]
Size = Annotated[float, Meta(gt=0, le=100, description="[m]")]
Sigma = Annotated[float, Meta(ge=0, le=1, description="[m] standard deviation, 0 switches it off")]
Seconds = Annotated[float, Meta(ge=0, le=10, description="[s]")]
Degrees = Annotated[float, Meta(ge=-360, le=360, description="[deg]")]
Point = tuple[Coordinate, Coordinate]
Name = Annotated[str, Meta(pattern="^[A-Za-z][A-Za-z0-9_-]{0,39}$")]
Text = Annotated[str, Meta(min_length=1, max_length=200)]
Colour = Annotated[str, Meta(pattern="^([a-z]{3,20}|#[0-9a-fA-F]{6})$")]
Seed = Annotated[int, SEED.meta]
GraspSpeed = Annotated[float, Meta(ge=0.001, le=1, description="[m/s]")]
CubeSide = Annotated[float, Meta(ge=0.02, le=0.2, description="[m]")]
TimeLimit = Annotated[float, Meta(gt=0, le=36000, description="[s] of simulated time")]
Tolerance = Annotated[float, Meta(ge=0.02, le=2, description="[m]")]
Style = Literal["plain", "table", "desk", "cabinet", "shelf", "box", "wall"]


class Part(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Base of every section: unknown keys are refused."""


class PoseFile(Part, frozen=True, kw_only=True):
    """A pose on the floor."""

    x: Coordinate
    y: Coordinate
    heading_deg: Degrees = 0.0


class FurnitureFile(Part, frozen=True, kw_only=True, tag_field="shape"):
    """Fields of every piece of furniture."""

    z: tuple[Height, Height]  # from, to
    mapped: bool = True  # false: the robot's map does not know it
    group: Name | None = None  # pieces of one group are one thing, for instance the slab and posts of a table
    style: Style = "plain"


class BoxFile(FurnitureFile, frozen=True, kw_only=True, tag="box"):
    """A box: centre, size along its own axes, yaw."""

    centre: Point
    size: tuple[Size, Size]
    yaw_deg: Degrees = 0.0


class CylinderFile(FurnitureFile, frozen=True, kw_only=True, tag="cylinder"):
    """An upright cylinder."""

    centre: Point
    radius: Size


class PolygonFile(FurnitureFile, frozen=True, kw_only=True, tag="polygon"):
    """An upright prism over a simple polygon."""

    corners: Annotated[tuple[Point, ...], Meta(min_length=3, max_length=64)]


Furniture = BoxFile | CylinderFile | PolygonFile


class ObjectFile(Part, frozen=True, kw_only=True):
    """A cube to be picked, on a piece of furniture (``surface``) or on whatever has its top at height ``z``."""

    at: Point
    surface: Name | None = None
    z: Height | None = None
    yaw_deg: Degrees = 0.0
    side: CubeSide = 0.04
    colour: Colour = "red"


class SlotFile(Part, frozen=True, kw_only=True):
    """A named position on a piece of furniture."""

    surface: Name
    at: Point
    yaw_deg: Degrees = 0.0


class BinFile(Part, frozen=True, kw_only=True):
    """An open square box that objects are dropped into."""

    at: Point
    yaw_deg: Degrees = 0.0
    side: Size = 0.4
    wall: Size = 0.01
    rim_z: Height = 0.72
    floor_z: Height = 0.62


class BumpFile(Part, frozen=True, kw_only=True):
    """A low rounded ridge on the floor, as a cable cover; felt under contact dynamics only."""

    at: Point
    length: Annotated[float, Meta(ge=0.02, le=50, description="[m] of the ridge")]
    yaw_deg: Degrees = 0.0
    width: Annotated[float, Meta(ge=0.04, le=1, description="[m] across the ridge")] = 0.1
    height: Annotated[float, Meta(ge=0.001, le=0.02, description="[m]")] = 0.01


class AroundFile(Part, frozen=True, kw_only=True):
    """A closed lane round a piece (or group) of furniture, at a constant distance from its edge."""

    furniture: Name
    distance: Annotated[float, Meta(gt=0, le=10, description="[m] from the edge to the agent's centre")]
    direction: Literal["clockwise", "counter-clockwise"] = "counter-clockwise"
    start_at: Annotated[float, Meta(ge=0, lt=1, description="where on the lane it starts, 0 to 1")] = 0.0


class AgentFile(Part, frozen=True, kw_only=True):
    """Somebody who drives round waypoints, or round furniture, for ever; with neither it stands at ``start``."""

    start: PoseFile | None = None  # default: the first waypoint, looking along the way
    waypoints: Annotated[tuple[Point, ...], Meta(max_length=200)] = ()
    around: AroundFile | None = None
    speed_mps: Annotated[float, Meta(gt=0, le=3)] = 0.4
    radius: Annotated[float, Meta(ge=0.05, le=1, description="[m]")] = 0.25
    height: Annotated[float, Meta(ge=0.05, le=2.5, description="[m]")] | None = None  # default: 1.0, a person 1.7
    behaviour: Literal["yield", "blind", "orca", "social_force"] = "yield"  # orca: extra [people]
    sees_robot: bool = True  # false: it reacts to everything but the robot
    kind: Literal["temi", "person"] = "temi"  # how it is drawn, and its usual height and acceleration
    acceleration_mps2: Annotated[float, Meta(gt=0, le=10)] | None = None  # default: 0.5 of a Temi, 1.5 of a person
    pause: Annotated[float, Meta(ge=0, le=600, description="[s] at every waypoint")] = 0.0


class DriveToFile(Part, frozen=True, kw_only=True):
    """A point to drive to; a pose when a heading is given."""

    x: Coordinate
    y: Coordinate
    heading_deg: Degrees | None = None
    tolerance: Tolerance = 0.15


class TaskFile(Part, frozen=True, kw_only=True):
    """One task: exactly one of pick, place and drive_to."""

    pick: Name | None = None
    place: Name | None = None
    drive_to: DriveToFile | None = None


class RandomSlots(Part, frozen=True, kw_only=True):
    """So many different slots, chosen and ordered by the seed."""

    random: Annotated[int, Meta(ge=1, le=100)]


class DeliverFile(Part, frozen=True, kw_only=True):
    """Cubes on slots, picked in that order and delivered to the bins in turn."""

    slots: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=100)] | RandomSlots | None = None
    to: Annotated[tuple[Name, ...], Meta(min_length=1, max_length=20)] | None = None
    side: CubeSide = 0.04
    colour: Colour = "red"


class NoiseFile(Part, frozen=True, kw_only=True):
    """Errors of sensors, localisation and actuation; what is absent keeps its default, 0 switches one off."""

    localisation_position_sd: Sigma | None = None
    localisation_heading_sd_deg: Annotated[float, Meta(ge=0, le=45)] | None = None
    localisation_correlation_time: Annotated[float, Meta(gt=0, le=600, description="[s]")] | None = None
    lidar_range_sd: Sigma | None = None
    slot_error_until_seen: Sigma | None = None
    camera_position_sd_at_1m: Sigma | None = None
    camera_position_sd_at_01m: Sigma | None = None
    base_speed_scale_sd: Annotated[float, Meta(ge=0, le=0.5, description="share of the speed")] | None = None
    arm_rate_sd_dps: Annotated[float, Meta(ge=0, le=45)] | None = None
    localisation_drift_sd: Sigma | None = None
    localisation_drift_time: Annotated[float, Meta(gt=0, le=3600, description="[s]")] | None = None
    camera_latency: Annotated[float, Meta(ge=0, le=2, description="[s]")] | None = None
    camera_miss_probability: Annotated[float, Meta(ge=0, le=1, description="of an object in a picture")] | None = None
    camera_false_probability: Annotated[float, Meta(ge=0, le=1, description="of a picture")] | None = None


class MismatchFile(Part, frozen=True, kw_only=True):
    """Mismatch between reality and the robot's model."""

    command_delay: Annotated[float, Meta(ge=0, le=1, description="[s]")] | None = None
    base_lag: Annotated[float, Meta(ge=0, le=2, description="[s] more than in the profile")] | None = None
    base_scale: Annotated[float, Meta(ge=-0.5, le=0.5, description="share faster than commanded")] | None = None
    arm_lag: Annotated[float, Meta(ge=0, le=2, description="[s] more than in the profile")] | None = None
    hand_eye: Annotated[float, Meta(ge=0, le=0.1, description="[m]")] | None = None
    map_offset: Annotated[float, Meta(ge=0, le=0.5, description="[m]")] | None = None
    table_height: Annotated[float, Meta(ge=-0.2, le=0.2, description="[m] higher than in the map")] | None = None


Tries = Annotated[int, Meta(ge=0, le=100)]


class TimedFaultFile(Part, frozen=True, kw_only=True):
    """A fault that comes at a time of the run; kinds and the meaning of their numbers are in docs/zenoh.md."""

    at: Annotated[float, Meta(ge=0, le=36000, description="[s] of simulated time")]
    fault: Annotated[str, Meta(extra_json_schema={"enum": list(faults.NAMES)})]
    seconds: Annotated[float, faults.SECONDS.meta] = 1.0
    delay: Annotated[float, faults.DELAY.meta] = 0.5
    amount: float | None = None
    joint: Annotated[int, faults.JOINT.meta] = faults.USUAL_JOINT


class FaultsFile(Part, frozen=True, kw_only=True):
    """Grasps that fail or take longer although the fingers stand well, cubes that are moved, and what fails when."""

    grasp_misses: Tries | None = None  # number of first grasps of each object that close on nothing
    grasp_slips: Tries | None = None  # number of grasps, after those, that slip when lifted
    grasp_failure_probability: Annotated[float, Meta(ge=0, le=1)] | None = None  # of any grasp after those
    grasp_delay: Annotated[float, Meta(ge=0, le=60, description="[s]")] | None = None
    grasp_delay_spread: Annotated[float, Meta(ge=0, le=60, description="[s]")] | None = None  # at most
    only_object: Tries | None = None  # only the n-th object grasped is affected; 0: every one
    cube_moved_by: Annotated[float, Meta(ge=0, le=0.5, description="[m]")] | None = None
    cube_moved_within: Annotated[float, Meta(gt=0, le=10, description="[m] of the base from the cube")] | None = None
    inject: Annotated[tuple[TimedFaultFile, ...], Meta(max_length=100)] | None = None


class FootprintFile(Part, frozen=True, kw_only=True):
    """Rectangle of the base body."""

    length: Annotated[float, Meta(ge=0.1, le=3, description="[m]")] | None = None
    width: Annotated[float, Meta(ge=0.1, le=3, description="[m]")] | None = None
    height: Annotated[float, Meta(ge=0.05, le=2, description="[m]")] | None = None
    offset_x: Annotated[float, Meta(ge=-1, le=1, description="[m]")] | None = None


class BaseFile(Part, frozen=True, kw_only=True):
    """Limits of the differential drive."""

    forward_speed_mps: Annotated[float, Meta(gt=0, le=5)] | None = None
    reverse_speed_mps: Annotated[float, Meta(ge=0, le=5)] | None = None
    yaw_rate_dps: Annotated[float, Meta(gt=0, le=720)] | None = None
    linear_acceleration_mps2: Annotated[float, Meta(gt=0, le=20)] | None = None
    yaw_acceleration_dps2: Annotated[float, Meta(gt=0, le=2000)] | None = None
    velocity_lag: Seconds | None = None


class ArmFile(Part, frozen=True, kw_only=True):
    """Mount of the Panda on the base."""

    mount_x: Annotated[float, Meta(ge=-2, le=2, description="[m]")] | None = None
    mount_y: Annotated[float, Meta(ge=-2, le=2, description="[m]")] | None = None
    mount_z: Annotated[float, Meta(ge=0.05, le=2, description="[m]")] | None = None
    velocity_lag: Seconds | None = None


class GripperFile(Part, frozen=True, kw_only=True):
    """Times of the Franka Hand."""

    max_width: Annotated[float, Meta(gt=0.02, le=0.3, description="[m]")] | None = None
    closing_time: Seconds | None = None
    opening_time: Seconds | None = None


class LidarFile(Part, frozen=True, kw_only=True):
    """Planar lidar of the base."""

    x: Annotated[float, Meta(ge=-2, le=2, description="[m]")] | None = None
    y: Annotated[float, Meta(ge=-2, le=2, description="[m]")] | None = None
    z: Annotated[float, Meta(gt=0, le=2, description="[m] above the floor")] | None = None
    field_of_view_deg: Annotated[float, Meta(gt=0, le=360)] | None = None
    beams: Annotated[int, Meta(ge=8, le=4000)] | None = None
    range_min: Annotated[float, Meta(ge=0, le=1, description="[m]")] | None = None
    range_max: Annotated[float, Meta(gt=1, le=100, description="[m]")] | None = None
    rate_hz: Annotated[float, Meta(gt=0, le=100)] | None = None


class CameraFile(Part, frozen=True, kw_only=True):
    """Palm camera of the gripper."""

    half_cone_deg: Annotated[float, Meta(gt=0, lt=90)] | None = None
    range: Annotated[float, Meta(gt=0, le=10, description="[m]")] | None = None
    rate_hz: Annotated[float, Meta(gt=0, le=100)] | None = None


class RobotFile(Part, frozen=True, kw_only=True):
    """A robot given by its differences from Frankie."""

    name: Name = "frankie"
    footprint: FootprintFile | None = None
    base: BaseFile | None = None
    arm: ArmFile | Literal["none"] | None = None
    gripper: GripperFile | None = None
    lidar: LidarFile | None = None
    camera: CameraFile | None = None


class Content(Part, frozen=True, kw_only=True):
    """Sections of a scene; a variant may replace any of them."""

    title: Text | None = None
    robot: Literal["frankie"] | RobotFile | None = None
    start: PoseFile | None = None
    furniture: Annotated[dict[Name, Furniture | None], Meta(max_length=2000)] = {}
    slots: Annotated[dict[Name, SlotFile | None], Meta(max_length=100)] = {}
    objects: Annotated[dict[Name, ObjectFile | None], Meta(max_length=100)] = {}
    bins: Annotated[dict[Name, BinFile | None], Meta(max_length=20)] = {}
    bumps: Annotated[dict[Name, BumpFile | None], Meta(max_length=100)] = {}
    agents: Annotated[dict[Name, AgentFile | None], Meta(max_length=100)] = {}
    deliver: DeliverFile | None = None
    tasks: Annotated[tuple[TaskFile, ...], Meta(min_length=1, max_length=MOST_TASKS)] | None = None
    noise: NoiseFile | Literal["earlier"] | None = None  # earlier: as before actuation, latency and drift had errors
    mismatch: MismatchFile | None = None
    detections: Literal["anonymous", "named"] | None = None  # named: markers on the objects
    grasp_rule: Literal["swept", "strict"] | None = None  # which grasps the kinematic plant holds
    faults: FaultsFile | None = None
    seed: Seed | None = None
    bounds: tuple[Coordinate, Coordinate, Coordinate, Coordinate] | None = None  # x_min, y_min, x_max, y_max
    time_limit: TimeLimit | None = None


class VariantFile(Content, frozen=True, kw_only=True):
    """A named variant: its sections are laid over those of the scene."""

    keep_agents: tuple[Name, ...] | None = None  # only these agents take part


class SceneFile(Content, frozen=True, kw_only=True):
    """A scene file."""

    format: Literal["motm-scene/1"]
    extends: Annotated[str, Meta(min_length=1, max_length=60)] | None = None  # shipped name, or file in this folder
    default_variant: Name | None = None
    variants: Annotated[dict[Name, VariantFile], Meta(max_length=100)] = {}


@functools.cache
def most_entries(section: str) -> int:
    """The largest number of entries of a section of a scene."""
    kind = next(field.type for field in msgspec.structs.fields(Content) if field.name == section)
    parts = (kind, *getattr(kind, "__args__", ()))
    return next(
        meta.max_length
        for part in parts
        for meta in getattr(part, "__metadata__", ())
        if isinstance(meta, Meta) and meta.max_length is not None
    )


def json_schema() -> dict:
    """The JSON Schema of a scene file (draft 2020-12)."""
    schema = msgspec.json.schema(SceneFile)
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "motm-twin scene", **schema}
