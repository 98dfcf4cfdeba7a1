"""Messages on Zenoh, version 1: JSON made from these structs (UTF-8; lengths [m], angles [rad], times [s]).

Numbers that are infinite or undefined (the cost of a rejected candidate) are ``null``. Fields may be added within a
version; a change of meaning or a removal makes a new one.
"""

import msgspec

from motm_twin.bus.plant_messages import DetectionData
from motm_twin.methods import UNNAMED_METHOD
from motm_twin.model.edits import Edit, ParameterValue
from motm_twin.model.reason import Reason

TICK_VERSION = "motm.tick/1"
STATUS_VERSION = "motm.status/1"
GRID_VERSION = "motm.grid/1"
SESSION_INFO_VERSION = "motm.session_info/1"
ROBOT_VERSION = "motm.robot/1"
SCAN_VERSION = "motm.scan/1"
OBSERVATIONS_VERSION = "motm.observations/1"
EVENT_VERSION = "motm.event/1"
EVENTS_VERSION = "motm.events/1"
METRICS_VERSION = "motm.metrics/1"
SCENE_VERSION = "motm.scene/1"
SCENE_INFO_VERSION = "motm.scene_info/1"

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
    gripper_width: float  # [m] between the finger pads


class BodyMessage(msgspec.Struct, frozen=True, kw_only=True):
    """An object, agent or added obstacle, as it truly is."""

    name: str  # unique in the scene
    kind: str  # cube | temi | person | box | cylinder | table | ...
    position: Vector  # centre of an object, floor point of anything else
    yaw: float  # [rad]
    state: str  # objects: resting | held | binned:<bin> | dropped; agents: driving | waiting | held | ...
    size: Vector  # extents x, y, z [m]
    behaviour: str = ""  # of an agent: yield | blind | orca | social_force


class TaskMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One entry of the task list."""

    kind: str  # pick | place | drive_to
    target: str  # object, bin, or "(x, y)"
    status: str  # waiting | active | done | failed
    attempts: int  # so far


class BeliefMessage(msgspec.Struct, frozen=True, kw_only=True):
    """An object as the robot believes it to be."""

    name: str
    position: Vector  # centre x, y, z, world
    yaw: float  # [rad]
    position_sd: float  # [m] how sure
    seen: bool  # by the palm camera
    held: bool  # in the gripper


class PlacementMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Candidate base poses with both costs, or why each is rejected."""

    mode: str  # ring | reach (any free pose in reach) | closest (free place) | drive | none
    radius: float  # [m] of the ring
    poses: Vectors  # (n, 3)
    cost_current: list[MaybeNumber]  # [s]
    cost_next: list[MaybeNumber]  # [s]
    cost: list[MaybeNumber]  # [s]
    rejected: list[str]  # why a candidate is out; "": it is not
    chosen: int  # index of the chosen one; -1: none
    goal: list[MaybeNumber]  # the heading is null when any will do
    goal_has_heading: bool  # whether the heading of the goal matters
    reason: str  # one sentence
    next_goal: list[MaybeNumber] | None  # of the target after this one
    why: Reason | None = None  # `reason`, typed


class InspectedMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The two paths behind the costs of one candidate, as asked for by an Inspect command."""

    candidate: int
    path: Vectors  # robot to candidate, shape (m, 2)
    next_path: Vectors  # candidate to the next target, shape (k, 2); empty without one


class TrackMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A dynamic obstacle as the lidar tracks it, and where it is expected."""

    track: int  # identity, kept while it is followed
    position: Vector  # middle x, y, world
    velocity: Vector  # [m/s]
    radius: float  # [m]
    position_sd: float  # [m] how sure
    expected: Vectors  # after 1, 2, 3 s: [s], x, y, half axes along and across its way [m], direction; (n, 6)
    pace: float = 0.0  # [m/s] its speed, for older readers


class EncounterMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A dynamic obstacle that the base comes near to when the plan is carried out."""

    track: int  # of one of the tick's `tracks`
    yields: str  # who gives way: robot | other | "" (nobody has to)
    passes: str  # where the base crosses its way: behind | in front | "" (it does not cross it)
    time: float  # [s] from now until both are nearest
    gap: float  # [m] between them then
    speed: float  # [m/s] of the other
    courtesy: float  # [s] of the other's time that the plan takes
    why: Reason  # the same in one sentence, typed
    reason: str  # one sentence


class PlanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Motion of the base and the plan behind it."""

    status: str  # goal (reached by the search) | aborted (best so far) | braking | idle
    reason: str  # one sentence when there is no plan
    acceleration: Vector  # chosen: forward [m/s^2], yaw [rad/s^2]
    global_path: Vectors  # robot to goal, shape (m, 2)
    next_path: Vectors  # goal to the next target, shape (k, 2)
    intermediate_goal: list[MaybeNumber]  # x, y, heading that the local search goes for
    local_poses: Vectors  # (j, 5): x, y, heading, v, w
    local_times: Vector  # [s] of the local poses, from now
    bezier: Vectors  # curve behind the local plan, shape (n, 2)
    expansions: int  # of the search
    cut_by_clock: bool  # the search ended because time was up
    t_h: MaybeNumber  # [s] predicted time to the goal
    k: float  # scale of the proximity penalty
    time_to_range: MaybeNumber  # [s] until the target is in reach; 0: it is
    staa_path: Vectors = []  # shortest path of unmodified STAA*, when asked for
    why: Reason | None = None  # `reason`, typed
    encounters: list[EncounterMessage] = []  # with dynamic obstacles, the soonest first; of methods with foresight
    courtesy: float = 0.0  # [s] of the others' time that the plan takes, one of its costs


class ArmMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One arm step, and why."""

    time: float  # [s]
    phase: str  # stow | transit | final | closing | lift | carry | release | retry | ...
    base_twist: Vector  # commanded: forward [m/s], yaw [rad/s]
    joint_velocity: Vector  # commanded [rad/s], 7
    gripper: str  # open | close
    reference: Vector  # wanted tool centre point, odometry frame
    error: MaybeNumber  # [m] from the reference
    tilt: MaybeNumber  # [rad] of the tool from the vertical
    slack: list[MaybeNumber]  # of the end effector's velocity, 6
    manipulability: MaybeNumber  # of the arm
    active: list[str]  # names of the active rows and bounds of the quadratic program
    limiter: str  # obstacle that limits the gripper now; "": none
    obstacle_distance: MaybeNumber  # [m] of the gripper to it
    allowed_approach: MaybeNumber  # [m/s] towards it
    qp_status: str  # solved | <gave way, standing, withdrawing or damped stop>: <why>
    holding: bool  # an object is in the gripper
    outcome: str  # picked | placed | missed | lost | stuck, when that was found in this step
    reason: str  # one sentence when the arm waits
    why: Reason | None = None  # the same, typed
    program: str = "solved"  # status of the quadratic program: `qp_status` without the reason


class EventMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Something worth telling."""

    time: float  # [s] simulated
    kind: str  # as on the key `event`
    text: str  # one sentence


class ContactMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One contact, as the referee saw it."""

    time: float  # [s] when it began
    body: str  # that touched first: base, panda_link5, panda_hand, held:<cube>, ..., or a cube that the robot moved
    other: str  # what it touched; an own link where the robot touched itself
    depth: float  # [m] largest
    closing_speed: float  # [m/s] of the robot towards the other, when it began
    other_speed: float  # [m/s] of the other towards the robot
    caused_by_robot: bool
    duration: float  # [s]
    bodies: list[str] = []  # all that touched it in this episode, in order


class CutInMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The robot moved into the area that an agent needs to stop."""

    time: float  # [s]
    agent: str
    gap: float  # [m] between them then
    stopping_way: float  # [m] of the agent: reaction and braking
    speed: float  # [m/s] of the agent


class ScoreMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The referee's count so far: final once the tick has `ended`."""

    picks: int  # so far
    places: int  # so far
    drops: int  # so far
    contacts: list[ContactMessage]  # so far
    min_base_clearance: MaybeNumber  # [m] so far
    min_arm_clearance: MaybeNumber  # [m] so far
    min_ee_obstacle: MaybeNumber  # [m] gripper to anything that is not in the map, so far
    ee_obstacle: MaybeNumber  # [m] the same now
    path_length: float = 0.0  # [m] driven by the base so far
    cut_ins: list[CutInMessage] = []  # so far
    dropped: list[str] = []  # objects that the robot dropped and has not picked up and placed since


class GraspMessage(msgspec.Struct, frozen=True, kw_only=True):
    """A grasp under contact dynamics."""

    object: str
    time: float  # [s] of the command to close
    firm: float  # [s] after it, when both pads held the object firmly
    shift: float  # [m] that the fingers shifted the object by while they closed
    speed: float  # [m/s] largest of the tool centre point while they closed
    slip: float  # [m] largest in the hand since then
    lost: bool  # it slipped out of closed fingers


class ForcesMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Forces of a plant with contact dynamics, at the end of the period."""

    fingers: Vector  # [N] of left and right pad on the object between them
    external_torque: Vector  # [Nm] of the joints, as an arm estimates it that thinks its base at rest
    torque_peaks: Vector  # [Nm] largest magnitudes so far
    phantoms: list[int]  # times that the Panda's thresholds of 10 and 20 Nm were passed while the robot touched nothing
    wrist: Vector  # [N], [Nm] at the hand's mount, weight included
    wrist_peaks: Vector  # largest so far
    grasp: GraspMessage | None  # the newest


class TickMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One control period without its map, which is sent apart."""

    version: str  # motm.tick/1
    run: int  # counts loads, resets and branches of this server
    server_time: float  # [s] when it was sent, on the server's clock
    index: int  # of the period, from 0
    time: float  # [s] simulated
    robot: RobotMessage  # as localised, and as it truly is
    objects: list[BodyMessage]  # cubes, as they truly are
    agents: list[BodyMessage]  # Temis and persons of the scene
    obstacles: list[BodyMessage]  # added by a person or program
    tasks: list[TaskMessage]  # the list
    task_index: int  # of the active task; the number of tasks when all have ended
    beliefs: list[BeliefMessage]  # where the robot believes the objects to be
    placement: PlacementMessage  # candidate base poses and their costs
    plan: PlanMessage  # of the base
    arm: list[ArmMessage]  # arm steps of this period, oldest first
    stop_reason: str  # one sentence whenever the robot stands, is slowed, or does without something; "": none of it
    events: list[EventMessage]  # of this period
    stage_ms: dict[str, float]  # [ms] of wall time, by stage of the period
    score: ScoreMessage | None  # the referee's; null without ground truth
    done: bool  # all tasks have ended; the last cube may still fall, see `ended`
    success: bool  # all tasks are done
    furniture: list[BodyMessage] = []  # pieces that stand elsewhere than in the scene: reference point, turn as yaw
    removed: list[str] = []  # pieces and agents of the scene that are gone
    announced: dict[str, Vector] = {}  # where the robot was told that pieces stand: reference point x, y, turn
    faults: list[str] = []  # injected faults that last, one phrase each
    inspected: InspectedMessage | None = None  # paths of a candidate, as asked for by `inspect`
    began: float = 0.0  # [s] server time of the load or reset; a branch keeps it: its past is that of the run before
    ended: float | None = None  # [s] when the last task was done, and every object in its bin; null before, or never
    first: int = 0  # first period of this run: where it branched from another, else 0
    past: int = -1  # run whose periods before `first` this one shares; -1: the run before, if `began` is the same
    preview: bool  # True: paused; bodies stand where posted edits will put them in the next period
    edits: list[Edit] = []  # applied at the start of this period
    why: Reason | None = None  # `stop_reason`, typed
    forces: ForcesMessage | None = None  # null for a kinematic plant, and for a real robot
    tracks: list[TrackMessage] = []  # dynamic obstacles that the lidar follows


