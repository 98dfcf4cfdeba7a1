"""The progress clock of a task: the time since the remaining way last became shorter, and what is tried then.

The robot never waits or circles for ever. Without progress it first waits, then backs off, turns to look where its
lidar does not see, plans with less and less clearance, goes for another place (and backs off once more if it stands
although there is a path). In the end the sequence does another task first, or gives the task up.
"""

import math
from dataclasses import dataclass
from typing import Annotated

import msgspec
import numpy as np

from motm_twin.control.sequence import TaskSequence
from motm_twin.model.geometry import Array
from motm_twin.model.number import OWN, Number
from motm_twin.planning.types import BasePlan, Placement, Recovery

STANDS = 0.02  # [m] within which a base stands
STOOD = 2.0  # [s] within that distance, after which a base counts as standing
TRIES = 0.5  # [s] for which each way to back off is tried, unless the base moves


class ProgressParameters(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of a robot without progress, for each remedy."""

    back_off: Annotated[float, Number("s", OWN, "time without progress after which the base backs off")] = 3.0
    look: Annotated[
        float, Number("s", OWN, "time without progress after which the base turns to where its lidar does not see")
    ] = 5.0
    tight: Annotated[float, Number("s", OWN, "time without progress after which plans keep less room")] = 6.0
    tightest: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time without progress after which plans keep the true footprint; less room is kept as long after progress",
        ),
    ] = 8.0
    elsewhere: Annotated[
        float, Number("s", OWN, "time without progress after which the base goes for another place")
    ] = 12.0
    gain: Annotated[
        float, Number("s", OWN, "progress: the time left on the way is shorter by this than ever before")
    ] = 0.2
    relocated: Annotated[
        float, Number("m", OWN, "distance by which the goal of the base must move to count as another")
    ] = 0.5
    relocations: Annotated[
        int,
        Number(
            "",
            OWN,
            "times that another goal resets the shortest way left; a robot that circles changes it again and again",
        ),
    ] = 3


@dataclass
class ProgressState:
    """The clock of the active task."""

    task: int = -1
    goal: Array | None = None
    best: float = math.inf  # [s] least time left on the way so far
    relocations: int = 0
    since: float = 0.0  # [s] of the last progress
    hardest: float = 0.0  # [s] length of the last hold-up that ended by planning with less room, or for another place
    eased: float = -math.inf  # [s] time at which that hold-up ended
    avoid: tuple[Array, ...] = ()  # places that the base failed to get to
    rest: Array | None = None  # pose at which the base has stood ...
    rests: float = 0.0  # ... since this time [s]
    attempt: int = 0  # number of the way to back off being tried; 0: none
    tried: float = 0.0  # [s] time since when that way is tried

    def restart(self, task: int, time: float) -> None:
        """Start the clock of another task."""
        self.__init__(task=task, since=time)


class Progress:
    """The progress clock of one task after the other; its state is a part of the loop's."""

    def __init__(self, state: ProgressState, period: float, parameters: ProgressParameters | None = None) -> None:
        """``period`` [s] of control."""
        self.state, self._period = state, period
        self._parameters = parameters or ProgressParameters()

    def recovery(self, time: float) -> Recovery:
        """Recovery measures of this period."""
        state, p = self.state, self._parameters
        stalled = time - state.since
        if time - state.eased < p.tightest:
            stalled = max(stalled, state.hardest)
        again = 0.0 <= time - state.since - p.elsewhere < p.look - p.back_off and state.attempt > 0
        return Recovery(
            back_off=again or p.back_off <= time - state.since < p.look,
            attempt=state.attempt,
            look=p.look <= time - state.since < p.tight,
            tightness=0.0 if stalled < p.tight else 0.5 if stalled < p.tightest else 1.0,
            avoid=np.array(state.avoid).reshape(-1, 3),
        )

    def watch(
        self, time: float, task: int, pose: Array, placement: Placement, plan: BasePlan, *, counts: bool
    ) -> float:
        """Take a period into account; returns the time [s] without progress. ``counts``: the base has to move."""
        state, p = self.state, self._parameters
        if state.rest is None or math.dist(state.rest[:2], pose[:2]) > STANDS:
            state.rest, state.rests = pose, time
        if task != state.task or not counts:
            if task != state.task:
                state.restart(task, time)
            self._keep_eased(time)
            state.since, state.attempt = time, 0
            return 0.0
        if state.goal is None or math.dist(state.goal[:2], placement.goal[:2]) > p.relocated:
            if state.goal is not None:
                state.relocations += 1
            if state.relocations <= p.relocations:
                state.best = math.inf
            state.goal = np.array(placement.goal)
        left = way_left(placement, plan)
        if left < state.best - p.gain:
            if math.isfinite(state.best):
                self._keep_eased(time)
                state.since, state.attempt = time, 0
            state.best = left
        stalled = time - state.since
        if any(stalled >= begins > stalled - self._period for begins in (p.back_off, p.elsewhere)):
            state.attempt, state.tried = int(time - state.rests >= STOOD), time
        if state.attempt and time - max(state.rests, state.tried) >= TRIES:
            state.attempt, state.tried = state.attempt + 1, time
        if stalled >= p.elsewhere > stalled - self._period and placement.chosen >= 0:
            state.avoid += (np.array(placement.goal),)
        return stalled

    def _keep_eased(self, time: float) -> None:
        """Remember the length of a hold-up that ended under tight planning, to plan as tightly for a while."""
        state, p = self.state, self._parameters
        stalled = time - state.since
        if stalled >= p.tight or time - state.eased < p.tightest:
            state.hardest, state.eased = max(stalled, state.hardest), time


def way_left(placement: Placement, plan: BasePlan) -> float:
    """Time [s] until the target is in range, or else until the base is at its place; inf without a path."""
    if plan.time_to_range < math.inf:
        return plan.time_to_range
    if placement.chosen >= 0 and placement.cost_current[placement.chosen] < math.inf:
        return float(placement.cost_current[placement.chosen])
    return math.inf


def base_has_to_move(sequence: TaskSequence, plan: BasePlan, *, busy: bool, by_hand: bool) -> bool:
    """Test that progress of the task depends on the base: not on the arm, nor on a person who drives."""
    return sequence.active is not None and not busy and not by_hand and plan.time_to_range > 0.0
