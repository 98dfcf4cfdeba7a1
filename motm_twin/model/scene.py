"""The resolved scene: one variant and seed of a scene file, in plain numbers [m, rad, s], world frame.

``scene_format.py`` holds the YAML schema, ``scene_file.py`` makes these; the rest of the project reads only these.
"""

from typing import Annotated, ClassVar

import msgspec

from motm_twin.model.bounds import Between, Text
from motm_twin.model.faults import FaultFields
from motm_twin.model.profile import RobotProfile

Point = tuple[float, float]
PlanarPose = tuple[float, float, float]  # x, y, heading


class Box(msgspec.Struct, frozen=True, kw_only=True, tag="box"):
    """A rectangle: centre, size along its own axes, yaw."""

    centre: Point
    size: Point
    yaw: float = 0.0


class Cylinder(msgspec.Struct, frozen=True, kw_only=True, tag="cylinder"):
    """A disc."""

    centre: Point
    radius: float


class Prism(msgspec.Struct, frozen=True, kw_only=True, tag="prism"):
    """A simple polygon, corners counter-clockwise."""

    corners: tuple[Point, ...]


class Solid(msgspec.Struct, frozen=True, kw_only=True):
    """A piece of furniture between two heights. A table is a slab and its posts: several solids of one ``group``."""

    name: str
    shape: Box | Cylinder | Prism
    z_min: float
    z_max: float
    mapped: bool  # known to the pre-made map
    group: str = ""  # furniture piece this belongs to, for drawing and reports
    style: str = "plain"  # how the page draws it: table, desk, cabinet, box, wall, plain


class SceneObject(msgspec.Struct, frozen=True, kw_only=True):
    """A cube to be picked; position is its centre, in truth. What the robot believes at first differs (Noise)."""

    name: str
    position: tuple[float, float, float]
    yaw: float = 0.0
    side: float = 0.04
    colour: str = "red"


class Bin(msgspec.Struct, frozen=True, kw_only=True):
    """An open square box that objects are dropped into."""

    name: str
    centre: Point
    yaw: float = 0.0
    side: float = 0.4  # outer
    wall: float = 0.01
    rim_z: float = 0.72
    floor_z: float = 0.62


BEHAVIOURS = ("yield", "blind", "orca", "social_force")
AGENT_REACTION = 1.0  # [s] before an agent, such as a person, brakes
AGENT_MOVES = 0.1  # [m/s] slower agents stand
TEMI_ACCELERATION, PERSON_ACCELERATION = 0.5, 1.5  # [m/s^2]
"""A person at 1.3 m/s who starts, stops or turns within the 0.5 s of Helbing and Molnar (1995) needs 2.6 m/s^2 at
first; people who walk at ease stay below 1.5 m/s^2 (a choice of this project)."""


class Bump(msgspec.Struct, frozen=True, kw_only=True):
    """A low rounded ridge on the floor, as a cable cover: contact dynamics roll over it, kinematics ignore it."""

    name: str
    centre: Point
    length: float  # [m] of the ridge
    yaw: float = 0.0  # of the ridge
    width: float = 0.1  # [m] across it
    height: float = 0.01  # [m]


class Agent(msgspec.Struct, frozen=True, kw_only=True):
    """A dynamic obstacle that drives round its waypoints; with one waypoint it stops there, with none it stands.

    The fields in `later` are hashed only when they are not as usual: runs without them keep their hash.
    """

    later: ClassVar[tuple[str, ...]] = ("sees_robot", "acceleration", "pause")

    name: str
    start: PlanarPose
    waypoints: tuple[Point, ...] = ()
    speed: float = 0.4
    radius: float = 0.25
    height: float = 1.0
    behaviour: str = "yield"  # one of `BEHAVIOURS`
    kind: str = "temi"  # temi | person: how it is drawn
    sees_robot: bool = True  # False: it reacts to everything else
    acceleration: float = TEMI_ACCELERATION  # [m/s^2] with which it starts and stops, and turns when it walks
    pause: float = 0.0  # [s] that it stands at every waypoint


class Pick(msgspec.Struct, frozen=True, kw_only=True, tag="pick"):
    """Pick an object up."""

    object: Annotated[str, Text(1, 64)]


class Place(msgspec.Struct, frozen=True, kw_only=True, tag="place"):
    """Drop what is held into a bin."""

    bin: Annotated[str, Text(1, 64)]


HEADING_TOLERANCE = 0.35  # [rad] (20 deg) of a `DriveTo` pose


