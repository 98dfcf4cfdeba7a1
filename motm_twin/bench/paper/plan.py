"""What `motm-twin paper` runs: experiments as trial specs, by default, in full, or quickly; and what that costs."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from motm_twin.bench import robustness
from motm_twin.bench.experiments.catalogue import NAMES_OF_ABLATIONS
from motm_twin.bench.experiments.spec import Experiment, TrialSpec
from motm_twin.methods.registry import METHODS
from motm_twin.model.edits import ParameterValue

COMPARED = ("motm", "staa", "motm2022", "holistic", "fixed_set", "irm", "greedy", "sequential")
STATIONARY = ("fixed_set", "irm", "greedy", "sequential", "sequential_overlap")
LITERAL, OVERLAP = "paper_literal", "sequential_overlap"  # besides, on Experiment 1; the second only in full
OURS = ("motm", "fast")  # what is judged: the paper's method, and our own
ABLATIONS = NAMES_OF_ABLATIONS
TEN = tuple(f"trial{k}" for k in range(1, 11))  # the published arrangements
SWEEPS: Mapping[str, tuple[str, tuple[float, ...]]] = {  # experiment: parameter, values besides the shipped one
    "sweep_next_weight": ("next_weight", (0.0, 0.5, 2.0)),
    "sweep_bezier_offset": ("bezier_offset", (0.1, 0.5)),
    "sweep_radius_min": ("radius_min", (0.5, 0.7)),
    "sweep_radius_max": ("radius_max", (0.7, 0.95)),
}
CPU_S = {"exp1": 19.0, "exp1a": 24.0, "exp2": 25.0}  # [s] of processor per trial of a method that does not stop
SHORT_S = 3.0  # [s] of one pick, as in the scenes of robustness and grasp delay
STOPS = 1.2  # a method that stops drives longer; while it stands, a period costs little
Trial = tuple[str, str, int | None]  # scene, variant, seed


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The trials of one report, and where it takes its examples from."""

    name: str
    experiments: tuple[Experiment, ...]
    absent: tuple[str, ...] = ()  # methods that were wanted, and are not there
    pages: bool = True  # photographs of the page, where there is a Chromium
    notes: tuple[str, ...] = ()

    def trials(self) -> int:
        """How many trials there are."""
        return sum(len(experiment.specs) for experiment in self.experiments)

    def hours(self, workers: int) -> float:
        """What they are expected to take [h]."""
        seconds = sum(cpu_seconds(spec) for experiment in self.experiments for spec in experiment.specs)
        return seconds / workers / 3600.0


def cpu_seconds(spec: TrialSpec) -> float:
    """Expected processor time [s] of a trial."""
    base = CPU_S.get(spec.scene, SHORT_S)
    return base * (STOPS if spec.method in STATIONARY or spec.method == "no_pass_through" else 1.0)


def default() -> Plan:
    """Eight methods and our own on ten trials of 1 and 1a and five of 2, modifications on ten, some of the errors."""
    compared, besides, ablations, absent = _there()
    compared = _with_ours(compared)
    exp1 = (
        *_trials("exp1", compared, TEN),
        *_trials("exp1", [name for name in besides if name == LITERAL], TEN),
        *_seeds("exp1", OURS, "random", range(5)),  # what Experiment 2 is compared with
    )
    return Plan(
        name="default",
        experiments=(
            Experiment("exp1", "Experiment 1", exp1),
            Experiment("exp1a", "Experiment 1a: two boxes that the map does not know", _trials("exp1a", compared, TEN)),
            Experiment("exp2", "Experiment 2: Temis", _seeds("exp2", compared, "random", range(5))),
            Experiment("ablations", "Each modification switched off alone", _trials("exp1", ablations, TEN)),
            *errors((robustness.REACTIVE, robustness.PLANNED), seeds=2, delays=(robustness.DELAY,)),
        ),
        absent=absent,
    )


