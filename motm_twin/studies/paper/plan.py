"""Plans of `motm-twin paper`: experiments as trial specs, by default, in full, or quickly; and their expected cost."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from motm_twin.model.edits import ParameterValue
from motm_twin.studies import catalogue
from motm_twin.studies.catalogue import NAMES_OF_ABLATIONS, SWEPT_AMONG_BOXES
from motm_twin.studies.spec import Experiment, TrialSpec

COMPARED = ("motm", "staa", "motm2022", "holistic", "fixed_set", "irm", "greedy", "sequential")
OURS = ("motm", "fast")  # what is judged: the paper's method, and our own
ALL = (*COMPARED, "fast")
LITERAL, OVERLAP = "paper_literal", "sequential_overlap"  # besides, on Experiment 1
WITH_ERRORS = (catalogue.REACTIVE, catalogue.PLANNED)  # methods that are compared under every error
ABLATIONS = NAMES_OF_ABLATIONS
TEN = tuple(f"trial{k}" for k in range(1, 11))  # the published arrangements
FIVE = TEN[:5]  # those of a sweep by default
SWEEPS: Mapping[str, tuple[str, tuple[float, ...]]] = {  # experiment: parameter, values besides the shipped one
    "sweep_next_weight": ("next_weight", (0.0, 0.5, 2.0)),
    "sweep_bezier_offset": ("bezier_offset", (0.1, 0.5)),
    "sweep_radius_min": ("radius_min", (0.5, 0.7)),
    "sweep_radius_max": ("radius_max", (0.7, 0.95)),
}
QUICK_LEVEL = 2  # of every error in a quick report, counted from none
QUICK_DELAY = 10.0  # [s] of the grasps in a quick report
CPU_S = {"exp1": 9.0, "exp1a": 14.0, "exp2": 17.0}  # [s] of one processor per trial, the mean over all methods
SHORT_S = 1.0  # [s] of one pick, as in the scenes of robustness and grasp delay
LONGER = {"motm2022": 1.6}  # it gives up late
EXP1, EXP1A, EXP2 = "Experiment 1", "Experiment 1a: two unmapped boxes", "Experiment 2: Temis"
OFF = "Each modification switched off alone"


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The trials of one report."""

    name: str
    experiments: tuple[Experiment, ...]
    notes: tuple[str, ...] = ()

    def specs(self) -> list[TrialSpec]:
        """Those of all experiments."""
        return [spec for experiment in self.experiments for spec in experiment.specs]


def hours(specs: Iterable[TrialSpec], workers: int) -> float:
    """Expected time of trials [h]."""
    return sum(map(cpu_seconds, specs)) / workers / 3600.0


def cpu_seconds(spec: TrialSpec) -> float:
    """Expected processor time [s] of a trial."""
    return CPU_S.get(spec.scene, SHORT_S) * LONGER.get(spec.method, 1.0)


def default() -> Plan:
    """All methods on ten trials of 1 and 1a and five of 2, modifications on ten, all errors, sweeps on five."""
    exp1 = (
        *_trials("exp1", (*ALL, LITERAL, OVERLAP), TEN),
        *_seeds("exp1", OURS, "random", range(5)),  # what Experiment 2 is compared with
    )
    return Plan(
        name="default",
        experiments=(
            Experiment("exp1", EXP1, exp1),
            Experiment("exp1a", EXP1A, _trials("exp1a", ALL, TEN)),
            Experiment("exp2", EXP2, _seeds("exp2", ALL, "random", range(5))),
            Experiment("ablations", OFF, _trials("exp1", ABLATIONS, TEN)),
            *sweeps(FIVE),
            *errors(WITH_ERRORS, seeds=10, late=5),
        ),
    )


def full() -> Plan:
    """Fifty seeds everywhere, and the ten published trials."""
    seeds = range(50)
    methods = (*ALL, LITERAL, OVERLAP)
    exp1 = (
        *_trials("exp1", methods, TEN),
        *_seeds("exp1", methods, "random", seeds),
        *_seeds("exp1", OURS, TEN[0], seeds[1:]),  # what Experiment 2 with one Temi is compared with
    )
    exp1a = (*_trials("exp1a", ALL, TEN), *_seeds("exp1a", ALL, "random", seeds))
    exp2 = (*_seeds("exp2", ALL, "random", seeds), *_seeds("exp2", OURS, "one_temi", seeds))
    ablations = (*_trials("exp1", ABLATIONS, TEN), *_seeds("exp1", ABLATIONS, "random", seeds))
    return Plan(
        name="full",
        experiments=(
            Experiment("exp1", EXP1, exp1),
            Experiment("exp1a", EXP1A, exp1a),
            Experiment("exp2", EXP2, exp2),
            Experiment("ablations", OFF, ablations),
            *sweeps(TEN, seeds),
            *errors(catalogue.COMPARED_METHODS, seeds=50, late=50),
        ),
    )


