"""The reward: the referee's events of a period, each with a weight."""

from dataclasses import dataclass

from motm_twin.control.tick import Tick
from motm_twin.model.plant import Truth


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weight of each event. Objects count once: lifting the same one again earns nothing."""

    second: float = -1.0  # for every second that passes
    pick: float = 10.0  # an object lifted for the first time
    place: float = 10.0  # an object in a bin where the task list wants it, for the first time
    drop: float = -10.0  # an object fell elsewhere
    contact: float = -20.0  # an episode of contact that the robot caused
    given_up: float = -10.0  # a task that failed


@dataclass(frozen=True, kw_only=True)
class Score:
    """Events since the reset."""

    time: float = 0.0  # [s]
    picked: frozenset[str] = frozenset()  # objects that were lifted at least once
    placed: frozenset[str] = frozenset()  # objects that were in a right bin at least once
    lifts: int = 0
    landings: int = 0
    drops: int = 0
    contacts: int = 0
    caused: int = 0  # of the contacts, by the robot
    dropped: frozenset[str] = frozenset()  # objects that fell elsewhere and were not picked up and placed since
    given_up: int = 0


def score_of(before: Score, tick: Tick, truth: Truth, time: float) -> Score:
    """The score at the end of a period, at ``time`` [s]."""
    held = {item.name for item in truth.objects if item.state == "held"} if truth.picks > before.lifts else set()
    binned = {item.name for item in truth.objects if item.state.startswith("binned:")}
    return Score(
        time=time,
        picked=before.picked | held,
        placed=before.placed | binned if truth.places > before.landings else before.placed,
        lifts=truth.picks,
        landings=truth.places,
        drops=truth.drops,
        contacts=len(truth.contacts),
        caused=sum(contact.caused_by_robot for contact in truth.contacts),
        dropped=frozenset(truth.dropped),
        given_up=sum(task.status == "failed" for task in tick.tasks),
    )


def reward(weights: RewardWeights, before: Score, now: Score) -> float:
    """Reward of the change from one score to the next."""
    return (
        weights.second * (now.time - before.time)
        + weights.pick * (len(now.picked) - len(before.picked))
        + weights.place * (len(now.placed) - len(before.placed))
        + weights.drop * (now.drops - before.drops)
        + weights.contact * (now.caused - before.caused)
        + weights.given_up * (now.given_up - before.given_up)
    )
