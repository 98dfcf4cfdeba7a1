"""Real-time pacing: when the next period is due, how fast time runs, and the scheduling of the loop's thread."""

import os
from collections import deque

from motm_twin.model.plant import PERIOD

MAX_LAG = 0.25  # [s] real time; a greater lag is not made up
WINDOW = 1.0  # [s] over which the actual factor is measured
FEWEST = 5
CAPPED_BELOW = 0.95  # share of the requested factor
PRIORITY = 20  # of 1 to 99: below the threads of the kernel (50)


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
        """Seconds from ``now`` until the next period is due; 0 when it is due."""
        if self._due is None:
            return 0.0
        return max(0.0, self._due - now)

    def started(self, now: float) -> None:
        """Note that a period begins at ``now``."""
        if self._due is None or now - self._due > MAX_LAG:
            self._due = now
        self._due += PERIOD / self.speed
        if self._since is None:
            self._since = now
        while len(self._done) > FEWEST and self._done[0] < now - WINDOW:
            self._done.popleft()
        self._done.append(now)

    def actual_speed(self, now: float) -> float:
        """Real-time factor reached over the last second, or over the last `FEWEST` periods when they took longer."""
        done = list(self._done)  # copied first: the loop may restart while another thread reads
        done = done[-max(FEWEST, sum(at >= now - WINDOW for at in done)) :]
        if len(done) <= 1:
            return 0.0
        elapsed = max(done[-1], now - PERIOD / self.speed) - done[0]
        return (len(done) - 1) * PERIOD / elapsed

    def capped(self, now: float) -> bool:
        """True when the machine can not keep up, judged after a full window."""
        since = self._since
        if since is None or now - since < WINDOW:
            return False
        return self.actual_speed(now) < CAPPED_BELOW * self.speed

    def at_ease(self, now: float) -> bool:
        """True when there is idle time between periods: real time or slower, and the machine keeps up."""
        return self.speed <= 1.0 and not self.capped(now)


class RealTime:
    """The scheduling of the calling thread; always use it from the same one."""

    def __init__(self) -> None:
        self.on, self._allowed = False, hasattr(os, "SCHED_FIFO")

    def want(self, on: bool) -> None:
        """Switch real-time scheduling on or off; child threads and processes keep the usual one."""
        if on == self.on or not self._allowed:
            return
        try:
            schedule(on)
        except OSError:  # not permitted: PermissionError, or another one in some containers
            self._allowed = False
        else:
            self.on = on


def schedule(real_time: bool) -> None:
    """Give the calling thread real-time or usual scheduling. Raises OSError where that is not permitted.

    Children never inherit it; only a privileged thread could undo that.
    """
    policy, priority = (os.SCHED_FIFO, PRIORITY) if real_time else (os.SCHED_OTHER, 0)
    os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def refusal() -> str:
    """Reason why the operating system denies real-time scheduling; "" if it does not. Call it before the loop runs."""
    if not hasattr(os, "SCHED_FIFO"):
        return "this operating system has none"
    try:
        schedule(True)
        schedule(False)
    except OSError as error:
        return error.strerror or str(error)
    return ""
