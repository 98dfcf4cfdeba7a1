"""The robot's side of commands: which are accepted, which one acts now, and when the last one expires."""

import bisect
import math

import msgspec
import numpy as np

from motm_twin.bus.plant_messages import LIFETIME, VERSION, RobotCommand
from motm_twin.control.predictor import expired
from motm_twin.model.joint_limits import DQ_MAX
from motm_twin.model.plant import Actuation
from motm_twin.model.profile import BaseLimits

MAX_BYTES = 4096
MAX_HEARD = 50  # arrivals reported at once
MAX_WAITING = 200  # commands
MAX_AHEAD = 1.0  # [s] that a command may be given ahead
MAX_LATE = 0.30  # [s] lateness beyond which a command is refused
SILENCE = 1.0  # [s] of silence after which another sender may command, and numbers restart
MAX_JUMP = 1000  # between the numbers of two commands: 10 s of them lost at once
SLACK = 1e-6  # rounding of limits


class RefusedCommand(ValueError):
    """A command that is not obeyed; the message says why."""


class CommandGuard:
    """Accepts commands of one sender in order, each for its time; the robot's clock comes in as arguments."""

    def __init__(self, life: str, limits: BaseLimits) -> None:
        """For one life of a robot with these limits."""
        self.life, self._limits = life, limits
        self._waiting: list[RobotCommand] = []  # by act_at
        self._acting: RobotCommand | None = None
        self._gripper = "open"
        self._decode = msgspec.json.Decoder(RobotCommand).decode
        self.commander, self._last_sign = "", -math.inf
        self._newest, self._acted = -1, -1  # numbers of the commander's: the highest that was taken, and that acted
        self._heard: list[tuple[int, float]] = []
        self.refused, self.refusal = 0, ""

    def offer(self, payload: bytes, now: float) -> None:
        """Take a command that arrives now [s], or count it as refused."""
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
                self._gripper = self._acting.gripper
        acting = self._acting
        if acting is None:
            return Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper=self._gripper)
        twist, rates = np.array(acting.twist), np.array(acting.joint_velocity)
        over = now - acting.act_at - acting.lifetime
        if over >= -SLACK:
            return expired(twist, rates, self._gripper, max(0.0, over))
        return Actuation(twist=twist, joint_velocity=rates, gripper=acting.gripper)

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
