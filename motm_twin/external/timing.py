"""The robot's clock as the twin knows it, and how far ahead commands must be given. Clocks come in as arguments."""

import math
from collections import deque

BUCKET = 0.5  # [s] over which the best bound is kept
BUCKETS = 20  # 10 s: a drift of 100 ppm is 1 ms in that time
JUMP = 0.05  # [s] by which bounds contradict each other when a clock has jumped; less is rounding to steps
ARRIVALS = 200  # commands over which the longest way counts: 2 s
SENT_KEPT = 500  # commands that wait to be heard of
IN_TIME = 0.98  # share of the commands that must be there in time; a late one acts when it arrives
MAX_LEAD = 0.3  # [s]
LOWER_AFTER = 2.0  # [s] between two reductions of the lead


class _Bound:
    """The largest of the values of the last seconds."""

    def __init__(self) -> None:
        self._best: deque[tuple[float, float]] = deque(maxlen=BUCKETS)  # begin of the bucket, largest

    def note(self, now: float, value: float) -> None:
        if not self._best or now - self._best[-1][0] >= BUCKET:
            self._best.append((now, value))
        else:
            begin, largest = self._best[-1]
            self._best[-1] = (begin, max(largest, value))

    def largest(self) -> float | None:
        return max((value for _, value in self._best), default=None)


class ClockOffset:
    """Time by which the robot's clock is ahead of the twin's.

    A message that was stamped s by the robot and arrives at t of the twin proves that the offset is at least s - t; a
    command that left at t and arrived at r of the robot proves that it is at most r - t. The middle is taken; before
    the first command was heard of, the lower bound.
    """

    def __init__(self) -> None:
        self._forget()

    def _forget(self) -> None:
        self._least, self._most = _Bound(), _Bound()

    def _contradicted(self) -> bool:
        """The bounds exclude each other: the robot's clock has jumped, and what was known about it is void."""
        least, most = self._least.largest(), self._most.largest()
        return least is not None and most is not None and least > -most + JUMP

    def state(self, stamp: float, received: float) -> None:
        """A state arrived: stamp on the robot's clock, received on the twin's [s]."""
        self._least.note(received, stamp - received)
        if self._contradicted():
            self._forget()
            self._least.note(received, stamp - received)

    def command(self, sent: float, heard: float, now: float) -> None:
        """A command arrived: sent on the twin's clock, heard on the robot's [s]; ``now`` on the twin's."""
        self._most.note(now, sent - heard)
        if self._contradicted():
            self._forget()
            self._most.note(now, sent - heard)

    @property
    def offset(self) -> float | None:
        """Robot's clock minus the twin's [s]; None before the first state."""
        least, most = self._least.largest(), self._most.largest()
        if least is None:
            return None
        return least if most is None or -most < least else 0.5 * (least - most)


class Lead:
    """Time before it acts at which a command must be computed to be there in time."""

    def __init__(self, step: float) -> None:
        """``step`` [s] of the robot: the lead is a multiple of it."""
        self._step = step
        self._begun: dict[int, float] = {}  # number of the command: when what it was computed from was observed
        self._ways: deque[float] = deque(maxlen=ARRIVALS)
        self._lead, self._lowered = 0.0, -math.inf

    def sent(self, seq: int, observed: float) -> None:
        """A command was computed from an observation made at ``observed`` [s], robot's clock."""
        self._begun[seq] = observed
        while len(self._begun) > SENT_KEPT:
            del self._begun[next(iter(self._begun))]

    def heard(self, seq: int, at: float) -> None:
        """It arrived at [s], robot's clock."""
        observed = self._begun.pop(seq, None)
        if observed is not None:
            self._ways.append(min(max(0.0, at - observed), MAX_LEAD))

    def now(self, time: float) -> float:
        """The lead [s] to use at ``time`` [s]: it rises at once, and falls by one step in two seconds."""
        ways = sorted(self._ways)
        longest = ways[int(IN_TIME * (len(ways) - 1))] if ways else 0.0
        needed = math.ceil(longest / self._step - 1e-6) * self._step
        if needed > self._lead:
            self._lead, self._lowered = needed, time
        elif needed < self._lead - 0.5 * self._step and time - self._lowered >= LOWER_AFTER:
            self._lead, self._lowered = max(0.0, self._lead - self._step), time
        return self._lead
