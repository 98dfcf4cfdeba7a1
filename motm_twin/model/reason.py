"""Reasons why the robot stands, is slowed, waits, drives to a place, or lacks something.

Code reads the fields of a `Reason`; people read its sentence, which is made here and nowhere else.
"""

from enum import StrEnum

import msgspec


class Kind(StrEnum):
    """Kinds of reasons. The first ones are also the kinds of findings of the robot's self-check."""

    SCAN_BAD = "scan_bad"
    SCAN_OLD = "scan_old"
    STATE_OLD = "state_old"
    SCAN_FROZEN = "scan_frozen"
    SCAN_BLIND = "scan_blind"
    SCAN_SECTOR = "scan_sector"
    SCAN_NOISY = "scan_noisy"
    POSE_OFF = "pose_off"
    POSE_LOST = "pose_lost"
    PUSHED = "pushed"
    SLIP = "slip"
    ODOMETRY_OFF = "odometry_off"
    BASE_LATE = "base_late"
    BASE_STUCK = "base_stuck"
    JOINT_STUCK = "joint_stuck"
    FINGERS_STUCK = "fingers_stuck"
    CAMERA_GHOST = "camera_ghost"
    CAMERA_TWICE = "camera_twice"
    CAMERA_UNKNOWN = "camera_unknown"
    CAMERA_SWAP = "camera_swap"
    CAMERA_LOST = "camera_lost"
    CAMERA_LATE = "camera_late"
    # what comes of them
    STOPPED = "stopped"
    SLOWED = "slowed"
    # the monitors
    NOT_FINITE = "not_finite"
    NO_SCAN = "no_scan"
    FLOOR_UNSEEN = "floor_unseen"
    FLOOR_STALE = "floor_stale"
    INSIDE_BASE = "inside_base"
    IN_STOPPING_WAY = "in_stopping_way"
    MEETS_MOVER = "meets_mover"
    ARM_FOLDS = "arm_folds"
    ARM_NEAR_SOLID = "arm_near_solid"
    # placement of the base
    NO_TARGET = "no_target"
    RING = "ring"
    IN_REACH = "in_reach"
    DRIVE = "drive"
    CLOSEST = "closest"
    WAITS_AT_CLOSEST = "waits_at_closest"
    SOON_FREE = "soon_free"
    BESIDE_TAKEN = "beside_taken"
    WAITS_BESIDE_TAKEN = "waits_beside_taken"
    NO_CANDIDATE = "no_candidate"
    NOT_FREE = "not_free"
    CLOSED_IN = "closed_in"
    UNREACHABLE = "unreachable"
    OUTSIDE_MAP = "outside_map"
    POINT_OUTSIDE_MAP = "point_outside_map"
    STATIONARY = "stationary"
    OWN = "own"
    WHOLE_BODY = "whole_body"
    TANGENT = "tangent"
    REHEARSED = "rehearsed"
    REHEARSAL_OVER = "rehearsal_over"
    REHEARSAL_REFUSED = "rehearsal_refused"
    # motion of the base
    NOTHING_TO_DO = "nothing_to_do"
    NO_WAY = "no_way"
    LEAVES_REACH = "leaves_reach"
    NO_MOTION = "no_motion"
    MAKES_WAY = "makes_way"
    GIVES_WAY = "gives_way"
    IS_GIVEN_WAY = "is_given_way"
    PASSES_BEHIND = "passes_behind"
    PASSES_IN_FRONT = "passes_in_front"
    KEEPS_CLEAR = "keeps_clear"
    OVERLAP_STANDS = "overlap_stands"
    OVERLAP_LEAVES = "overlap_leaves"
    BACKS_OFF = "backs_off"
    TURNS_TO_SEE = "turns_to_see"
    BY_HAND = "by_hand"
    GUARDED = "guarded"
    BY_AGENT = "by_agent"
    HAND_HELD_UP = "hand_held_up"
    NO_BETTER_MOTION = "no_better_motion"
    # the arm
    WAITS_FOR_SIGHT = "waits_for_sight"
    WAITS_FOR_STATE = "waits_for_state"
    IMPRECISE = "imprecise"
    NO_ROOM = "no_room"
    NOTHING_ACHIEVED = "nothing_achieved"
    STARTS_OVER = "starts_over"
    GRIPPER_NOT_OPEN = "gripper_not_open"
    HELD_ALREADY = "held_already"
    NOTHING_HELD = "nothing_held"
    SLIPPED = "slipped"
    SLIPPED_IN_LIFT = "slipped_in_lift"
    CLOSED_ON_NOTHING = "closed_on_nothing"
    LEFT_OBJECT = "left_object"
    PUSHED_AWAY = "pushed_away"
    OPENS_AGAIN = "opens_again"
    OUT_OF_REACH = "out_of_reach"
    GAVE_WAY = "gave_way"
    ARM_STANDS = "arm_stands"
    ARM_WITHDRAWS = "arm_withdraws"
    ARM_STOPPED = "arm_stopped"
    ARM_COMMANDED = "arm_commanded"
    HELD_OFF = "held_off"
    PHASE = "phase"
    AT_TARGET = "at_target"
    # the task list
    ALL_DONE = "all_done"
    NO_TASKS = "no_tasks"
    ALL_ENDED = "all_ended"
    NO_PLACE_TASK = "no_place_task"


