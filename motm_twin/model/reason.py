"""Reasons why the robot stands, is slowed, waits, drives to a place, or lacks something.

Code reads the fields of a `Reason`; people read its sentence, which is made here and nowhere else.
"""

from enum import StrEnum, auto

import msgspec


class Kind(StrEnum):
    """Kinds of reasons. The first ones are also the kinds of findings of the robot's self-check."""

    sentence: str  # of a reason of this kind; "" where `sentence` makes it

    def __new__(cls, value: str, sentence: str = "") -> "Kind":
        """A kind and its sentence."""
        kind = str.__new__(cls, value)
        kind._value_, kind.sentence = value, sentence
        return kind

    SCAN_BAD = auto(), "scan rejected: {subject}"
    SCAN_OLD = auto(), "the newest lidar scan is {value:.2f} s old, more than {limit:.2f} s"
    STATE_OLD = auto(), "the newest state of the robot is {value:.2f} s old, more than {limit:.2f} s"
    SCAN_FROZEN = auto(), "the lidar has sent the same scan {value:.0f} times"
    SCAN_BLIND = auto(), "only {value:.0f} beams of the lidar return where {limit:.0f} should"
    SCAN_SECTOR = auto(), "the lidar sees nothing across {value:.0f} deg in which the map has furniture"
    SCAN_NOISY = auto(), "the ranges of the lidar scatter by {value:.2f} m, more than {limit:.2f} m"
    POSE_OFF = (
        auto(),
        "driving by odometry: localisation is {value:.2f} m off, and neither wheels nor scan agree with it",
    )
    POSE_LOST = auto(), "localisation is {value:.2f} m off, and after {limit:.0f} m on odometry alone the robot is lost"
    PUSHED = auto(), "pushed by {value:.2f} m, unnoticed by the wheels"
    SLIP = auto(), "the wheels slip: the robot is {value:.2f} m from where they put it"
    ODOMETRY_OFF = auto(), "odometry jumped by {value:.2f} m, farther than wheels can drive: ignored"
    BASE_LATE = auto(), "the base responds {value:.1f} s late, more than {limit:.1f} s"
    BASE_STUCK = auto(), "the base does not do as told: it moves at {value:.2f} {unit} instead of {limit:.2f} {unit}"
    JOINT_STUCK = auto(), "{subject} of the arm does not follow its commands"
    FINGERS_STUCK = auto(), "the fingers should {other} but stay at {value:.0f} mm"
    CAMERA_GHOST = auto(), "the camera reports {subject} where it cannot look: ignored"
    CAMERA_TWICE = auto(), "the camera reports {subject} twice, {value:.2f} m apart: the new one is ignored"
    CAMERA_UNKNOWN = auto(), "the camera reports something where no object is known: ignored"
    CAMERA_SWAP = auto(), "the camera reports {subject} where {other} is: ignored"
    CAMERA_LOST = auto(), "the camera does not report {subject}, which should be in its view"
    CAMERA_LATE = auto(), "the camera's detections are {value:.1f} s old"
    # what comes of them
    STOPPED = auto(), "stopped: {cause}"
    SLOWED = auto()
    # the monitors
    NOT_FINITE = auto(), "{subject} not finite"
    NO_SCAN = auto(), "no usable lidar scan has arrived yet"
    FLOOR_UNSEEN = auto(), "braking: the lidar has never seen the floor ahead"
    FLOOR_STALE = auto(), "slowed to {limit:.1f} m/s: the lidar has not seen the floor ahead lately"
    INSIDE_BASE = auto(), "stopped: the lidar sees something {value:.2f} m inside the base, which may only move off it"
    IN_STOPPING_WAY = (
        auto(),
        "braking {other}: something is within the {limit:.2f} m that the base needs to stop (nearest: {value:.2f} "
        "m from the lidar)",
    )
    MEETS_MOVER = auto(), "braking: something {value:.2f} m away moves at {limit:.1f} m/s and would meet the base"
    ARM_FOLDS = auto(), "braking: the hand would fold onto the forearm"
    ARM_NEAR_SOLID = auto(), "braking: {limit:.3f} m from {other}, the {subject} would close in at {value:.2f} m/s"
    # placement of the base
    NO_TARGET = auto(), "there is no target"
    RING = (
        auto(),
        "cheapest place to stand, at {other}: {value:.1f} s to get there and {limit:.1f} s on to the next target",
    )
    IN_REACH = (
        auto(),
        "{cause}: closest pose in reach, {value:.1f} s to get there and {limit:.1f} s on to the next target",
    )
    DRIVE = auto(), "drive target: {value:.1f} s to get there and {limit:.1f} s on to the next target"
    CLOSEST = auto(), "{cause}: driving to the closest free place, {value:.2f} m from it"
    WAITS_AT_CLOSEST = auto(), "{cause}: waiting at the closest free place, {value:.2f} m from it"
    SOON_FREE = (
        auto(),
        "somebody is expected at the cheapest candidate of {subject} in {limit:.1f} s: it is free {value:.1f} s later",
    )
    BESIDE_TAKEN = (
        auto(),
        "moving obstacles take every place to stand for {subject}: driving to free floor beside them, {value:.1f} "
        "s from the nearest",
    )
    WAITS_BESIDE_TAKEN = (
        auto(),
        "moving obstacles take every place to stand for {subject}: waiting beside them, {value:.1f} s from the nearest",
    )
    NO_CANDIDATE = auto(), "no free place to stand within {limit:.2f} m of {subject}"
    NOT_FREE = auto(), "{subject} is {other}"
    CLOSED_IN = auto(), "no place to stand for {subject} can be reached: obstacles block every way"
    UNREACHABLE = auto(), "{cause}: no place to stand for it can be reached"
    OUTSIDE_MAP = auto(), "{subject} at ({value:.2f}, {limit:.2f}) is outside the map, {other}"
    POINT_OUTSIDE_MAP = auto(), "{subject} is outside the map, {other}"
    STATIONARY = auto(), "{other}"
    OWN = auto(), "{other}"
    WHOLE_BODY = auto(), "base and arm move as one, so there is no place to stand"
    TANGENT = auto(), "tangent point {value:.2f} m away, {limit:.0f} deg off heading"
    REHEARSED = auto(), "as rehearsed"
    REHEARSAL_OVER = auto(), "the rehearsed plan is over{other}"
    REHEARSAL_REFUSED = auto(), "the task list has changed, but not the plan: {other}"
    # motion of the base
    NOTHING_TO_DO = auto(), "there is nothing to do"
    NO_WAY = auto(), "no way to {subject}: every gap is narrower than {limit:.2f} m"
    LEAVES_REACH = auto(), "no motion of the base keeps {subject} in reach of the arm: braking"
    NO_MOTION = (
        auto(),
        "no collision-free motion towards {subject} ({limit:.0f} tried, {value:.2f} m of clearance): braking",
    )
    MAKES_WAY = auto(), "moving out of the way of something that comes at {value:.1f} m/s"
    GIVES_WAY = auto(), "giving way to {subject}, which comes at {value:.1f} m/s"
    IS_GIVEN_WAY = auto(), "{subject}, which goes at {value:.1f} m/s, has to give way in {limit:.1f} s"
    PASSES_BEHIND = auto(), "passing behind {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s"
    PASSES_IN_FRONT = (
        auto(),
        "passing in front of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s",
    )
    KEEPS_CLEAR = auto(), "keeping clear of {subject}, which goes at {value:.1f} m/s and is nearest in {limit:.1f} s"
    OVERLAP_STANDS = (
        auto(),
        "the base overlaps a mapped or seen obstacle by {value:.2f} m, and no motion reduces that: standing still",
    )
    OVERLAP_LEAVES = auto(), "the base overlaps a mapped or seen obstacle by {value:.2f} m: backing out"
    BACKS_OFF = auto(), "{cause}; backing off to where there is more room"
    TURNS_TO_SEE = auto(), "{cause}; turning to see more"
    BY_HAND = auto(), "driven by hand"
    GUARDED = auto(), "slowed: at that speed the base could not stop clear of mapped obstacles"
    BY_AGENT = auto(), "an agent drives the base"
    HAND_HELD_UP = auto(), "the hand is held up on its way to {subject}, or about to leave"
    NO_BETTER_MOTION = auto(), "no motion towards {subject} is better than standing still ({value:.0f} tried)"
    # the arm
    WAITS_FOR_SIGHT = auto(), "waiting to see {subject}"
    WAITS_FOR_STATE = auto(), "waiting for the robot to report where its hand is"
    IMPRECISE = auto(), "{subject} is only known to within {value:.0f} mm"
    NO_ROOM = auto(), "no room for the fingers beside {subject}: {other} is in the way"
    NOTHING_ACHIEVED = auto(), "no progress at {subject} for a while: starting over from the stow pose"
    STARTS_OVER = auto(), "starting over from the stow pose"
    GRIPPER_NOT_OPEN = auto(), "the gripper is not open yet"
    HELD_ALREADY = auto(), "an object is already held"
    NOTHING_HELD = auto(), "nothing is held, so there is nothing to place"
    SLIPPED = auto(), "the object slipped out of the gripper"
    SLIPPED_IN_LIFT = auto(), "the object slipped while it was lifted: trying again"
    CLOSED_ON_NOTHING = auto(), "the fingers closed on nothing: trying again"
    LEFT_OBJECT = auto(), "the hand could not stay on the object: trying again"
    PUSHED_AWAY = auto(), "the object was pushed away: trying again"
    OPENS_AGAIN = auto(), "opening the fingers for another try at {subject}"
    OUT_OF_REACH = auto(), "{subject} went out of reach"
    GAVE_WAY = auto(), "moved off at {value:.2f} m/s ({subject}): too near for the joints to brake in time"
    ARM_STANDS = auto(), "the lidar sees something {value:.2f} m inside the {subject}: the arm stands still"
    ARM_WITHDRAWS = auto(), "the lidar sees something {value:.2f} m inside the {subject}: the arm draws back slowly"
    ARM_STOPPED = auto(), "the arm was stopped: {other}"
    ARM_COMMANDED = auto(), "the arm is {other}"
    HELD_OFF = auto(), "the {subject} keeps off a {other}, {value:.2f} m away"
    PHASE = auto()
    AT_TARGET = auto()
    # the task list
    ALL_DONE = auto(), "all {value:.0f} tasks are done{other}"
    NO_TASKS = auto(), "there are no tasks{other}"
    ALL_ENDED = auto(), "all {value:.0f} tasks have ended, {limit:.0f} given up: {other}"
    NO_PLACE_TASK = auto(), "{subject} is in the gripper, but no task says where it goes: {other}put a place task first"


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