class DriveTo(msgspec.Struct, frozen=True, kw_only=True, tag="drive_to"):
    """Drive to a point, or to a pose when a heading is given. Done within ``tolerance`` [m] (and 20 deg)."""

    point: Annotated[Point, Between(-1000.0, 1000.0, unit="m")]
    heading: Annotated[float, Between(-1000.0, 1000.0, unit="rad")] | None = None
    tolerance: Annotated[float, Between(0.01, 5.0, unit="m")] = 0.15


Task = Pick | Place | DriveTo


class Noise(msgspec.Struct, frozen=True, kw_only=True):
    """Errors of sensors, localisation and actuation; 0 switches one off. Lags are in the robot profile.

    The defaults are the original values, used by sessions and figures without the later fields. A scene file without
    `noise` gets `USUAL_NOISE`; its sources are beside it.
    """

    localisation_position_sd: float = 0.01  # [m] per axis, correlated over localisation_correlation_time
    localisation_heading_sd: float = 0.5 * 3.141592653589793 / 180.0  # [rad]
    localisation_correlation_time: float = 5.0  # [s]
    lidar_range_sd: float = 0.01  # [m]
    slot_error_until_seen: float = 0.03  # [m] sd per axis of an object's believed position before it is seen
    camera_position_sd_at_1m: float = 0.02  # [m], linear in distance between the two
    camera_position_sd_at_01m: float = 0.002  # [m]
    base_speed_scale_sd: float = 0.0  # share by which the base is faster than commanded, fixed for one seed
    arm_rate_sd: float = 0.0  # [rad/s] of every joint that moves, about its commanded rate, drawn anew every 10 ms
    localisation_drift_sd: float = 0.0  # [m] per axis, a second error that is correlated over localisation_drift_time
    localisation_drift_time: float = 60.0  # [s]
    camera_latency: float = 0.0  # [s] from a picture to its detections, which carry the picture's stamp
    camera_miss_probability: float = 0.0  # of each object that is in view, in each picture
    camera_false_probability: float = 0.0  # of each picture: something is detected where nothing is; not with markers


EARLIER_NOISE = Noise()
USUAL_NOISE = Noise(
    base_speed_scale_sd=0.01,
    arm_rate_sd=0.1 * 3.141592653589793 / 180.0,
    localisation_drift_sd=0.015,
    camera_latency=0.05,
    camera_miss_probability=0.03,
    camera_false_probability=0.01,
)
"""Errors of a scene file that does not give them.

base_speed_scale_sd: Borenstein and Feng (Measurement and Correction of Systematic Odometry Errors in Mobile Robots,
IEEE Transactions on Robotics and Automation 12(6), 1996) name an uncertain effective wheelbase and wheel diameters
other than nominal as the two systematic errors of a differential drive; 1 % is a choice of this project.

arm_rate_sd: ros2_controllers issue 649 shows a UR3e under a velocity controller whose measured tool speed is mostly
noise at 1 mm/s; at a lever of 0.6 m that is some 0.1 deg/s of one joint. No figure was found for the Panda (franka_ros
issue 112 asks for one, without an answer).

localisation_drift_sd: a map with 5 cm cells, as is usual for AMCL, cannot resolve places within a cell, which gives
5 cm / sqrt(12). It comes on top of localisation_position_sd of 1 cm: Costa et al. (Robust and Accurate Localization
System for Mobile Manipulators in Cluttered Environments, IEEE ICIT 2015) report errors below 1 cm and 1 deg.

camera_latency: the documentation of librealsense (rs-latency-tool) gives tens to hundreds of milliseconds for USB
cameras; one period at our 20 Hz is a choice of this project within that range.

camera_miss_probability, camera_false_probability: choices of this project. Miller et al. (What's in the Black Box? The
False Negative Mechanisms Inside Object Detectors, 2022) show that benchmarks say little about what a detector misses on
a robot. The paper detects cubes of one colour, and gives no rates.
"""


class Mismatch(msgspec.Struct, frozen=True, kw_only=True):
    """Mismatch between reality and the robot's model for a whole run; 0: none. The robot is not told."""

    command_delay: float = 0.0  # [s] after which base, arm and gripper act on a command
    base_lag: float = 0.0  # [s] additional lag of the base's velocity loop
    base_scale: float = 0.0  # share by which the base drives and turns faster than commanded
    arm_lag: float = 0.0  # [s] additional lag of the arm's velocity loop
    hand_eye: float = 0.0  # [m] by which the camera is displaced on the hand, in a direction drawn from the seed
    map_offset: float = 0.0  # [m] by which map, bins and believed objects are off, in a direction drawn from the seed
    table_height: float = 0.0  # [m] by which furniture with objects on it is higher than the map says