class Reason(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """One reason. ``value`` and ``limit`` are measured and allowed, or the two numbers of its sentence."""

    kind: Kind
    subject: str = ""  # sensor, part, body or target that it is about
    other: str = ""  # second thing, or a detail in words
    value: float = 0.0
    limit: float = 0.0
    unit: str = ""
    cause: "Reason | None" = None

    def __str__(self) -> str:
        """The sentence."""
        return sentence(self)

    def about(self, *kinds: Kind) -> "Reason | None":
        """This reason or the cause behind it that is of one of these kinds."""
        if self.kind in kinds:
            return self
        return None if self.cause is None else self.cause.about(*kinds)

    @property
    def key(self) -> tuple[str, ...]:
        """Kinds and names without numbers: two reasons with the same key count as one."""
        return (self.kind, self.subject, *(() if self.cause is None else self.cause.key))


_SENTENCES = {
    Kind.SCAN_BAD: "scan rejected: {subject}",
    Kind.SCAN_OLD: "the newest lidar scan is {value:.2f} s old, more than {limit:.2f} s",
    Kind.STATE_OLD: "the newest state of the robot is {value:.2f} s old, more than {limit:.2f} s",
    Kind.SCAN_FROZEN: "the lidar has sent the same scan {value:.0f} times",
    Kind.SCAN_SECTOR: "the lidar sees nothing across {value:.0f} deg in which the map has furniture",
    Kind.SCAN_BLIND: "only {value:.0f} beams of the lidar return where {limit:.0f} should",
    Kind.SCAN_NOISY: "the ranges of the lidar scatter by {value:.2f} m, more than {limit:.2f} m",
    Kind.POSE_OFF: "driving by odometry: localisation is {value:.2f} m off, and neither wheels nor scan agree with it",
    Kind.POSE_LOST: "localisation is {value:.2f} m off, and after {limit:.0f} m on odometry alone the robot is lost",
    Kind.PUSHED: "pushed by {value:.2f} m, unnoticed by the wheels",
    Kind.SLIP: "the wheels slip: the robot is {value:.2f} m from where they put it",
    Kind.ODOMETRY_OFF: "odometry jumped by {value:.2f} m, farther than wheels can drive: ignored",
    Kind.BASE_LATE: "the base responds {value:.1f} s late, more than {limit:.1f} s",
    Kind.BASE_STUCK: "the base does not do as told: it moves at {value:.2f} {unit} instead of {limit:.2f} {unit}",
    Kind.JOINT_STUCK: "{subject} of the arm does not follow its commands",
    Kind.FINGERS_STUCK: "the fingers should {other} but stay at {value:.0f} mm",
    Kind.CAMERA_GHOST: "the camera reports {subject} where it cannot look: ignored",
    Kind.CAMERA_TWICE: "the camera reports {subject} twice, {value:.2f} m apart: the new one is ignored",
    Kind.CAMERA_UNKNOWN: "the camera reports something where no object is known: ignored",
    Kind.CAMERA_SWAP: "the camera reports {subject} where {other} is: ignored",
    Kind.CAMERA_LOST: "the camera does not report {subject}, which should be in its view",
    Kind.CAMERA_LATE: "the camera's detections are {value:.1f} s old",
    Kind.STOPPED: "stopped: {cause}",
    Kind.NOT_FINITE: "{subject} not finite",
    Kind.NO_SCAN: "no usable lidar scan has arrived yet",
    Kind.FLOOR_UNSEEN: "braking: the lidar has never seen the floor ahead",
    Kind.FLOOR_STALE: "slowed to {limit:.1f} m/s: the lidar has not seen the floor ahead lately",
    Kind.INSIDE_BASE: "stopped: the lidar sees something {value:.2f} m inside the base, which may only move off it",
    Kind.IN_STOPPING_WAY: (
        "braking {other}: something is within the {limit:.2f} m that the base needs to stop "
        "(nearest: {value:.2f} m from the lidar)"
    ),
    Kind.MEETS_MOVER: "braking: something {value:.2f} m away moves at {limit:.1f} m/s and would meet the base",
    Kind.ARM_FOLDS: "braking: the hand would fold onto the forearm",
    Kind.ARM_NEAR_SOLID: "braking: {limit:.3f} m from {other}, the {subject} would close in at {value:.2f} m/s",
    Kind.NO_TARGET: "there is no target",
    Kind.RING: (
        "cheapest place to stand, at {other}: {value:.1f} s to get there and {limit:.1f} s on to the next target"
    ),
    Kind.IN_REACH: (
        "{cause}: closest pose in reach, {value:.1f} s to get there and {limit:.1f} s on to the next target"
    ),
    Kind.DRIVE: "drive target: {value:.1f} s to get there and {limit:.1f} s on to the next target",
    Kind.CLOSEST: "{cause}: driving to the closest free place, {value:.2f} m from it",
    Kind.WAITS_AT_CLOSEST: "{cause}: waiting at the closest free place, {value:.2f} m from it",
    Kind.SOON_FREE: (
        "somebody is expected at the cheapest candidate of {subject} in {limit:.1f} s: it is free {value:.1f} s later"
    ),
    Kind.BESIDE_TAKEN: (
        "moving obstacles take every place to stand for {subject}: driving to free floor beside them, "
        "{value:.1f} s from the nearest"
    ),
    Kind.WAITS_BESIDE_TAKEN: (
        "moving obstacles take every place to stand for {subject}: waiting beside them, {value:.1f} s from the nearest"
    ),
    Kind.NO_CANDIDATE: "no free place to stand within {limit:.2f} m of {subject}",
    Kind.NOT_FREE: "{subject} is {other}",
    Kind.CLOSED_IN: "no place to stand for {subject} can be reached: obstacles block every way",
    Kind.UNREACHABLE: "{cause}: no place to stand for it can be reached",
    Kind.OUTSIDE_MAP: "{subject} at ({value:.2f}, {limit:.2f}) is outside the map, {other}",
    Kind.POINT_OUTSIDE_MAP: "{subject} is outside the map, {other}",
    Kind.STATIONARY: "{other}",
    Kind.OWN: "{other}",
    Kind.WHOLE_BODY: "base and arm move as one, so there is no place to stand",
    Kind.TANGENT: "tangent point {value:.2f} m away, {limit:.0f} deg off heading",
    Kind.REHEARSED: "as rehearsed",
    Kind.REHEARSAL_OVER: "the rehearsed plan is over{other}",
    Kind.REHEARSAL_REFUSED: "the task list has changed, but not the plan: {other}",
    Kind.NOTHING_TO_DO: "there is nothing to do",
    Kind.NO_WAY: "no way to {subject}: every gap is narrower than {limit:.2f} m",
    Kind.LEAVES_REACH: "no motion of the base keeps {subject} in reach of the arm: braking",
    Kind.NO_MOTION: (
        "no collision-free motion towards {subject} ({limit:.0f} tried, {value:.2f} m of clearance): braking"
    ),
    Kind.MAKES_WAY: "moving out of the way of something that comes at {value:.1f} m/s",
    Kind.GIVES_WAY: "giving way to {subject}, which comes at {value:.1f} m/s",
    Kind.IS_GIVEN_WAY: "{subject}, which goes at {value:.1f} m/s, has to give way in {limit:.1f} s",
    Kind.PASSES_BEHIND: "passing behind {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    Kind.PASSES_IN_FRONT: (
        "passing in front of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s"
    ),
    Kind.KEEPS_CLEAR: "keeping clear of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    Kind.OVERLAP_STANDS: (
        "the base overlaps a mapped or seen obstacle by {value:.2f} m, and no motion reduces that: standing still"
    ),
    Kind.OVERLAP_LEAVES: "the base overlaps a mapped or seen obstacle by {value:.2f} m: backing out",
    Kind.BACKS_OFF: "{cause}; backing off to where there is more room",
    Kind.TURNS_TO_SEE: "{cause}; turning to see more",
    Kind.BY_HAND: "driven by hand",
    Kind.GUARDED: "slowed: at that speed the base could not stop clear of mapped obstacles",
    Kind.BY_AGENT: "an agent drives the base",
    Kind.HAND_HELD_UP: "the hand is held up on its way to {subject}, or about to leave",
    Kind.NO_BETTER_MOTION: "no motion towards {subject} is better than standing still ({value:.0f} tried)",
    Kind.WAITS_FOR_SIGHT: "waiting to see {subject}",
    Kind.WAITS_FOR_STATE: "waiting for the robot to report where its hand is",
    Kind.IMPRECISE: "{subject} is only known to within {value:.0f} mm",
    Kind.NO_ROOM: "no room for the fingers beside {subject}: {other} is in the way",
    Kind.NOTHING_ACHIEVED: "no progress at {subject} for a while: starting over from the stow pose",
    Kind.STARTS_OVER: "starting over from the stow pose",
    Kind.GRIPPER_NOT_OPEN: "the gripper is not open yet",
    Kind.HELD_ALREADY: "an object is already held",
    Kind.NOTHING_HELD: "nothing is held, so there is nothing to place",
    Kind.SLIPPED: "the object slipped out of the gripper",
    Kind.SLIPPED_IN_LIFT: "the object slipped while it was lifted: trying again",
    Kind.CLOSED_ON_NOTHING: "the fingers closed on nothing: trying again",
    Kind.LEFT_OBJECT: "the hand could not stay on the object: trying again",
    Kind.PUSHED_AWAY: "the object was pushed away: trying again",
    Kind.OPENS_AGAIN: "opening the fingers for another try at {subject}",
    Kind.OUT_OF_REACH: "{subject} went out of reach",
    Kind.GAVE_WAY: "moved off at {value:.2f} m/s ({subject}): too near for the joints to brake in time",
    Kind.ARM_STANDS: "the lidar sees something {value:.2f} m inside the {subject}: the arm stands still",
    Kind.ARM_WITHDRAWS: "the lidar sees something {value:.2f} m inside the {subject}: the arm draws back slowly",
    Kind.ARM_STOPPED: "the arm was stopped: {other}",
    Kind.ARM_COMMANDED: "the arm is {other}",
    Kind.HELD_OFF: "the {subject} keeps off a {other}, {value:.2f} m away",
    Kind.ALL_DONE: "all {value:.0f} tasks are done{other}",
    Kind.NO_TASKS: "there are no tasks{other}",
    Kind.ALL_ENDED: "all {value:.0f} tasks have ended, {limit:.0f} given up: {other}",
    Kind.NO_PLACE_TASK: "{subject} is in the gripper, but no task says where it goes: {other}put a place task first",
}


