"""Wall time of the stages of a period, for the reader who wonders where 50 ms go."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

OURS = ("map", "place", "plan", "arm", "monitor")  # the plant's own time is not counted in the period


class Stages:
    """Adds up the time that is spent in each stage; the clock [s] may be one that stands still."""

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._seconds: dict[str, float] = dict.fromkeys(("observe", *OURS), 0.0)

    @contextmanager
    def measure(self, stage: str) -> Iterator[None]:
        """Count the time of the block for a stage."""
        began = self._clock()
        yield
        self._seconds[stage] += self._clock() - began

    def milliseconds(self) -> dict[str, float]:
        """Each stage [ms], and their sum without the plant's as "period"."""
        times = {stage: 1e3 * seconds for stage, seconds in self._seconds.items()}
        return {**times, "period": sum(times[stage] for stage in OURS)}