def quick() -> Plan:
    """A complete run in five minutes. Its numbers say little, and the report says so."""
    one, few = TEN[:1], ("motm", "fast", "irm", "sequential")
    levels = {name: values[QUICK_LEVEL] for name, values in catalogue.ERRORS.items()} | {catalogue.DELAY: QUICK_DELAY}
    return Plan(
        name="quick",
        experiments=(
            Experiment("exp1", EXP1, _trials("exp1", (*ALL, LITERAL, OVERLAP), one)),
            Experiment("exp1a", EXP1A, _trials("exp1a", few, one)),
            Experiment("exp2", EXP2, _seeds("exp2", OURS, "random", range(1))),
            Experiment("ablations", OFF, _trials("exp1", ABLATIONS, one)),
            *sweeps(one, last=True),
            *errors(WITH_ERRORS, seeds=1, late=1, levels=levels),
        ),
        notes=(
            "A quick report: one trial each of all methods and modifications on Experiment 1, of motm, fast, irm and "
            "sequential on 1a, of motm and fast on 2; one seed of one level of every error and of grasps that are "
            f"{QUICK_DELAY:g} s late, and of none; one value of every swept parameter. It shows that everything works, "
            "and compares nothing.",
        ),
    )


PLANS = {"quick": quick, "default": default, "full": full}  # each has more trials than the one before


def errors(
    methods: Sequence[str], *, seeds: int, late: int, levels: Mapping[str, float] | None = None
) -> tuple[Experiment, ...]:
    """Robustness for these methods with so many seeds; late, missed and slipped grasps for all of its own.

    ``levels``: the only one of each error, besides none.
    """

    def chosen(specs: Iterable[TrialSpec]) -> tuple[TrialSpec, ...]:
        return tuple(spec for spec in specs if levels is None or _has(spec, levels))

    alone = chosen(catalogue.robustness_specs(methods, seeds))
    grasps = chosen(catalogue.grasp_delay_specs(catalogue.COMPARED_METHODS, late))
    return (
        Experiment("robustness", "One error at a time", alone),
        Experiment("grasp_delay", "Grasps that are late, miss or slip", grasps),
    )


def _has(spec: TrialSpec, levels: Mapping[str, float]) -> bool:
    return all(name in levels and value in (0.0, levels[name]) for name, value in spec.changes.items())


def sweeps(variants: Sequence[str], seeds: Iterable[int] = (), *, last: bool = False) -> tuple[Experiment, ...]:
    """One experiment per swept parameter; ``last``: of its values the last only."""
    where = [*((variant, None) for variant in variants), *(("random", seed) for seed in seeds)]
    return tuple(
        Experiment(name, f"Sweep of {parameter}", tuple(_swept(where, parameter, values[-1:] if last else values)))
        for name, (parameter, values) in SWEEPS.items()
    )


def swept_scenes(parameter: str) -> tuple[str, ...]:
    """Scenes on which a parameter is swept."""
    return ("exp1", *SWEPT_AMONG_BOXES.get(parameter, ()))


def _swept(where: Sequence[tuple[str, int | None]], parameter: str, values: Sequence[float]) -> Iterable[TrialSpec]:
    """Only other values than the shipped one: that is in Experiments 1 and 1a already."""
    for value in values:
        parameters: dict[str, ParameterValue] = {parameter: value}
        for scene in swept_scenes(parameter):
            yield from (TrialSpec(scene, variant, seed, parameters=parameters) for variant, seed in where)


def _trials(scene: str, methods: Iterable[str], variants: Iterable[str]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, method=method) for variant in variants for method in methods)


def _seeds(scene: str, methods: Iterable[str], variant: str, seeds: Iterable[int]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, seed, method=method) for seed in seeds for method in methods)
