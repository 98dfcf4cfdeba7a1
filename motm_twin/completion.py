"""When the work is over: the one time that a run, its rerun and its what-if tell."""

from motm_twin.control.tick import Tick

SETTLE_PERIODS = 40  # 2 s after the last task for a falling cube to land and the robot to come to rest


class Completion:
    """Follows the Ticks of a run until its last task is done and what it placed lies in its bin, or 2 s have passed."""

    def __init__(self) -> None:
        self._settle = SETTLE_PERIODS
        self._over_at: float | None = None
        self._time = 0.0

    def add(self, tick: Tick) -> None:
        """Take the next Tick into account. Tasks that a person adds take an end back."""
        self._time = tick.time
        if not tick.done:
            self._settle, self._over_at = SETTLE_PERIODS, None
            return
        if self._over_at is None and (all_placed(tick) or self._settle == 0):
            self._over_at = tick.time
        self._settle -= 1

    @property
    def over(self) -> bool:
        """Whether the work is over."""
        return self._over_at is not None

    @property
    def time_s(self) -> float:
        """Time of the work [s]: until it was over, or until the last Tick without that."""
        return round(self._time if self._over_at is None else self._over_at, 3)


def all_placed(tick: Tick) -> bool:
    """Whether the referee sees as many cubes in their bins as there are to be placed."""
    return tick.truth is not None and tick.truth.places >= sum(task.kind == "place" for task in tick.tasks)
