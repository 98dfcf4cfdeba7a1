"""The reference robot: the simulated plant as a robot that is commanded by messages, over any transport.

Time passes in steps of 10 ms, one for each call of `step`. The robot emulates a bad link in simulated time, repeatable
by its seed: messages are delayed, overtake each other or are lost, and there are outages. A guard decides which
commands are accepted, which one acts now, and when the last one expires.
"""

import bisect
import heapq
import itertools
import math
import secrets
from collections.abc import Callable
from typing import Any, Generic, TypeVar

import msgspec
import numpy as np

from motm_twin.bus.plant_messages import (
    LIFETIME,
    VERSION,
    ClockReached,
    DetectionData,
    DetectionList,
    EditRequest,
    Info,
    PlantAnswer,
    ResetRequest,
    RobotCommand,
    RobotState,
    ScanData,
    TaskNotice,
    TruthData,
    to_message,
)
from motm_twin.control.predictor import expired
from motm_twin.external.robot_link import WIDEST
from motm_twin.model.plant import SUBSTEP, Actuation, Scan
from motm_twin.model.profile import DQ_MAX, BaseLimits
from motm_twin.model.scene import Scene
from motm_twin.plants import make_plant

T = TypeVar("T")
EARLY = 1e-9  # [s] rounding of times


class LinkSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Defects of a link, in each direction. Raises ValueError for an impossible one."""

    latency: float = 0.0  # [s]
    jitter: float = 0.0  # [s] a message takes latency +- jitter, uniform
    loss: float = 0.0  # share of messages that never arrive
    outage: float = 0.0  # [s] length of an outage of both directions: one in every window
    every: float = 2.0  # [s] length of such a window; its outage is at a random time
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0.0 <= self.jitter <= self.latency <= 5.0 and 0.0 <= self.loss <= 1.0):
            raise ValueError(
                f"link of {self.latency} s latency, {self.jitter} s jitter, {self.loss} loss: "
                "need 0 <= jitter <= latency <= 5 s and a loss from 0 to 1"
            )
        if not (0.0 <= self.outage <= self.every <= 1000.0 and self.every > 0.0):
            raise ValueError(
                f"outages of {self.outage} s, one in every {self.every} s: "
                "need 0 <= outage <= every <= 1000 s, and every above 0"
            )


class Link(Generic[T]):
    """One direction of a link; times [s] come in as arguments and never decrease."""

    def __init__(self, spec: LinkSpec, direction: int) -> None:
        """``direction``: a number by which two directions draw different random numbers."""
        self.spec = spec
        self._rng = np.random.default_rng([spec.seed, 0x11E4, direction])
        self._number = itertools.count()
        self._under_way: list[tuple[float, int, T]] = []
        self._out_from, self._window_end = 0.0, 0.0  # [s] begin of the present outage, end of its window

    def send(self, item: T, now: float) -> None:
        """Send a message; it may be lost."""
        spec = self.spec
        lost, place = self._rng.random(2)
        if lost >= spec.loss and not self._in_outage(now):
            due = now + spec.latency + spec.jitter * (2.0 * float(place) - 1.0)
            heapq.heappush(self._under_way, (due, next(self._number), item))

    def _in_outage(self, now: float) -> bool:
        """True during an outage at ``now`` [s], the same in both directions."""
        spec = self.spec
        if not spec.outage:
            return False
        if now >= self._window_end:
            window = int(now // spec.every)
            share = float(np.random.default_rng([spec.seed, 0x0FF, window]).random())
            self._out_from = window * spec.every + share * (spec.every - spec.outage)
            self._window_end = (window + 1) * spec.every
        return self._out_from <= now < self._out_from + spec.outage

    def arrived(self, now: float) -> list[T]:
        """Messages that have arrived by ``now`` [s], in order; each is returned once."""
        items: list[T] = []
        while self._under_way and self._under_way[0][0] <= now + EARLY:
            items.append(heapq.heappop(self._under_way)[2])
        return items


MAX_BYTES = 4096
MAX_HEARD = 50  # arrivals reported at once
MAX_WAITING = 200  # commands
MAX_AHEAD = 1.0  # [s] that a command may be given ahead
MAX_LATE = 0.30  # [s] lateness beyond which a command is refused
SILENCE = 1.0  # [s] of silence after which another sender may command, and numbers restart
MAX_JUMP = 1000  # between the numbers of two commands: 10 s of lost commands
SLACK = 1e-6  # rounding of limits


class RefusedCommand(ValueError):
    """A command that the robot refuses; the message says why."""


class CommandGuard:
    """Accepts commands of one sender in order, each for its time; times of the robot's clock come in as arguments."""

    def __init__(self, life: str, limits: BaseLimits) -> None:
        """For one life of a robot with these limits."""
        self.life, self._limits = life, limits
        self._waiting: list[RobotCommand] = []  # by act_at
        self._acting: RobotCommand | None = None
        self._grip: tuple[str, float | None] = "open", None
        self._decode = msgspec.json.Decoder(RobotCommand).decode
        self.commander, self._last_sign = "", -math.inf
        self._newest, self._acted = -1, -1  # the commander's: highest number accepted, last one that acted
        self._heard: list[tuple[int, float]] = []
        self.refused, self.refusal = 0, ""

    def offer(self, payload: bytes, now: float) -> None:
        """Accept a command that arrives at ``now`` [s], or count it as refused."""
        try:
            self._take(payload, now)
        except RefusedCommand as refusal:
            self.refused, self.refusal = self.refused + 1, str(refusal)

    def actuation(self, now: float) -> Actuation:
        """Command at ``now`` [s]: base and arm come to rest when no command is fresh; the gripper keeps its own."""
        while self._waiting and self._waiting[0].act_at <= now + SLACK:
            self._acting = self._waiting.pop(0)
            self._acted = self._acting.seq
            if now - self._acting.act_at < self._acting.lifetime - SLACK:  # otherwise the hand may have moved on
                self._grip = self._acting.gripper, self._acting.opening
        acting, (gripper, opening) = self._acting, self._grip
        if acting is None:
            return Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper=gripper, opening=opening)
        twist, rates = np.array(acting.twist), np.array(acting.joint_velocity)
        over = now - acting.act_at - acting.lifetime
        command = Actuation(twist=twist, joint_velocity=rates, gripper=gripper, opening=opening)
        if over >= -SLACK:
            return expired(command, max(0.0, over))
        return msgspec.structs.replace(command, gripper=acting.gripper, opening=acting.opening)

    def heard(self) -> list[tuple[int, float]]:
        """Numbers and times [s] of arrival of the commander's commands since the last call.

        Includes refused ones, from which a sender learns that its estimate of this clock is wrong.
        """
        heard, self._heard = self._heard, []
        return heard

    def _take(self, payload: bytes, now: float) -> None:
        if len(payload) > MAX_BYTES:
            raise RefusedCommand(f"{len(payload)} bytes: at most {MAX_BYTES} are taken")
        try:
            command = self._decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise RefusedCommand(f"malformed: {error}") from None
        self._check(command)
        if self.commander not in ("", command.sender) and now - self._last_sign < SILENCE:
            raise RefusedCommand(f"{self.commander!r} commands: it must be silent for {SILENCE:.0f} s first")
        self._heard = [*self._heard, (command.seq, now)][-MAX_HEARD:]
        if command.act_at > now + MAX_AHEAD:
            raise RefusedCommand(f"act_at is {command.act_at - now:.2f} s ahead: at most {MAX_AHEAD} s")
        if now - command.act_at > MAX_LATE:
            raise RefusedCommand(f"stale: it was for {now - command.act_at:.2f} s ago")
        if command.sender == self.commander and now - self._last_sign < SILENCE:
            self._check_order(command)
        else:  # another sender, or the same one after a silence: old commands of its own are refused by their times
            self._waiting.clear()
            self._newest, self._acted = -1, -1
        if len(self._waiting) >= MAX_WAITING:
            raise RefusedCommand(f"{MAX_WAITING} commands wait already")
        self.commander, self._last_sign = command.sender, now
        self._newest = max(self._newest, command.seq)
        bisect.insort(self._waiting, command, key=lambda item: item.act_at)

    def _check(self, command: RobotCommand) -> None:
        limits = self._limits
        if command.version != VERSION:
            raise RefusedCommand(f"version {command.version!r}: this robot reads {VERSION!r}")
        if command.life != self.life:
            raise RefusedCommand("meant for another robot, or for this one before it was started again")
        if not 1 <= len(command.sender) <= 80 or not 0 <= command.seq < 2**53:
            raise RefusedCommand("a sender of 1 to 80 characters and a number from 0 on are needed")
        if len(command.twist) != 2 or len(command.joint_velocity) != 7:
            raise RefusedCommand("twist needs 2 numbers and joint_velocity 7")
        numbers = (*command.twist, *command.joint_velocity, command.act_at, command.lifetime)
        if not all(map(math.isfinite, numbers)):
            raise RefusedCommand("all numbers must be finite")
        if not 0.0 < command.lifetime <= LIFETIME:
            raise RefusedCommand(f"lifetime {command.lifetime} s: more than 0 and at most {LIFETIME} s")
        if command.gripper not in ("open", "close"):
            raise RefusedCommand("gripper must be 'open' or 'close'")
        if command.opening is not None and not 0.0 < command.opening <= WIDEST:
            raise RefusedCommand(f"opening {command.opening} m: more than 0 and at most {WIDEST} m, or none")
        v, w = command.twist
        if not -limits.reverse_speed - SLACK <= v <= limits.forward_speed + SLACK or abs(w) > limits.yaw_rate + SLACK:
            raise RefusedCommand(f"base twist {v:.2f} m/s, {w:.2f} rad/s is above the limits of this robot")
        if (np.abs(command.joint_velocity) > DQ_MAX + SLACK).any():
            raise RefusedCommand("a joint velocity is above the limits of this robot")

    def _check_order(self, command: RobotCommand) -> None:
        if command.seq <= self._acted:
            raise RefusedCommand(f"number {command.seq} comes after {self._acted} has acted: it is old or a duplicate")
        if any(other.seq == command.seq for other in self._waiting):
            raise RefusedCommand(f"number {command.seq} was taken already: a duplicate")
        if command.seq > self._newest + MAX_JUMP:
            raise RefusedCommand(
                f"number {command.seq} jumps by {command.seq - self._newest} from {self._newest}, "
                f"by {MAX_JUMP} at most within {SILENCE:.0f} s"
            )


