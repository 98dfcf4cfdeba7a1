"""The wheel: one person drives at a time. Clocks come in as arguments, all on the same monotonic clock."""

from motm_twin.bus.commands import NAME_MAX, Refused

SILENCE = 10.0  # [s] after the last command of the driver


class Lease:
    """Who drives. Whoever acts first does, until they hand over or fall silent."""

    def __init__(self) -> None:
        self.driver, self.name = "", ""
        self._until = 0.0  # [s]

    def left(self, now: float) -> float:
        """Seconds of silence after which the wheel is free; 0 without a driver."""
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

    def take(self, sender: str, name: str, now: float) -> None:
        """After `require`: a command that changed something makes its sender the driver."""
        self._set(sender, name.strip() or sender, now)

    def hand_over(self, to: str, name: str, now: float) -> None:
        """After `require`: another sender drives, "" leaves the wheel free."""
        self._set(to, name.strip() or to, now)

    def expire(self, now: float) -> None:
        """Free the wheel when the driver has been silent for too long."""
        if self.driver and now >= self._until:
            self._set("", "", now)

    def _set(self, driver: str, name: str, now: float) -> None:
        until = now + SILENCE if driver else 0.0
        self._until = max(self._until, until) if driver and driver == self.driver else until
        self.driver, self.name = driver, name[:NAME_MAX] if driver else ""
