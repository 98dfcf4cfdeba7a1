"""Reasons why the robot stands, is slowed, waits, drives to a place, or lacks something.

Code reads the fields of a `Reason`; people read its sentence, which is made here and nowhere else.
"""

from enum import StrEnum

import msgspec


class Kind(StrEnum):
    """Kinds of reasons. The first ones are also the kinds of findings of the robot's self-check."""

    sentence: str  # format of the sentence; "" where `sentence` makes it

    def __new__(cls, value: str, sentence: str = "") -> "Kind":
        """A kind and its sentence."""
        kind = str.__new__(cls, value)
        kind._value_, kind.sentence = value, sentence
        return kind

    SCAN_BAD = "scan_bad", "scan rejected: {subject}"
    SCAN_OLD = "scan_old", "the newest lidar scan is {value:.2f} s old, more than {limit:.2f} s"
    STATE_OLD = "state_old", "the newest state of the robot is {value:.2f} s old, more than {limit:.2f} s"
    SCAN_FROZEN = "scan_frozen", "the lidar has sent the same scan {value:.0f} times"
    SCAN_BLIND = "scan_blind", "only {value:.0f} beams of the lidar return where {limit:.0f} should"
    SCAN_SECTOR = "scan_sector", "the lidar sees nothing across {value:.0f} deg in which the map has furniture"
    SCAN_NOISY = "scan_noisy", "the ranges of the lidar scatter by {value:.2f} m, more than {limit:.2f} m"
    POSE_OFF = (
        "pose_off",
        "driving by odometry: localisation is {value:.2f} m off, and neither wheels nor scan agree with it",
    )
    POSE_LOST = (
        "pose_lost",
        "localisation is {value:.2f} m off, and after {limit:.0f} m on odometry alone the robot is lost",
    )
    PUSHED = "pushed", "pushed by {value:.2f} m, unnoticed by the wheels"
    SLIP = "slip", "the wheels slip: the robot is {value:.2f} m from where they put it"
    ODOMETRY_OFF = "odometry_off", "odometry jumped by {value:.2f} m, farther than wheels can drive: ignored"
    BASE_LATE = "base_late", "the base responds {value:.1f} s late, more than {limit:.1f} s"
    BASE_STUCK = (
        "base_stuck",
        "the base does not do as told: it moves at {value:.2f} {unit} instead of {limit:.2f} {unit}",
    )
    JOINT_STUCK = "joint_stuck", "{subject} of the arm does not follow its commands"
    FINGERS_STUCK = "fingers_stuck", "the fingers should {other} but stay at {value:.0f} mm"
    CAMERA_GHOST = "camera_ghost", "the camera reports {subject} where it cannot look: ignored"
    CAMERA_TWICE = "camera_twice", "the camera reports {subject} twice, {value:.2f} m apart: the new one is ignored"
    CAMERA_UNKNOWN = "camera_unknown", "the camera reports something where no object is known: ignored"
    CAMERA_SWAP = "camera_swap", "the camera reports {subject} where {other} is: ignored"
    CAMERA_LOST = "camera_lost", "the camera does not report {subject}, which should be in its view"
    CAMERA_LATE = "camera_late", "the camera's newest picture is {value:.1f} s old"
    # consequences of the findings above
    STOPPED = "stopped", "stopped: {cause}"
    SLOWED = "slowed"
    # the monitors
    NOT_FINITE = "not_finite", "{subject} not finite"
    NO_SCAN = "no_scan", "no usable lidar scan has arrived yet"
    FLOOR_UNSEEN = "floor_unseen", "braking: the lidar has never seen the floor ahead"
    FLOOR_STALE = "floor_stale", "slowed to {limit:.1f} m/s: the lidar has not seen the floor ahead lately"
    INSIDE_BASE = (
        "inside_base",
        "stopped: the lidar sees something {value:.2f} m inside the base, which may only move off it",
    )
    IN_STOPPING_WAY = (
        "in_stopping_way",
        "braking {other}: something is within the {limit:.2f} m that the base needs to stop (nearest: {value:.2f} "
        "m from the lidar)",
    )
    MEETS_MOVER = (
        "meets_mover",
        "braking: something {value:.2f} m away moves at {limit:.1f} m/s and would meet the base",
    )
    ARM_FOLDS = "arm_folds", "braking: the hand would fold onto the forearm"
    ARM_NEAR_SOLID = (
        "arm_near_solid",
        "braking: {limit:.3f} m from {other}, the {subject} would close in at {value:.2f} m/s",
    )
    # placement of the base
    NO_TARGET = "no_target", "there is no target"
    RING = (
        "ring",
        "cheapest place to stand, at {other}: {value:.1f} s to get there and {limit:.1f} s on to the next target",
    )
    IN_REACH = (
        "in_reach",
        "{cause}: closest pose in reach, {value:.1f} s to get there and {limit:.1f} s on to the next target",
    )
    DRIVE = "drive", "drive target: {value:.1f} s to get there and {limit:.1f} s on to the next target"
    CLOSEST = "closest", "{cause}: driving to the closest free place, {value:.2f} m from it"
    WAITS_AT_CLOSEST = "waits_at_closest", "{cause}: waiting at the closest free place, {value:.2f} m from it"
    SOON_FREE = (
        "soon_free",
        "somebody is expected at the cheapest candidate of {subject} in {limit:.1f} s: it is free {value:.1f} s later",
    )
    BESIDE_TAKEN = (
        "beside_taken",
        "moving obstacles take every place to stand for {subject}: driving to free floor beside them, {value:.1f} "
        "s from the nearest",
    )
    WAITS_BESIDE_TAKEN = (
        "waits_beside_taken",
        "moving obstacles take every place to stand for {subject}: waiting beside them, {value:.1f} s from the nearest",
    )
    NO_CANDIDATE = "no_candidate", "no free place to stand within {limit:.2f} m of {subject}"
    NOT_FREE = "not_free", "{subject} is {other}"
    CLOSED_IN = "closed_in", "no place to stand for {subject} can be reached: obstacles block every way"
    UNREACHABLE = "unreachable", "{cause}: no place to stand for it can be reached"
    OUTSIDE_MAP = "outside_map", "{subject} at ({value:.2f}, {limit:.2f}) is outside the map, {other}"
    POINT_OUTSIDE_MAP = "point_outside_map", "{subject} is outside the map, {other}"
    STATIONARY = "stationary", "{other}"
    OWN = "own", "{other}"
    WHOLE_BODY = "whole_body", "base and arm move as one, so there is no place to stand"
    TANGENT = "tangent", "tangent point {value:.2f} m away, {limit:.0f} deg off heading"
    REHEARSED = "rehearsed", "as rehearsed"
    REHEARSAL_OVER = "rehearsal_over", "the rehearsed plan is over{other}"
    REHEARSAL_REFUSED = "rehearsal_refused", "the task list has changed, but not the plan: {other}"
    # motion of the base
    NOTHING_TO_DO = "nothing_to_do", "there is nothing to do"
    NO_WAY = "no_way", "no way to {subject}: every gap is narrower than {limit:.2f} m"
    LEAVES_REACH = "leaves_reach", "no motion of the base keeps {subject} in reach of the arm: braking"
    NO_MOTION = (
        "no_motion",
        "no collision-free motion towards {subject} ({limit:.0f} tried, {value:.2f} m of clearance): braking",
    )
    MAKES_WAY = "makes_way", "moving out of the way of something that comes at {value:.1f} m/s"
    GIVES_WAY = "gives_way", "giving way to {subject}, which comes at {value:.1f} m/s"
    IS_GIVEN_WAY = "is_given_way", "{subject}, which goes at {value:.1f} m/s, has to give way in {limit:.1f} s"
    PASSES_BEHIND = (
        "passes_behind",
        "passing behind {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    )
    PASSES_IN_FRONT = (
        "passes_in_front",
        "passing in front of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    )
    KEEPS_CLEAR = (
        "keeps_clear",
        "keeping clear of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    )
    OVERLAP_STANDS = (
        "overlap_stands",
        "the base overlaps a mapped or seen obstacle by {value:.2f} m, and no motion reduces that: standing still",
    )
    OVERLAP_LEAVES = "overlap_leaves", "the base overlaps a mapped or seen obstacle by {value:.2f} m: backing out"
    HELD_BACK = "held_back", "something beside the base holds it back on its way to {subject}"
    BACKS_OFF = "backs_off", "{cause}; backing off to where there is more room"
    TURNS_TO_SEE = "turns_to_see", "{cause}; turning to see more"
    BY_HAND = "by_hand", "driven by hand"
    GUARDED = "guarded", "slowed: at that speed the base could not stop clear of mapped obstacles"
    BY_AGENT = "by_agent", "an agent drives the base"
    HAND_HELD_UP = "hand_held_up", "the hand is held up on its way to {subject}, or about to leave"
    NO_BETTER_MOTION = (
        "no_better_motion",
        "no motion towards {subject} is better than standing still ({value:.0f} tried)",
    )
    # the arm
    WAITS_FOR_SIGHT = "waits_for_sight", "waiting to see {subject}"
    WAITS_FOR_STATE = "waits_for_state", "waiting for the robot to report where its hand is"
    WAITS_FOR_GRIP = "waits_for_grip", "the hand stays above {subject} while the base moves on slipping wheels"
    IMPRECISE = "imprecise", "{subject} is only known to within {value:.0f} mm"
    NO_ROOM = "no_room", "no room for the fingers beside {subject}: {other} is in the way"
    NOTHING_ACHIEVED = "nothing_achieved", "no progress at {subject} for a while: starting over from the stow pose"
    STARTS_OVER = "starts_over", "starting over from the stow pose"
    GRIPPER_NOT_OPEN = "gripper_not_open", "the gripper is not open yet"
    GRIPPER_TOO_WIDE = "gripper_too_wide", "the fingers come nearer to each other: there is little room for them"
    HELD_ALREADY = "held_already", "an object is already held"
    NOTHING_HELD = "nothing_held", "nothing is held, so there is nothing to place"
    SLIPPED = "slipped", "the object slipped out of the gripper"
    SLIPPED_IN_LIFT = "slipped_in_lift", "the object slipped while it was lifted: trying again"
    CLOSED_ON_NOTHING = "closed_on_nothing", "the fingers closed on nothing: trying again"
    LEFT_OBJECT = "left_object", "the hand could not stay on the object: trying again"
    PUSHED_AWAY = "pushed_away", "the object was pushed away: trying again"
    OPENS_AGAIN = "opens_again", "opening the fingers for another try at {subject}"
    OUT_OF_REACH = "out_of_reach", "{subject} went out of reach"
    GAVE_WAY = "gave_way", "moved off at {value:.2f} m/s ({subject}): too near for the joints to brake in time"
    ARM_STANDS = "arm_stands", "the lidar sees something {value:.2f} m inside the {subject}: the arm stands still"
    ARM_WITHDRAWS = (
        "arm_withdraws",
        "the lidar sees something {value:.2f} m inside the {subject}: the arm draws back slowly",
    )
    ARM_STOPPED = "arm_stopped", "the arm was stopped: {other}"
    ARM_COMMANDED = "arm_commanded", "the arm is {other}"
    HELD_OFF = "held_off", "the {subject} keeps off a {other}, {value:.2f} m away"
    PHASE = "phase"
    AT_TARGET = "at_target"
    # the task list
    ALL_DONE = "all_done", "all {value:.0f} tasks are done{other}"
    NO_TASKS = "no_tasks", "there are no tasks{other}"
    ALL_ENDED = "all_ended", "all {value:.0f} tasks have ended, {limit:.0f} given up: {other}"
    NO_PLACE_TASK = (
        "no_place_task",
        "{subject} is in the gripper, but no task says where it goes: {other}put a place task first",
    )


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
        """The first reason of one of these kinds, from this one along its causes; None without one."""
        if self.kind in kinds:
            return self
        return None if self.cause is None else self.cause.about(*kinds)

    @property
    def key(self) -> tuple[str, ...]:
        """Kinds and names without numbers: two reasons with the same key count as one."""
        return (self.kind, self.subject, *(() if self.cause is None else self.cause.key))


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
    return reason.kind.sentence.format(
        subject=reason.subject, other=reason.other, value=reason.value, limit=reason.limit, unit=reason.unit,
        cause=reason.cause,
    )  # fmt: skip


def _tries(reason: Reason) -> str:
    return f" (try {reason.value:.0f} of {reason.limit:.0f})" if reason.value > 1.0 else ""
