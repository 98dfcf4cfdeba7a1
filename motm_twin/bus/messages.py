"""What travels on Zenoh, version 1: JSON made from these structs (UTF-8; lengths [m], angles [rad], times [s]).

Numbers that are infinite or undefined (the cost of a rejected candidate) are ``null``. Fields may be added within a
version; a change of meaning or a removal makes a new one.
"""

import msgspec

from motm_twin.model.edits import Edit, ParameterValue

TICK_VERSION = "motm.tick/1"
STATUS_VERSION = "motm.status/1"
GRID_VERSION = "motm.grid/1"
ROBOT_VERSION = "motm.robot/1"
SCAN_VERSION = "motm.scan/1"
EVENT_VERSION = "motm.event/1"
EVENTS_VERSION = "motm.events/1"
METRICS_VERSION = "motm.metrics/1"
SCENE_VERSION = "motm.scene/1"

Vector = list[float]
Vectors = list[list[float]]
MaybeNumber = float | None


class RobotMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The robot now."""

    pose: Vector  # localised base pose x, y, heading, world
    true_pose: Vector  # ground truth where there is one, else the same
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    q: Vector  # arm joints, 7
    dq: Vector  # arm joint rates [rad/s], 7
    gripper_width: float


class BodyMessage(msgspec.Struct, frozen=True, kw_only=True):
    """An object, agent or added obstacle, as it truly is."""

    name: str
    kind: str
    position: Vector  # centre of an object, floor point of anything else
    yaw: float
    state: str
    size: Vector


class TaskMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One entry of the task list."""

    kind: str
    target: str
    status: str
    attempts: int


class BeliefMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Where the robot believes an object is."""

    name: str
    position: Vector
    yaw: float
    position_sd: float
    seen: bool
    held: bool


class PlacementMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Candidate base poses with both costs, or why each is rejected."""

    mode: str
    radius: float
    poses: Vectors  # (n, 3)
    cost_current: list[MaybeNumber]  # [s]
    cost_next: list[MaybeNumber]  # [s]
    cost: list[MaybeNumber]  # [s]
    rejected: list[str]
    chosen: int
    goal: list[MaybeNumber]  # the heading is null when any will do
    goal_has_heading: bool
    reason: str
    next_goal: list[MaybeNumber] | None


class InspectedMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The two paths behind the costs of one candidate, as asked for by an Inspect command."""

    candidate: int
    path: Vectors  # robot to candidate, shape (m, 2)
    next_path: Vectors  # candidate to the next target, shape (k, 2); empty without one


class PlanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """What the base does and the plan behind it."""

    status: str
    reason: str
    acceleration: Vector
    global_path: Vectors
    next_path: Vectors
    intermediate_goal: list[MaybeNumber]
    local_poses: Vectors  # (j, 5)
    local_times: Vector
    bezier: Vectors
    expansions: int
    cut_by_clock: bool
    t_h: MaybeNumber
    k: float
    time_to_range: MaybeNumber
    staa_path: Vectors = []  # shortest path of unmodified STAA*, when asked for


class ArmMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One arm step, and why."""

    time: float
    phase: str
    base_twist: Vector
    joint_velocity: Vector
    gripper: str
    reference: Vector
    error: MaybeNumber
    tilt: MaybeNumber
    slack: list[MaybeNumber]
    manipulability: MaybeNumber
    active: list[str]
    limiter: str
    obstacle_distance: MaybeNumber
    allowed_approach: MaybeNumber
    qp_status: str
    holding: bool
    outcome: str
    reason: str


class EventMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Something worth telling."""

    time: float
    kind: str
    text: str


class ContactMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One contact, as the referee saw it."""

    time: float
    body: str
    other: str
    depth: float
    closing_speed: float
    other_speed: float
    caused_by_robot: bool
    duration: float


class ScoreMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The referee's count so far."""

    picks: int
    places: int
    drops: int
    contacts: list[ContactMessage]
    min_base_clearance: MaybeNumber
    min_arm_clearance: MaybeNumber
    min_ee_obstacle: MaybeNumber
    ee_obstacle: MaybeNumber
    path_length: float = 0.0  # [m] driven by the base so far


class TickMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One control period without its map, which is sent apart."""

    version: str
    run: int  # counts loads, resets and branches of this server
    server_time: float  # [s] when it was sent, on the server's clock
    index: int
    time: float  # [s] simulated
    robot: RobotMessage
    objects: list[BodyMessage]
    agents: list[BodyMessage]
    obstacles: list[BodyMessage]
    tasks: list[TaskMessage]
    task_index: int
    beliefs: list[BeliefMessage]
    placement: PlacementMessage
    plan: PlanMessage
    arm: list[ArmMessage]
    stop_reason: str
    events: list[EventMessage]
    stage_ms: dict[str, float]
    score: ScoreMessage | None
    done: bool
    success: bool
    furniture: list[BodyMessage] = []  # pieces that stand elsewhere than in the scene: reference point, turn as yaw
    removed: list[str] = []  # pieces and agents of the scene that are gone
    faults: list[str] = []  # injected faults that last, one phrase each
    inspected: InspectedMessage | None = None
    began: float = 0.0  # [s] server time of the load or reset; a branch keeps it: its past is that of the run before
    first: int = 0  # first period of this run: where it branched from another, else 0
    past: int = -1  # run whose periods before `first` this one shares; -1: the run before, if `began` is the same
    preview: bool  # True: paused; bodies stand where posted edits will put them in the next period
    edits: list[Edit] = []  # applied at the start of this period


class SceneChoice(msgspec.Struct, frozen=True, kw_only=True):
    """One scene that can be loaded."""

    name: str
    title: str
    variants: list[str]


class StatusMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The server itself: sent on every change, and twice a second as a sign of life."""

    version: str
    twin: str
    run: int
    server_time: float  # [s] expiry times of commands are on this clock
    state: str  # loading | playing | paused | done | error
    text: str  # one sentence about the state
    scene: str
    variant: str
    seed: int
    time: float  # [s] simulated
    speed: float  # wanted real-time factor
    actual_speed: float  # reached over the last second
    capped: bool  # the machine can not keep up with the wanted speed
    scenes: list[SceneChoice]
    driver: str = ""  # sender that holds the wheel; "": nobody, the next who acts takes it
    driver_name: str = ""
    driver_left: float = 0.0  # [s] of silence after which the wheel is free
    parameters: dict[str, ParameterValue] = {}  # those that were changed, by name
    oldest: int = 0  # first period that `branch` can go back to
    aside: MaybeNumber = None  # [s] end of the run that `undo_branch` brings back; null: there is none
    recorded: int = 0  # edits in the log of this run
    reference_tour: MaybeNumber = None  # [s] lower bound of this scene's task, see bench.reference_tour
    plant: str = "simulated"  # simulated | zenoh (an external robot is commanded) | mirror (one is only shown)
    plant_text: str = ""  # one sentence about the external robot; "" for a simulated one
    recording: str = ""  # file that the server writes now; "" when it writes none


class GridInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Attachment of a grid: how to read its bytes."""

    version: str
    run: int
    encoding: str  # "u8: 255 occupied, else 254 * proximity; rows from y_min to y_max"
    resolution: float
    origin: Vector  # world corner of the first cell, shape (2,)
    width: int
    height: int
    stamp: float


class RobotStateMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one instant, 50 times a second of simulated time."""

    version: str
    run: int
    server_time: float  # [s] when it was sent
    time: float  # [s] simulated, or on the clock of the external robot
    pose: Vector  # localised base pose x, y, heading, world
    odometry: Vector  # dead-reckoned base pose x, y, heading
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    joint_names: list[str]
    q: Vector  # arm joints, 7
    dq: Vector  # arm joint rates [rad/s], 7
    gripper_width: float
    gripper_moving: bool
    frames: dict[str, Vector]  # world frame: x, y, z, then the quaternion w, x, y, z


class ScanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One sweep of the lidar; beam i points at ``angle_min + i * angle_step`` in the base frame."""

    version: str
    run: int
    server_time: float
    stamp: float  # [s]
    pose: Vector  # localised base pose at the stamp, world
    origin: Vector  # sensor position in the base frame, shape (2,)
    angle_min: float
    angle_step: float
    range_min: float
    range_max: float
    ranges: list[MaybeNumber]  # null: no return within range_max


class NumberedEvent(msgspec.Struct, frozen=True, kw_only=True):
    """An event on its own key. Numbers rise by one without gaps for as long as the server lives."""

    version: str
    seq: int  # from 1
    numbered_since: float = 0.0  # [s] server time of the start of the server; another one: the numbers began again
    run: int
    server_time: float
    index: int  # period
    time: float  # [s] simulated
    kind: str  # picked placed missed lost arrived failed contact stop go edit loaded reset branch done error
    text: str
    body: str = ""  # contact: of the robot
    other: str = ""  # contact: what it touched; else the object or bin
    caused_by_robot: bool | None = None  # contact only


class EventsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Answer to a query ``event?from=SEQ``: the events from that number on, as far as they are kept."""

    version: str
    numbered_since: float  # [s] as in each event
    oldest: int  # number of the oldest event that is kept
    newest: int  # number of the newest; 0 before the first
    events: list[NumberedEvent]  # oldest first


class MetricsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """How it goes, once a second."""

    version: str
    run: int
    server_time: float
    time: float  # [s] simulated
    state: str
    speed: float
    actual_speed: float
    period_ms: dict[str, float]  # p50, p99, max of the last 10 s of periods
    stage_ms: dict[str, float]  # mean of the last second, by stage
    overruns: int  # periods that took longer than 50 ms, this run
    tasks_done: int
    tasks_total: int
    picks: int
    places: int
    drops: int
    contacts: int
    contacts_caused_by_robot: int
    path_length: float
    min_base_clearance: MaybeNumber
    min_arm_clearance: MaybeNumber
    min_ee_obstacle: MaybeNumber
    reference_tour: MaybeNumber
    memory_mb: float  # resident memory of the server process


GRID_ENCODING = "u8: 255 occupied, else 254 * proximity; rows from y_min to y_max"
