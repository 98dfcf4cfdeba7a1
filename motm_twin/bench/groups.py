"""The groups of trials that are measured, and the number that each must reach."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from motm_twin.external.emulator import LinkSpec

Result = dict[str, Any]  # of one trial: what `motm-twin run --json` prints
APPROACH = 0.02  # [m/s] a contact point faster than this towards the other moves into it


@dataclass(frozen=True, kw_only=True)
class Trial:
    """One run: a variant of a scene with a seed (None: the seed of the scene file)."""

    scene: str
    variant: str | None = None
    seed: int | None = None
    link: LinkSpec | None = None  # the robot in another process, behind this link, on a shared clock


@dataclass(frozen=True, kw_only=True)
class Goal:
    """A number to reach: at least, at most, or exactly."""

    name: str
    unit: str
    relation: str  # ">=" | "<=" | "=="
    limit: float
    measure: Callable[[list[Result]], float]
    decimals: int = 0

    def met_by(self, value: float) -> bool:
        """Whether a measured value reaches the goal; nan never does."""
        return {">=": value >= self.limit, "<=": value <= self.limit, "==": value == self.limit}[self.relation]


@dataclass(frozen=True, kw_only=True)
class Group:
    """Trials that are measured together."""

    name: str
    title: str
    trials: tuple[Trial, ...]
    goals: tuple[Goal, ...]
    alone: bool = False  # one trial at a time: its wall time is measured


def _sum_of(key: str) -> Callable[[list[Result]], float]:
    return lambda results: float(sum(result[key] for result in results))


def _mean_of(key: str) -> Callable[[list[Result]], float]:
    def mean(results: list[Result]) -> float:
        values = [result[key] for result in results]
        return float(np.mean(values)) if values and None not in values else float("nan")

    return mean


def _worst(key: str, part: str) -> Callable[[list[Result]], float]:
    """The worst over all trials but the first, which may have compiled kernels."""
    return lambda results: float(np.max([result[key][part] for result in results[1:]]))  # nan stays nan


def _mean_time(results: list[Result]) -> float:
    """Mean time [s] over completed trials only when all are: a trial that gave up early is not fast."""
    return _mean_of("time_s")(results) if all(result["success"] for result in results) else float("nan")


def _first_time(results: list[Result]) -> float:
    first = [result["time_s"] for result in results if result["variant"] == "trial1" and result["success"]]
    return first[0] if first else float("nan")


def _share_of_in_process(results: list[Result]) -> float:
    """Mean time through another process, as a share of the mean time of the same trials in one; nan unless all end."""
    return _mean_time(results) / _mean_of("in_process_s")(results)


def _contacts(results: list[Result]) -> float:
    return float(sum(len(result["contacts"]) for result in results))


def caused(results: list[Result]) -> int:
    """Contacts that the robot caused."""
    return sum(hit["caused_by_robot"] for result in results for hit in result["contacts"])


def drove_into(results: list[Result]) -> int:
    """Contacts in which our robot was moving into the other."""
    hits = (contact for result in results for contact in result["contacts"])
    return sum(hit["caused_by_robot"] or hit["closing_speed"] > APPROACH for hit in hits)


def _drove_into(results: list[Result]) -> float:
    return float(drove_into(results))


def _slowest_factor(results: list[Result]) -> float:
    """Over all trials but the first, which may have compiled kernels."""
    return min((result["realtime_factor"] for result in results[1:]), default=float("nan"))


def _different_hashes(results: list[Result]) -> float:
    return float(len({result["state_hash"] for result in results}))


def _unfinished(results: list[Result]) -> float:
    return float(sum(not result["success"] for result in results))


def _done(picks: int, contacts: Callable[[list[Result]], float] = _contacts) -> tuple[Goal, ...]:
    return (
        Goal(name="picked", unit="", relation="==", limit=picks, measure=_sum_of("picks_done")),
        Goal(name="placed", unit="", relation="==", limit=picks, measure=_sum_of("places_done")),
        Goal(name="contacts", unit="", relation="==", limit=0, measure=contacts),
        Goal(name="trials not completed", unit="", relation="==", limit=0, measure=_unfinished),
    )


def _published(scene: str, links: tuple[LinkSpec | None, ...] = (None,) * 10) -> tuple[Trial, ...]:
    return tuple(Trial(scene=scene, variant=f"trial{number}", link=link) for number, link in enumerate(links, start=1))


def _mean_limit(limit: float) -> Goal:
    return Goal(name="mean time", unit="s", relation="<=", limit=limit, measure=_mean_time, decimals=1)


GROUPS: dict[str, Group] = {
    group.name: group
    for group in (
        Group(
            name="exp1",
            title="Experiment 1, the ten published trials (paper, simulation: mean 95.9 s, trial 1 85.6 s)",
            trials=_published("exp1"),
            goals=(
                *_done(60),
                _mean_limit(95.9),
                Goal(name="trial 1", unit="s", relation="<=", limit=85.6, measure=_first_time, decimals=1),
                Goal(
                    name="base speed while the fingers close",
                    unit="m/s",
                    relation=">=",
                    limit=0.2,
                    measure=_mean_of("mean_closing_base_speed_mps"),
                    decimals=3,
                ),
            ),
        ),
        Group(
            name="exp1_random",
            title="Experiment 1, six of twelve slots at random, seeds 0 to 19",
            trials=tuple(Trial(scene="exp1", variant="random", seed=seed) for seed in range(20)),
            goals=_done(120),
        ),
        Group(
            name="exp1a",
            title="Experiment 1a, the ten trials with two boxes that the map does not know",
            trials=_published("exp1a"),
            goals=(*_done(60), _mean_limit(107.0)),
        ),
        Group(
            name="exp2",
            title="Experiment 2, four Temis drive round the table, seeds 0 to 9",
            trials=tuple(Trial(scene="exp2", variant="random", seed=seed) for seed in range(10)),
            goals=_done(60, _drove_into),
        ),
        Group(
            name="external",
            title="Experiment 1 with the robot in another process, on a shared clock",
            trials=_published("exp1", (LinkSpec(),) * 10),
            goals=(
                *_done(60),
                Goal(
                    name="mean time by in-process",
                    unit="",
                    relation="<=",
                    limit=1.05,
                    measure=_share_of_in_process,
                    decimals=3,
                ),
            ),
        ),
        Group(
            name="external_bad_link",
            title="The same through 50 ms latency, 20 ms jitter and 1 % loss in each direction",
            trials=_published(
                "exp1", tuple(LinkSpec(latency=0.05, jitter=0.02, loss=0.01, seed=seed) for seed in range(1, 11))
            ),
            goals=_done(60),
        ),
        Group(
            name="external_outages",
            title="The same through 20 ms latency, where in every 2 s nothing arrives for 0.25 s, at random times",
            trials=_published(
                "exp1", tuple(LinkSpec(latency=0.02, outage=0.25, every=2.0, seed=seed) for seed in range(1, 11))
            ),
            goals=tuple(goal for goal in _done(60) if goal.name != "picked"),  # what it loses it picks again
        ),
        Group(
            name="period",
            title="One period from observation to command, one core; the same trial three times, the first to warm up",
            trials=(Trial(scene="exp1", variant="trial1", seed=0),) * 3,
            goals=(
                Goal(name="p50", unit="ms", relation="<=", limit=10, measure=_worst("tick_ms", "p50"), decimals=2),
                Goal(name="p99", unit="ms", relation="<=", limit=25, measure=_worst("tick_ms", "p99"), decimals=2),
                Goal(
                    name="simulated by real time",
                    unit="x",
                    relation=">=",
                    limit=4,
                    measure=_slowest_factor,
                    decimals=1,
                ),
                Goal(name="different state hashes", unit="", relation="==", limit=1, measure=_different_hashes),
            ),
            alone=True,
        ),
    )
}