class SceneChoice(msgspec.Struct, frozen=True, kw_only=True):
    """One scene that can be loaded."""

    name: str  # for `load`
    title: str  # to be shown
    variants: list[str]  # for `load`


class MethodChoice(msgspec.Struct, frozen=True, kw_only=True):
    """One method that can drive."""

    name: str  # for `load`
    title: str  # a few words, to be shown
    summary: str  # one sentence: what it does otherwise than the paper's
    parameters: dict[str, ParameterValue] = {}  # it is shipped with, where they are not the defaults


class StatusMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The server itself: sent on every change, and twice a second as a sign of life."""

    version: str  # motm.status/1
    twin: str  # name
    run: int  # counts loads, resets and branches
    server_time: float  # [s] expiry times of commands are on this clock
    state: str  # loading | playing | paused | done | error
    text: str  # one sentence about the state
    scene: str  # name
    variant: str  # "": the scene has none
    seed: int  # of noise and random arrangements
    time: float  # [s] simulated
    speed: float  # wanted real-time factor
    actual_speed: float  # reached over the last second
    capped: bool  # the machine can not keep up with the wanted speed
    scenes: list[SceneChoice]  # that can be loaded
    driver: str = ""  # sender that holds the wheel; "": nobody, the next who acts takes it
    driver_name: str = ""  # to be shown
    driver_left: float = 0.0  # [s] of silence after which the wheel is free
    parameters: dict[str, ParameterValue] = {}  # those that were changed, by name
    oldest: int = 0  # first period that `branch` can go back to
    aside: MaybeNumber = None  # [s] end of the run that `undo_branch` brings back; null: there is none
    recorded: int = 0  # edits in the log of this run
    reference_tour: MaybeNumber = None  # [s] reference time of this scene, see measures.reference_tour
    plant: str = "simulated"  # simulated | zenoh (external, commanded) | mirror (external, only shown) | recording
    plant_text: str = ""  # one sentence about the external robot or the recording; "" for a simulated one
    recording: str = ""  # file that the server writes now; "" when it writes none
    span: Vector = []  # [s] first and last period of the recording that is played; empty: no recording is played
    method: str = UNNAMED_METHOD  # that drives: the name of one of `methods`
    methods: list[MethodChoice] = []  # that can be loaded
    pages: int = -1  # that show it, as `audience` tells it; -1: it need not know
    held: bool = False  # waits at its start until a page shows it, or somebody drives


class GridInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Attachment of a grid: layout of its bytes."""

    version: str  # motm.grid/1
    run: int  # as in the ticks
    encoding: str  # "u8: 255 occupied, else 254 * proximity; rows from y_min to y_max"
    resolution: float  # [m] side of a cell
    origin: Vector  # world corner of the first cell, shape (2,)
    width: int  # cells
    height: int  # cells
    stamp: float  # [s] simulated


class SceneInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Attachment of a scene: the run from which on it holds."""

    version: str = SCENE_INFO_VERSION
    run: int  # that begins with it, as in the ticks


class SessionInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Attachment of a session: the run that it records."""

    version: str = SESSION_INFO_VERSION
    run: int  # as in the ticks
    began: float  # [s] server time of its load or reset, as in the ticks


class RobotStateMessage(msgspec.Struct, frozen=True, kw_only=True):
    """The robot at one instant, 50 times a second of simulated time."""

    version: str  # motm.robot/1
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    time: float  # [s] simulated, or on the clock of the external robot
    pose: Vector  # localised base pose x, y, heading, world
    odometry: Vector  # dead-reckoned base pose x, y, heading
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    joint_names: list[str]  # panda_joint1 to 7
    q: Vector  # arm joints, 7
    dq: Vector  # arm joint rates [rad/s], 7
    gripper_width: float  # [m] between the finger pads
    gripper_moving: bool  # the fingers open or close
    frames: dict[str, Vector]  # world frame: x, y, z, then the quaternion w, x, y, z


