"""What a rehearsal leaves behind: the whole run, period by period and arm step by arm step.

A method that plans everything beforehand asks for one (`PlannerParts.rehearse`). Whoever builds the twin makes it
(`motm_twin.rehearse`): a rehearsal is a run of a simulated plant, which methods know nothing of.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from motm_twin.control.task_list import TaskEdit
from motm_twin.model.geometry import Array
from motm_twin.planning.types import BoolArray

ARM_STEPS = 5  # of a period


@dataclass(frozen=True, kw_only=True, eq=False)
class Rehearsed:
    """A run of the world as it is known beforehand: p periods, 5 p arm steps. Read only, so copies share it."""

    poses: Array  # base at the beginning of each period, from where the commands given act; world, shape (p, 3)
    twists: Array  # base twist commanded at the end of each period [m/s, rad/s], shape (p, 2)
    in_range: BoolArray  # the target was in range of the arm, shape (p,)
    blocked: BoolArray  # the base stood at the closest free place, shape (p,)
    q: Array  # arm joints before each step [rad], shape (5 p, 7)
    rates: Array  # commanded joint rates [rad/s], shape (5 p, 7)
    closed: BoolArray  # the gripper was told to close, shape (5 p,)
    phases: tuple[str, ...]  # of the arm, length 5 p
    outcomes: tuple[tuple[int, str], ...]  # arm step, and what the arm said in it: picked, placed, missed, lost
    failures: tuple[str, ...]  # tasks that were given up in rehearsal

    def __deepcopy__(self, memo: dict[int, Any]) -> "Rehearsed":
        return self

    @property
    def periods(self) -> int:
        """Length of the run."""
        return len(self.poses)


Timed = tuple[tuple[int, TaskEdit], ...]  # edits of the task list, each with the period at whose start it came
Rehearse = Callable[[Timed], Rehearsed]  # raises ValueError when the rehearsal can not take an edit
