"""Published times of the experiments, each with its source: what a run is compared with.

Paper: "Reactive Base Control for On-The-Move Mobile Manipulation in Dynamic Environments". Reister: Reister et al.,
"Combining Navigation and Manipulation Costs for Time-Efficient Robot Placement in Mobile Manipulation Tasks".
Experiment 1a is published as a box plot without numbers, and of the simulated Experiment 2 no time is given.
"""

from typing import NamedTuple

_TABLE = "Paper, Table I"
_EXP2 = "Paper, Sec. VI-B, Experiment 2"
_GRASPING = "; 40 s of it for grasping"


class Published(NamedTuple):
    """A published time of a whole task."""

    what: str
    seconds: float
    success: str  # objects delivered of objects wanted, "" when not given
    source: str
    real: bool  # on the real robot; else simulated


_OURS_TRIAL = Published("paper, this trial, simulated", 85.6, "", _TABLE, real=False)
_OURS_TRIAL_REAL = Published("paper, this trial, real robot", 91.0, "6/6", _TABLE, real=True)
_OURS_TEN = Published("paper, ten trials, simulated", 95.9, "", _TABLE, real=False)
_OURS_TEN_REAL = Published("paper, ten trials, real robot", 100.4, "58/60", _TABLE, real=True)
_SEQUENTIAL = Published("Reister, sequential, simulated", 172.3, "", f"{_TABLE}, from Reister; 40 s of it for grasping",
                        real=False)  # fmt: skip
_EXP2_TEMI_REAL = Published("paper, one Temi, real robot", 94.0, "", _EXP2, real=True)
_EXP2_ALONE_REAL = Published("paper, without the Temi, real robot", 91.0, "", _EXP2, real=True)

_RECOVERY = "Burgess-Limerick et al., Failure Recovery, arXiv 2305.08351, read off the chart; layout not published"
_RECOVERY_METHODS = ("Failure Recovery, on the move", "Failure Recovery, reactive rival of the TEB type")
FAILURE_RECOVERY: dict[str, dict[float, tuple[float, float]]] = {  # task: delay of the grasp [s]: times [s] of both
    "line": {0.0: (9.4, 11.6), 10.0: (18.8, 21.9)},
    "turn": {0.0: (10.9, 10.7), 10.0: (20.3, 22.0)},
    "obstructed_turn": {0.0: (13.3, 17.4), 10.0: (20.1, 29.0)},
}
RECOVERY_PLANNED = "planned on-the-move manipulation fails beyond a delay of 1 s (obstructed turn: 5 s)"

SINGLE_TRIAL = "trial1"
REFERENCE_TOUR_NOTE = (
    "shortest tour of the base centre past all picks and drops (0.80 m reach, furniture grown by 0.25 m) at full "
    "speed, without turning, accelerating or grasping: a reference, not a bound"
)


def published(scene: str, variant: str) -> tuple[Published, ...]:
    """The published times that a run of this scene and variant can be compared with; none for other scenes."""
    if scene == "exp1" and variant == SINGLE_TRIAL:
        return _OURS_TRIAL, _OURS_TRIAL_REAL, _OURS_TEN, _SEQUENTIAL
    if scene == "exp1":
        return _OURS_TEN, _OURS_TEN_REAL, _SEQUENTIAL
    if scene == "exp2":
        return _EXP2_TEMI_REAL, _EXP2_ALONE_REAL
    if scene in FAILURE_RECOVERY:
        return tuple(
            Published(f"{who}, grasps {delay:g} s late", seconds, "", _RECOVERY, real=False)
            for delay, times in FAILURE_RECOVERY[scene].items()
            for who, seconds in zip(_RECOVERY_METHODS, times, strict=True)
        )
    return ()


class TableRow(NamedTuple):
    """A row of the paper's table, with the method of ours that it is comparable with."""

    experiment: str
    method: str
    like: str
    seconds: float
    success: str
    source: str
    real: bool
    single: bool = False  # one arrangement, like trial 1


def _row(method: str, like: str, simulated: float, real: float, success: str, from_: str, single: bool = False):
    arrangement = "1, trial 1" if single else "1"
    grasping = _GRASPING if from_ else ""
    return (
        TableRow(arrangement, method, like, simulated, "", f"{_TABLE}, simulated{from_}{grasping}", False, single),
        TableRow(
            f"{arrangement}, real robot", method, like, real, success, f"{_TABLE}, real robot{from_}", True, single
        ),
    )


TABLE_I: tuple[TableRow, ...] = (
    *_row("IRM, Reister et al.", "irm", 192.9, 202.0, "6/6", ", from Reister"),
    *_row("Sequential, Reister et al.", "sequential", 172.3, 176.0, "6/6", ", from Reister"),
    *_row("Paper, single trial", "motm", 85.6, 91.0, "6/6", "", single=True),
    *_row("Paper, ten trials", "motm", 95.9, 100.4, "58/60", ""),
)
REDUCTIONS = {  # of the task time against the sequential method of Reister et al., as published
    "exp1": (0.43, "Paper, Sec. VII-A, simulated, 50 trials"),
    "exp1a": (0.46, "Paper, Sec. VII-B, simulated, 50 trials"),
    "trial1": (0.48, "Paper, Sec. VII-A, real robot, one trial"),
}