class ScanMessage(msgspec.Struct, frozen=True, kw_only=True):
    """One sweep of the lidar; beam i points at ``angle_min + i * angle_step`` in the base frame."""

    version: str  # motm.scan/1
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    stamp: float  # [s]
    pose: Vector  # localised base pose at the stamp, world
    origin: Vector  # sensor position in the base frame, shape (2,)
    angle_min: float  # [rad]
    angle_step: float  # [rad]
    range_min: float  # [m]
    range_max: float  # [m]
    ranges: list[MaybeNumber]  # null: no return within range_max


class ScanSample(msgspec.Struct, frozen=True, kw_only=True):
    """One sweep, exactly; fields as in `model.plant.Scan`, no return is null."""

    stamp: float
    ranges: list[float | None]
    angle_min: float
    angle_step: float
    origin: Vector
    range_min: float
    range_max: float
    pose: Vector


class DetectionSample(DetectionData, frozen=True, kw_only=True):
    """One object seen, exactly."""


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """Input of one arm step; scan and detections only where they differ from the previous sample."""

    time: float  # [s] simulated
    pose: Vector  # localised base pose x, y, heading, world
    odometry: Vector  # dead-reckoned base pose x, y, heading
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    q: Vector  # [rad] arm joints, 7
    dq: Vector  # [rad/s] arm joint rates, 7
    gripper_width: float  # [m]
    gripper_moving: bool
    ahead: float = 0.0  # [s] prediction horizon: from the observation to the time when the command acts
    age: float = 0.0  # [s] of the newest state of the robot
    camera_stamp: float | None = None  # [s] of the newest picture, where the robot tells it
    behind: float = 0.0  # [s] by which pose, odometry, twist and joints are older than the time
    scan: ScanSample | None = None
    detections: list[DetectionSample] | None = None


class ObservationsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Inputs of the arm steps of one period, oldest first. The first period of a run has scan and detections."""

    version: str  # motm.observations/1
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    index: int  # of the period
    samples: list[Sample]
    restarted: bool = False  # control was interrupted before this period


class NumberedEvent(msgspec.Struct, frozen=True, kw_only=True):
    """An event on its own key. Numbers rise by one without gaps for as long as the server lives."""

    version: str  # motm.event/1
    seq: int  # from 1
    numbered_since: float = 0.0  # [s] server time of the start of the server; another one: the numbers began again
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    index: int  # period
    time: float  # [s] simulated; never falls within a run: a contact that is told late keeps its own in the score
    kind: (
        str  # picked placed missed lost arrived failed contact stop go edit refused loaded reset branch done error ...
    )
    text: str  # one sentence
    body: str = ""  # contact: of the robot
    other: str = ""  # contact: what it touched; else the object or bin
    caused_by_robot: bool | None = None  # contact only


class EventsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Answer to a query ``event?from=SEQ``: the events from that number on, as far as they are kept."""

    version: str  # motm.events/1
    numbered_since: float  # [s] as in each event
    oldest: int  # number of the oldest event that is kept
    newest: int  # number of the newest; 0 before the first
    events: list[NumberedEvent]  # oldest first


class MetricsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """Health of the run, once a second."""

    version: str  # motm.metrics/1
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    time: float  # [s] simulated
    state: str  # as in the status
    speed: float  # wanted real-time factor
    actual_speed: float  # reached
    period_ms: dict[str, float]  # p50, p99, max of the last 10 s of periods
    stage_ms: dict[str, float]  # mean of the last second, by stage
    overruns: int  # periods that took longer than 50 ms, this run
    tasks_done: int  # of the list
    tasks_total: int  # of the list
    picks: int  # so far
    places: int  # so far
    drops: int  # so far
    contacts: int  # so far
    contacts_caused_by_robot: int  # so far
    path_length: float  # [m] driven
    min_base_clearance: MaybeNumber  # [m] so far
    min_arm_clearance: MaybeNumber  # [m] so far
    min_ee_obstacle: MaybeNumber  # [m] so far
    reference_tour: MaybeNumber  # [s] reference time of this scene
    memory_mb: float  # resident memory of the server process


GRID_ENCODING = "u8: 255 occupied, else 254 * proximity; rows from y_min to y_max"
