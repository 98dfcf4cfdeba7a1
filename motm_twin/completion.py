"""Completion of the tasks: the one task time that a run, its rerun and its what-if report."""

from motm_twin.control.tick import Tick

SETTLE_PERIODS = 40  # 2 s after the last task, for a falling cube to land and the robot to stop


class Completion:
    """Follows the Ticks of a run until its last task is done and all cubes lie in their bins, or 2 s have passed."""

    def __init__(self) -> None:
        self._settle = SETTLE_PERIODS
        self._over_at: float | None = None
        self._time = 0.0

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account. Tasks that a person adds revoke the completion."""
        self._time = tick.time
        if not tick.done:
            self._settle, self._over_at = SETTLE_PERIODS, None
            return
        if self._over_at is None and (all_placed(tick) or self._settle == 0):
            self._over_at = tick.time
        self._settle -= 1

    @property
    def over(self) -> bool:
        """True once the tasks are complete."""
        return self._over_at is not None

    @property
    def time_s(self) -> float:
        """Task time [s]: until completion, or else until the last Tick."""
        return round(self._time if self._over_at is None else self._over_at, 3)


def all_placed(tick: Tick) -> bool:
    """The referee counts as many cubes in their bins as there are to be placed."""
    return tick.truth is not None and tick.truth.places >= sum(task.kind == "place" for task in tick.tasks)