TRUTH_STEPS = 5  # steps between two messages of truth: 20 Hz

Send = Callable[[str, bytes], None]  # name of the key (state, scan, ...), payload
encode = msgspec.json.Encoder().encode


class ReferenceRobot:
    """A scene with its robot and referee; messages go through an emulated link in both directions."""

    def __init__(self, scene: Scene, *, send: Send, link: LinkSpec | None = None, clock: str = "real") -> None:
        """``send`` is called for every message that leaves; ``clock``: real or shared, see `Info`."""
        self._send, self._spec, self._clock = send, link or LinkSpec(), clock
        self._physics = scene.physics  # used for scenes that name none
        self._begin(scene)

    def _begin(self, scene: Scene) -> None:
        scene = msgspec.structs.replace(scene, physics=scene.physics or self._physics)
        self._plant = make_plant(scene)
        self.scene, self.life = scene, secrets.token_hex(6)
        self._guard = CommandGuard(self.life, scene.robot.base)
        self._up: Link[bytes] = Link(self._spec, 0)
        self._down: Link[tuple[str, bytes]] = Link(self._spec, 1)
        self._steps = 0
        self._sent: tuple[Scan | None, object] = (None, None)  # scan and camera frame that were sent last

    @property
    def time(self) -> float:
        """The robot's clock [s]."""
        return self._plant.time

    def info(self) -> Info:
        """Name and abilities of this robot."""
        name = f"{self.scene.robot.name}, simulated in {self.scene.name}"
        can = ["edit", "truth", "reset", "opening"]
        return Info(version=VERSION, life=self.life, name=name, clock=self._clock, step=SUBSTEP, can=can)

    def show(self) -> None:
        """Send the present state; no time passes."""
        self._sent = (None, None)
        self._tell()

    def command(self, payload: bytes) -> None:
        """Put a command on the link now."""
        self._up.send(payload, self.time)

    def step(self) -> None:
        """Let 10 ms pass."""
        for payload in self._up.arrived(self.time):
            self._guard.offer(payload, self.time)
        self._plant.command(self._guard.actuation(self.time))
        self._plant.step(SUBSTEP)
        self._steps += 1
        self._tell()

    def reset(self, request: ResetRequest) -> PlantAnswer:
        """Begin again, as another life, in the scene of the request or the same one."""
        try:
            self._begin(request.scene or self.scene)
        except ValueError as error:
            return PlantAnswer(version=VERSION, ok=False, life=self.life, reason=str(error))
        return PlantAnswer(version=VERSION, ok=True, life=self.life)

    def edit(self, request: EditRequest) -> PlantAnswer:
        """Change the world, or check that it can be changed."""
        try:
            if request.check:
                rehearsal = self._plant.rehearsal()
                for edit in (*request.before, request.edit):
                    rehearsal.accept(edit)
            else:
                self._plant.apply(request.edit)
        except ValueError as error:
            return PlantAnswer(version=VERSION, ok=False, reason=str(error))
        self._truth()
        return PlantAnswer(version=VERSION, ok=True)

    def tasks(self, notice: TaskNotice) -> PlantAnswer:
        """Tell the referee the present task list, or announced poses of furniture."""
        if notice.tasks is not None:
            self._plant.expect_tasks(notice.tasks)
        if notice.announced is not None:
            self._plant.expect_map(notice.announced)
        return PlantAnswer(version=VERSION, ok=True)

    def report(self) -> dict[str, object]:
        """Results of the referee, and refused commands."""
        truth = self._plant.truth()
        clearance = truth.min_base_clearance
        return {
            "scene": self.scene.name,
            "variant": self.scene.variant,
            "seed": self.scene.seed,
            "time_s": round(self.time, 3),
            "picks": truth.picks,
            "places": truth.places,
            "drops": truth.drops,
            "dropped": list(truth.dropped),
            "contacts": [msgspec.to_builtins(contact) for contact in truth.contacts],
            "contacts_caused_by_robot": sum(contact.caused_by_robot for contact in truth.contacts),
            "cut_ins": [msgspec.to_builtins(cut_in) for cut_in in truth.cut_ins],
            "min_base_clearance_m": round(clearance, 4) if np.isfinite(clearance) else None,
            "path_length_m": round(truth.path_length, 3),
            "plant_faults": list(truth.plant_faults),
            **({} if truth.physics is None else {"physics": msgspec.to_builtins(truth.physics)}),
            "commands_refused": self._guard.refused,
            "last_refusal": self._guard.refusal,
        }

    def _tell(self) -> None:
        now, plant, guard = self.time, self._plant, self._guard
        seen = plant.observe()
        if seen.scan is not None and seen.scan is not self._sent[0]:
            self._down.send(("scan", encode(to_message(seen.scan, ScanData, **self._header()))), now)
        picture = (seen.camera_stamp, seen.detections)
        if seen.camera_stamp is not None and picture != self._sent[1]:
            detections = [to_message(one, DetectionData) for one in seen.detections]
            frame = DetectionList(**self._header(), stamp=seen.camera_stamp, detections=detections)
            self._down.send(("detections", encode(frame)), now)
        self._sent = (seen.scan, picture)
        state = to_message(
            seen,
            RobotState,
            **self._header(),
            seq=self._steps,
            stamp=now,
            heard=guard.heard(),
            commander=guard.commander,
            refused=guard.refused,
            refusal=guard.refusal,
        )
        self._down.send(("state", encode(state)), now)
        for name, payload in self._down.arrived(now):
            self._send(name, payload)
        if self._steps % TRUTH_STEPS == 0:
            self._truth()
        if self._clock == "shared":
            self._send("clock", encode(ClockReached(**self._header(), stamp=now)))

    def _truth(self) -> None:
        self._send("truth", encode(to_message(self._plant.truth(), TruthData, **self._header(), stamp=self.time)))

    def _header(self) -> dict[str, Any]:
        return {"version": VERSION, "life": self.life}
