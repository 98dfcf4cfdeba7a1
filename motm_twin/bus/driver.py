"""The driver: one person or program at a time, for as long as its lease; bodies that it holds are let go at the end."""

import math
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from motm_twin.bus.commands import NAME_MAX, Audience, Envelope, HandOver, Inspect, Refused
from motm_twin.model.edits import Edit, MoveBody, ReleaseBody, RemoveBody

SILENCE = 10.0  # [s] after the last command of the driver


class Lease:
    """Exclusive right to drive. The first to act holds it, until they hand over or fall silent."""

    def __init__(self) -> None:
        self.driver, self.name = "", ""
        self._until = 0.0  # [s]

    def left(self, now: float) -> float:
        """Seconds of silence until the lease ends; 0 without a driver."""
        return max(0.0, self._until - now) if self.driver else 0.0

    def require(self, sender: str, now: float) -> None:
        """After `expire`: raise Refused when somebody else drives. Any command of the driver keeps the wheel."""
        if self.driver not in ("", sender):
            raise Refused(
                f"{self.name} is driving: it can hand over to you, or you wait for {SILENCE:.0f} s of silence "
                f"({self.left(now):.0f} s left)"
            )
        self.renew(sender, now)

    def renew(self, sender: str, now: float) -> None:
        """A sign of life; only the driver's counts."""
        if sender == self.driver:
            self._until = max(self._until, now + SILENCE)

    def give(self, to: str, name: str, now: float) -> None:
        """After `require`: a sender that changed something drives, or one to whom this is handed over; "": nobody."""
        until = now + SILENCE if to else 0.0
        self._until = max(self._until, until) if to and to == self.driver else until
        self.driver, self.name = to, (name.strip() or to)[:NAME_MAX] if to else ""

    def expire(self, now: float) -> None:
        """End the lease when the driver has been silent for too long."""
        if self.driver and now >= self._until:
            self.give("", "", now)


NAMES_KEPT = 1000  # senders
HELD_FOR = 1.5  # [s] after the last move of a held body


class Wheel:
    """Lets one person at a time change things, under a `Lease`; all times [s] are on one monotonic clock."""

    def __init__(self, release: Callable[[ReleaseBody], None], changed: Callable[[], None]) -> None:
        """``release`` lets a body go, ``changed`` announces a new driver."""
        self._release, self._changed = release, changed
        self.lease, self.holds = Lease(), Holds()
        self._names: dict[str, str] = {}  # displayed name of each known sender, the latest last

    def shown(self, now: float) -> dict[str, Any]:
        """The driver, as a status shows it."""
        lease = self.lease
        return {"driver": lease.driver, "driver_name": lease.name, "driver_left": round(lease.left(now), 2)}

    def require(self, envelope: Envelope, arrived: float) -> None:
        """Raise Refused when a command needs the right to drive and another sender has it."""
        self._remember(envelope)
        if not isinstance(envelope.command, Inspect | Audience):
            self._expire(arrived)
            self.lease.require(envelope.sender, arrived)

    def turn(self, envelope: Envelope, arrived: float) -> None:
        """Update the driver after an accepted command: its sender drives, or has handed over."""
        before = (self.lease.driver, self.lease.name)
        match envelope.command:
            case Inspect() | Audience():
                return
            case HandOver(to=to, name=name):
                self.lease.give(to, name.strip() or self._names.get(to, ""), arrived)
            case _:
                self.lease.give(envelope.sender, envelope.name, arrived)
        self._tell(before)

    def turn_if_free(self, envelope: Envelope, now: float) -> None:
        """Make the sender of a slow command the driver once it is done, unless another drives by now."""
        with suppress(Refused):
            self.require(envelope, now)
            self.turn(envelope, now)

    def look_after(self, now: float) -> None:
        """Release what is held, and the wheel, after silence."""
        for release in self.holds.expired(now):
            self._release(release)
        self._expire(now)

    def _remember(self, envelope: Envelope) -> None:
        """Remember the displayed name of a sender, who may be handed the right to drive later."""
        if name := envelope.name.strip():
            self._names.pop(envelope.sender, None)
            self._names[envelope.sender] = name
            if len(self._names) > NAMES_KEPT:
                del self._names[next(iter(self._names))]

    def _expire(self, now: float) -> None:
        before = (self.lease.driver, self.lease.name)
        self.lease.expire(now)
        self._tell(before)

    def _tell(self, before: tuple[str, str]) -> None:
        after = (self.lease.driver, self.lease.name)
        if before == after:
            return
        if before[0] not in ("", after[0]):
            for release in self.holds.expired():
                self._release(release)
        self._changed()


class Holds(dict[str, float]):
    """Bodies that are being dragged, with the time [s] until which the grip lasts."""

    def note(self, edit: Edit, now: float) -> None:
        """Follow an edit that was accepted at ``now`` [s]."""
        if isinstance(edit, MoveBody) and edit.held:
            self[edit.name] = now + HELD_FOR
        elif isinstance(edit, MoveBody | ReleaseBody | RemoveBody):
            self.pop(edit.name, None)

    def expired(self, now: float = math.inf) -> list[ReleaseBody]:
        """Releases for those who fell silent, by default for all; they are forgotten."""
        silent = [name for name, until in self.items() if until <= now]
        for name in silent:
            del self[name]
        return [ReleaseBody(name=name) for name in silent]
