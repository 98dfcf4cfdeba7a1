"""Real-time pacing: when the next period is due, and how fast time really runs. Clocks come in as arguments."""

from collections import deque

from motm_twin.model.period import PERIOD

MAX_LAG = 0.25  # [s] of real time; what is later than this is not caught up with
WINDOW = 1.0  # [s] over which the actual factor is measured
FEWEST = 5
CAPPED_BELOW = 0.95  # share of the wanted factor


class Pacer:
    """Schedules periods so that simulated time runs ``speed`` times as fast as the given clock."""

    def __init__(self) -> None:
        self.speed = 1.0
        self._due: float | None = None
        self._done: deque[float] = deque()
        self._since: float | None = None

    def restart(self) -> None:
        """Forget the past: the next period is due at once."""
        self._due = None
        self._since = None
        self._done.clear()

    def wait(self, now: float) -> float:
        """Seconds from ``now`` until the next period is due, 0 when it is."""
        if self._due is None:
            return 0.0
        return max(0.0, self._due - now)

    def started(self, now: float) -> None:
        """A period begins at ``now``."""
        if self._due is None or now - self._due > MAX_LAG:
            self._due = now
        self._due += PERIOD / self.speed
        if self._since is None:
            self._since = now
        self._done.append(now)

    def actual_speed(self, now: float) -> float:
        """Real-time factor reached over the last second, or over the last `FEWEST` periods when they took longer."""
        while len(self._done) > FEWEST and self._done[0] < now - WINDOW:
            self._done.popleft()
        if len(self._done) <= 1:
            return 0.0
        elapsed = max(self._done[-1], now - PERIOD / self.speed) - self._done[0]
        return (len(self._done) - 1) * PERIOD / elapsed

    def capped(self, now: float) -> bool:
        """Whether the machine can not keep up, judged after a full window."""
        if self._since is None or now - self._since < WINDOW:
            return False
        return self.actual_speed(now) < CAPPED_BELOW * self.speed

    def at_ease(self, now: float) -> bool:
        """Whether periods leave time between them: real time or slower, and the machine keeps up."""
        return self.speed <= 1.0 and not self.capped(now)