def own(sentence: str, subject: str = "") -> Reason:
    """Reason of a user's own method, in free text."""
    return Reason(kind=Kind.OWN, subject=subject, other=sentence)


def sentence(reason: Reason) -> str:
    """The reason in one sentence, with names and numbers."""
    match reason.kind:
        case Kind.SLOWED:
            share = "half speed" if reason.value == 0.5 else f"{100.0 * reason.value:.0f} % of its speed"
            return f"slowed to {share}: {reason.cause}"
        case Kind.BY_HAND if reason.other:
            return f"driven by hand, and slowed: an obstacle is {reason.value:.2f} m away"
        case Kind.MEETS_MOVER if reason.value <= 0.0:
            return f"braking: something at the base moves at {reason.limit:.1f} m/s and would meet it"
        case Kind.PHASE:
            return f"waiting for the arm at {reason.subject}: {reason.other}{_tries(reason)}"
        case Kind.AT_TARGET:
            about = "" if reason.cause is None or reason.cause.subject == reason.subject else f"{reason.subject}: "
            return f"{about}{reason.cause}{_tries(reason)}"
    return _SENTENCES[reason.kind].format(
        subject=reason.subject, other=reason.other, value=reason.value, limit=reason.limit, unit=reason.unit,
        cause=reason.cause,
    )  # fmt: skip


def _tries(reason: Reason) -> str:
    return f" (try {reason.value:.0f} of {reason.limit:.0f})" if reason.value > 1.0 else ""