GRASP_RULES = ("swept", "strict")  # see `sim.grasp`
DETECTIONS = ("anonymous", "named")


class TimedFault(FaultFields, frozen=True, kw_only=True):
    """A fault of `model.faults` at a time of the run."""

    at: float  # [s]


class Faults(msgspec.Struct, frozen=True, kw_only=True):
    """Grasp failures, moved cubes, and timed faults. The robot is not told."""

    grasp_misses: int = 0  # number of first grasps of each object in which the fingers close on nothing
    grasp_slips: int = 0  # number of grasps of each object, after those, in which it slips when lifted
    grasp_failure_probability: float = 0.0  # of any grasp after those: the fingers close on nothing
    grasp_delay: float = 0.0  # [s] added to the time that the fingers take to a firm hold
    grasp_delay_spread: float = 0.0  # [s] largest further delay, drawn anew for each grasp
    only_object: int = 0  # only the n-th object grasped is affected, counted from 1; 0: every one
    cube_moved_by: float = 0.0  # [m] by which somebody moves each cube on its support before it is picked
    cube_moved_within: float = 1.0  # [m] from the robot's base, which is on its way to the cube, when that happens
    inject: tuple[TimedFault, ...] | None = None  # sensors and parts of the robot that fail; None: nothing does


# [Nm] of external torque from which the Panda stops, while a joint keeps its rate and while it accelerates: libfranka,
# examples/examples_common.cpp, setDefaultBehavior, setCollisionBehavior for all joints
REFLEXES = {"nominal": 10.0, "accelerating": 20.0}


class Physics(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contact dynamics instead of kinematics (`motm_twin.physics`).

    base_mass: the Omron LD-60 weighs 62 kg with its battery; with electronics of the arm 70 kg.

    grip_force: the Franka Hand holds with up to 70 N (data sheet of the Franka Hand, continuous force); 40 N of them.

    pad_friction: rubber on wood 0.7 to 0.95; object_friction: wood on wood 0.25 to 0.5; wheel_friction: rubber on
    concrete 0.6 to 0.85, all dry (The Engineering ToolBox, Friction Coefficients).

    object_density: beech wood, 700 kg/m^3 (The Wood Database, 720): a cube of 4 cm weighs 45 g.
    """

    base_mass: Annotated[float, Between(20.0, 500.0, unit="kg")] = 70.0  # without the arm
    wheel_friction: Annotated[float, Between(0.1, 2.0)] = 0.8
    grip_force: Annotated[float, Between(5.0, 70.0, unit="N")] = 40.0  # of each pad
    pad_friction: Annotated[float, Between(0.05, 2.0)] = 0.8
    object_friction: Annotated[float, Between(0.05, 2.0)] = 0.4  # on furniture and on each other
    object_density: Annotated[float, Between(20.0, 8000.0, unit="kg/m^3")] = 700.0
    object_mass: Annotated[float, Between(0.0, 2.0, unit="kg")] = 0.0  # of every object; 0: by its density
    closing_delay: Annotated[float, Between(0.0, 1.0, unit="s")] = 0.0  # from a command to the first motion of fingers


class Scene(msgspec.Struct, frozen=True, kw_only=True):
    """One variant and seed of a scene file."""

    name: str
    variant: str
    seed: int
    title: str
    robot: RobotProfile
    start: PlanarPose
    solids: tuple[Solid, ...]
    objects: tuple[SceneObject, ...]
    bins: tuple[Bin, ...]
    bumps: tuple[Bump, ...] = ()
    agents: tuple[Agent, ...]
    tasks: tuple[Task, ...]
    noise: Noise
    mismatch: Mismatch = Mismatch()
    detections: str = "named"  # anonymous: the camera does not know which object it sees; named: markers on them
    faults: Faults = Faults()
    grasp_rule: str = "strict"  # of the kinematic plant, one of `GRASP_RULES`
    grasp_speed: float = 0.03  # [m/s] of the hand over a cube, beyond which the rule ``strict`` loses it
    physics: Physics | None = None  # contact dynamics, by `motm_twin.physics`; None: the kinematic plant
    bounds: tuple[float, float, float, float]  # x_min, y_min, x_max, y_max of the map
    time_limit: float = 300.0  # [s] of simulated time, after which a run has failed
