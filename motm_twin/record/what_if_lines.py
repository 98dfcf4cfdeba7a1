"""The lines that a what-if writes, shared by its program and its readers."""

import msgspec

AS_IT_WAS, CHANGED = RUNS = ("as it was", "changed")
Mover = tuple[float, float, float, float]  # a Temi or a person: x, y, radius, height [m]


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """Pose of the robot, and places of Temis and persons, at one time."""

    run: str  # one of `RUNS`
    time: float  # [s] simulated
    pose: tuple[float, float, float]  # true base pose x, y, heading, world
    q: tuple[float, ...]  # arm joints [rad], 7
    gripper: float  # [m] between the finger pads
    movers: tuple[Mover, ...] = ()


class Outcome(msgspec.Struct, frozen=True, kw_only=True):
    """The end of a run."""

    run: str
    done: bool = True  # the last line of this run
    time_s: float  # [s] of the work, as in `motm-twin run`: until it was done, or else until the run ended
    picks: int
    places: int
    contacts: int  # caused by the robot
    all_contacts: int = 0  # by the robot or by others
    path_length: float  # [m] driven by the base
    success: bool
    reason: str  # why not, one sentence; "" after success
    skipped: tuple[str, ...] = ()  # recorded edits that the changed run could not accept, and why
    forecast_from_s: float | None = None  # [s] `time_s` is a forecast that begins here; None: it is as recorded

    @property
    def clock(self) -> str:
        """The time, marked when it is a forecast."""
        return f"{self.time_s:.1f} s" + ("" if self.forecast_from_s is None else " (forecast)")