def full() -> Plan:
    """Fifty seeds everywhere, and the ten published trials; also for the own method `fast`."""
    compared, besides, ablations, absent = _there()
    compared = _with_ours(compared)
    seeds = range(50)
    exp1 = (
        *_trials("exp1", (*compared, *besides), TEN),
        *_seeds("exp1", (*compared, *besides), "random", seeds),
        *_seeds("exp1", OURS, TEN[0], seeds[1:]),  # what Experiment 2 with one Temi is compared with
    )
    exp1a = (*_trials("exp1a", compared, TEN), *_seeds("exp1a", compared, "random", seeds))
    exp2 = (*_seeds("exp2", compared, "random", seeds), *_one_temi(seeds))
    return Plan(
        name="full",
        experiments=(
            Experiment("exp1", "Experiment 1", exp1),
            Experiment("exp1a", "Experiment 1a: two boxes that the map does not know", exp1a),
            Experiment("exp2", "Experiment 2: Temis", exp2),
            Experiment(
                "ablations",
                "Each modification switched off alone",
                (*_trials("exp1", ablations, TEN), *_seeds("exp1", ablations, "random", seeds)),
            ),
            *sweeps(TEN, seeds),
            *errors(robustness.METHODS, seeds=50, delays=tuple(robustness.GRASP_FAULTS)),
        ),
        absent=absent,
    )


def quick() -> Plan:
    """One trial of everything: the whole way in five minutes. Its numbers say little, and the report says so."""
    compared, _, ablations, absent = _there()
    few = tuple(name for name in compared if name in ("motm", "irm", "sequential"))
    return Plan(
        name="quick",
        experiments=(
            Experiment("exp1", "Experiment 1", _trials("exp1", compared, TEN[:1])),
            Experiment("exp1a", "Experiment 1a: two boxes that the map does not know", _trials("exp1a", few, TEN[:1])),
            Experiment("exp2", "Experiment 2: Temis", _seeds("exp2", ("motm",), "random", range(1))),
            Experiment(
                "ablations", "Each modification switched off alone", _trials("exp1", ablations[:3], TEN[:1])
            ),
        ),
        absent=absent,
        notes=("A quick report: one trial of each kind. It shows that everything works, and compares nothing.",),
    )  # fmt: skip


PLANS = {"default": default, "full": full, "quick": quick}


def errors(methods: Sequence[str], *, seeds: int, delays: Sequence[str]) -> tuple[Experiment, ...]:
    """Robustness for these methods, and grasp delay for all of its own with these faults."""
    there = [name for name in methods if name in METHODS]
    late = [name for name in robustness.METHODS if name in METHODS]
    grasps = robustness.grasp_delay_specs(late, max(1, seeds // 2))
    return (
        Experiment("robustness", "One error at a time", tuple(robustness.robustness_specs(there, seeds))),
        Experiment("grasp_delay", "Late grasps", tuple(each for each in grasps if set(each.changes) <= set(delays))),
    )


def sweeps(variants: Iterable[str], seeds: Iterable[int] = ()) -> tuple[Experiment, ...]:
    """One experiment per swept parameter, each with the shipped value as well."""
    published: list[Trial] = [("exp1", variant, None) for variant in variants]
    trials = [*published, *(("exp1", "random", seed) for seed in seeds)]
    return tuple(
        Experiment(name, f"Sweep of {parameter}", tuple(_swept(trials, parameter, values)))
        for name, (parameter, values) in SWEEPS.items()
    )


def _swept(trials: Sequence[Trial], parameter: str, values: Iterable[float]) -> Iterable[TrialSpec]:
    """Only other values than the shipped one: that is in Experiment 1 already."""
    for value in values:
        parameters: dict[str, ParameterValue] = {parameter: value}
        for scene, variant, seed in trials:
            yield TrialSpec(scene, variant, seed, parameters=parameters)


def _trials(scene: str, methods: Iterable[str], variants: Iterable[str]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, method=method) for variant in variants for method in methods)


def _seeds(scene: str, methods: Iterable[str], variant: str, seeds: Iterable[int]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, seed, method=method) for seed in seeds for method in methods)


def _one_temi(seeds: Iterable[int]) -> tuple[TrialSpec, ...]:
    """The arrangement of trial 1 with one Temi."""
    return _seeds("exp2", OURS, "one_temi", seeds)


def _with_ours(compared: tuple[str, ...]) -> tuple[str, ...]:
    return (*compared, *(name for name in OURS if name not in compared))


def _there() -> tuple[tuple[str, ...], tuple[str, ...], tuple[str, ...], tuple[str, ...]]:
    """Compared methods, those besides, and modifications that are there; and what is not."""
    groups = (COMPARED, (LITERAL, OVERLAP), ABLATIONS)
    absent = tuple(name for group in groups for name in group if name not in METHODS)
    compared, besides, ablations = (tuple(name for name in group if name in METHODS) for group in groups)
    return compared, besides, ablations, absent
