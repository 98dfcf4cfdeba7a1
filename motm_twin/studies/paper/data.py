"""The trials of `motm-twin paper`: plans with their expected cost, results by method and trial, and the store.

Task times are only taken from completed trials.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgspec

from motm_twin.methods.registry import METHODS
from motm_twin.model.edits import ParameterValue
from motm_twin.perf.report import machine
from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies import catalogue, statistics
from motm_twin.studies.catalogue import NAMES_OF_ABLATIONS, SWEPT_AMONG_BOXES
from motm_twin.studies.run import TRIALS, Record, chosen
from motm_twin.studies.run import Store as Trials
from motm_twin.studies.spec import MACHINE, Experiment, TrialSpec, jobs_of
from motm_twin.studies.statistics import Estimate, completed

COMPARED = ("motm", "staa", "motm2022", "holistic", "fixed_set", "irm", "greedy", "sequential")
OURS = ("motm", "fast")  # the methods that are judged: the paper's and our own
ALL = (*COMPARED, "fast")
LITERAL, OVERLAP = "paper_literal", "sequential_overlap"  # additional methods on Experiment 1
WITH_ERRORS = (catalogue.REACTIVE, catalogue.PLANNED)  # methods compared under every error
ABLATIONS = NAMES_OF_ABLATIONS
TEN = tuple(f"trial{k}" for k in range(1, 11))  # the published arrangements
FIVE = TEN[:5]  # arrangements of a sweep in the default plan
SWEEPS: Mapping[str, tuple[str, tuple[float, ...]]] = {  # experiment: parameter, values other than the shipped one
    "sweep_next_weight": ("next_weight", (0.0, 0.5, 2.0)),
    "sweep_bezier_offset": ("bezier_offset", (0.1, 0.5)),
    "sweep_radius_min": ("radius_min", (0.5, 0.7)),
    "sweep_radius_max": ("radius_max", (0.7, 0.95)),
}
QUICK_LEVEL = 2  # index of the only level of each error in a quick report; 0: no error
QUICK_DELAY = 10.0  # [s] of late grasps in a quick report
CPU_S = {"exp1": 9.0, "exp1a": 14.0, "exp2": 17.0}  # [s] processor time per trial, the mean over all methods
SHORT_S = 1.0  # [s] processor time of any other scene: one pick, as for robustness and grasp delay
LONGER = {"motm2022": 1.6}  # factor on the processor time: this method gives up late
EXP1, EXP1A, EXP2 = "Experiment 1", "Experiment 1a: two unmapped boxes", "Experiment 2: Temis"
OFF = "Each modification switched off alone"


@dataclass(frozen=True, kw_only=True)
class Plan:
    """The trials of one report."""

    name: str
    experiments: tuple[Experiment, ...]
    notes: tuple[str, ...] = ()

    def specs(self) -> list[TrialSpec]:
        """The trials of all experiments."""
        return [spec for experiment in self.experiments for spec in experiment.specs]


def hours(specs: Iterable[TrialSpec], workers: int) -> float:
    """Expected time of trials [h]."""
    return sum(map(cpu_seconds, specs)) / workers / 3600.0


def cpu_seconds(spec: TrialSpec) -> float:
    """Expected processor time [s] of a trial."""
    return CPU_S.get(spec.scene, SHORT_S) * LONGER.get(spec.method, 1.0)


def default() -> Plan:
    """All methods on ten trials of Experiments 1 and 1a and five of 2; ablations on ten, sweeps on five; all errors."""
    exp1 = (
        *_trials("exp1", (*ALL, LITERAL, OVERLAP), TEN),
        *_seeds("exp1", OURS, "random", range(5)),  # compared with Experiment 2
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
    """Fifty seeds everywhere in addition to the ten published trials."""
    seeds = range(50)
    methods = (*ALL, LITERAL, OVERLAP)
    exp1 = (
        *_trials("exp1", methods, TEN),
        *_seeds("exp1", methods, "random", seeds),
        *_seeds("exp1", OURS, TEN[0], seeds[1:]),  # compared with Experiment 2 with one Temi
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
    """A complete run in five minutes. Its numbers mean little, and the report says so."""
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
OPTIONS_OF_PLANS = {"quick": " --quick", "default": "", "full": " --full --yes"}  # of `motm-twin paper`


def errors(
    methods: Sequence[str], *, seeds: int, late: int, levels: Mapping[str, float] | None = None
) -> tuple[Experiment, ...]:
    """Experiments on robustness (``methods``, ``seeds``), and on late, missed and slipped grasps (its own methods).

    ``seeds``, ``late``: number of seeds of the two. ``levels``: the only level of each error, besides no error.
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
    """One experiment per swept parameter; ``last``: only with the last of its values."""
    where = [*((variant, None) for variant in variants), *(("random", seed) for seed in seeds)]
    return tuple(
        Experiment(name, f"Sweep of {parameter}", tuple(_swept(where, parameter, values[-1:] if last else values)))
        for name, (parameter, values) in SWEEPS.items()
    )


def swept_scenes(parameter: str) -> tuple[str, ...]:
    """Scenes on which a parameter is swept."""
    return ("exp1", *SWEPT_AMONG_BOXES.get(parameter, ()))


def _swept(where: Sequence[tuple[str, int | None]], parameter: str, values: Sequence[float]) -> Iterable[TrialSpec]:
    """Trials of these values; the shipped one is not among them, as Experiments 1 and 1a already have it."""
    for value in values:
        parameters: dict[str, ParameterValue] = {parameter: value}
        for scene in swept_scenes(parameter):
            yield from (TrialSpec(scene, variant, seed, parameters=parameters) for variant, seed in where)


def _trials(scene: str, methods: Iterable[str], variants: Iterable[str]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, method=method) for variant in variants for method in methods)


def _seeds(scene: str, methods: Iterable[str], variant: str, seeds: Iterable[int]) -> tuple[TrialSpec, ...]:
    return tuple(TrialSpec(scene, variant, seed, method=method) for seed in seeds for method in methods)


Result = dict[str, Any]
SCENES = ("exp1", "exp1a", "exp2")
Key = tuple[str, int]  # variant and seed: the same arrangement and the same noise


class Store:
    """Results by experiment; an empty list for an experiment that was not run."""

    def __init__(self, trials: Mapping[str, Sequence[Result]]) -> None:
        self.trials = {name: _own(name, results) for name, results in trials.items()}

    def of(self, experiment: str, **fields: Any) -> list[Result]:
        """Results of an experiment in which these fields have these values."""
        return chosen(self.trials.get(experiment, ()), fields)

    def methods(self, experiment: str) -> list[str]:
        """Methods of an experiment in the order in which they are shown: the paper's first."""
        there = {result["method"] for result in self.trials.get(experiment, ())}
        known = [name for name in METHODS if name in there]
        return known + sorted(there.difference(known))

    def all(self) -> list[tuple[str, Result]]:
        """Every result with its experiment."""
        return [(name, result) for name, results in self.trials.items() for result in results]


def _own(experiment: str, results: Sequence[Result]) -> Sequence[Result]:
    """The trials of Experiments 1, 1a, 2 on their own scene as shipped; `bench` also stores those to compare with."""
    if experiment not in SCENES:
        return results
    return [each for each in results if each["scene"] == experiment and not each["parameters"] and not each["changes"]]


def ten(results: Iterable[Result]) -> list[Result]:
    """Results of the ten published arrangements with the seed of the scene file."""
    return [result for result in results if result["variant"] in TEN and result["seed"] == 0]


def random(results: Iterable[Result]) -> list[Result]:
    """Results of random arrangements."""
    return [result for result in results if result["variant"] == "random"]


def key(result: Result) -> Key:
    """Variant and seed of a trial: the trials of two methods with equal keys are compared."""
    return result["variant"], result["seed"]


def times(results: Iterable[Result]) -> dict[Any, float]:
    """Task times [s] of the completed trials by key: a trial that gave up early does not count as fast."""
    return {key(result): float(result["time_s"]) for result in results if completed(result)}


def mean_time(results: Iterable[Result]) -> Estimate:
    """Mean task time [s] of the completed trials with its interval."""
    return statistics.mean(list(times(results).values()))


def placed(results: Iterable[Result]) -> tuple[int, int]:
    """Number of delivered objects, and of objects to deliver."""
    these = list(results)
    return sum(each["places_done"] for each in these), sum(each["places_total"] for each in these)


def contacts(results: Iterable[Result]) -> int:
    """Number of contacts that the robot caused."""
    return sum(int(result["contacts_caused_by_robot"]) for result in results)


def measure(result: Result, *names: str) -> float | None:
    """One of the trial's further measures by its path of names; the length of a list; None: not taken."""
    value: Any = result.get("measures")
    for name in names:
        value = value.get(name) if isinstance(value, Mapping) else None
    if isinstance(value, Sequence) and not isinstance(value, str):
        return float(len(value))
    return float(value) if isinstance(value, (int, float)) else None


def command_of(spec: TrialSpec, verb: str = "run") -> str:
    """Command that runs (or serves) this trial again; only for a trial without changes: `run` takes no parameters."""
    assert not spec.parameters and not spec.changes
    options = {"variant": spec.variant, "seed": spec.seed, "method": spec.method}
    given = "".join(f" --{name} {value}" for name, value in options.items() if value is not None)
    return f"motm-twin {verb} {spec.scene}{given}"


def title(method: str) -> str:
    """Name of a method in tables and figures."""
    return METHODS[method].title if method in METHODS else method


def percent(estimate: Estimate, decimals: int = 0) -> str:
    """A share with its interval, as "43 % [41, 45]"."""
    if estimate.n == 0:
        return "-"
    value, low, high = (100.0 * each for each in (estimate.value, estimate.low, estimate.high))
    interval = f" [{low:.{decimals}f}, {high:.{decimals}f}]" if math.isfinite(low) and math.isfinite(high) else ""
    return f"{value:.{decimals}f} %{interval}"


PLAN, COMMAND = "plan", "command"  # stored with every trial, beside source and libraries
NOT_RECORDED = "not recorded"


@dataclass(frozen=True, kw_only=True)
class Origin:
    """Common origin of all trials; a field that differs between trials lists each value with its number of trials."""

    sources: tuple[str, ...]  # source hashes of the trials
    plans: tuple[str, ...]  # plans that ran the trials; "not recorded" for `motm-twin bench` and earlier versions
    plan: str
    command: str
    machine: str
    made_with: dict[str, str]

    @property
    def current(self) -> bool:
        """True when all trials were run by the current source."""
        return self.sources == (made_with()[SOURCE],)


def origin(records: Iterable[Record], command: str) -> Origin:
    """Origin of these trials; without trials: the current source, libraries and machine, with this command."""
    notes = [record.made_with for record in records] or [{**current_origin(), PLAN: "no trials", COMMAND: command}]
    names = [*dict.fromkeys(name for note in notes for name in note), PLAN, COMMAND, MACHINE, SOURCE]
    counts = {name: Counter(note.get(name, NOT_RECORDED) for note in notes) for name in names}
    stamps = {name: _counted(values) for name, values in counts.items()}
    apart = {name: stamps.pop(name) for name in (PLAN, COMMAND, MACHINE)}
    return Origin(sources=tuple(counts[SOURCE]), plans=tuple(counts[PLAN]), made_with=stamps, **apart)


def current_origin() -> dict[str, str]:
    """Source, libraries and machine that draw the report, under the names in `Origin`."""
    return {**made_with(), MACHINE: machine()}


def _counted(values: Counter[str]) -> str:
    if len(values) == 1:
        return next(iter(values))
    return "; ".join(f"{value} ({count} {'trial' if count == 1 else 'trials'})" for value, count in values.items())


Records = dict[str, list[Record]]  # by experiment
Keys = dict[str, dict[str, TrialSpec]]  # by experiment: trials by their names in the store


def stored(out: Path, without: Collection[str] = ()) -> Records:
    """The newest record of every spec from any source, except for the experiments ``without``."""
    found: Records = {}
    for folder in sorted(file.parent for file in out.glob(f"*/{TRIALS}")):
        if folder.name not in without:
            found[folder.name] = list(_newest(Trials(folder).read().values()).values())
    return found


def keys(experiments: Iterable[Experiment]) -> Keys:
    """The trials of these experiments with the current source, without duplicates.

    Raises ValueError for a trial that cannot be run.
    """
    source = made_with()[SOURCE]
    return {each.name: {job.key(source): job.spec for job in jobs_of(each.specs)} for each in experiments}


def of_plan(out: Path, planned: Keys) -> Records:
    """Records of these trials, each once and in order: from the current source, or else the newest one."""
    found: Records = {}
    for name, trials in planned.items():
        records = Trials(out / name).read()
        newest = _newest(records.values())
        these = (records.get(key) or newest.get(_text(spec)) for key, spec in trials.items())
        found[name] = [record for record in these if record is not None]
    return found


def write_completed(out: Path, planned: Keys) -> None:
    """Write `results.jsonl` with all stored results of these trials: a partial run has written only its own."""
    for name, trials in planned.items():
        records = Trials(out / name).read()
        Trials(out / name).write_results([records[key].result for key in trials if key in records])


def missing(out: Path, planned: Keys, *, retry_failed: bool = False) -> tuple[list[TrialSpec], int]:
    """The trials that still have to be run, and the total number of these trials."""
    done = {
        record.key
        for name in planned
        for record in Trials(out / name).read().values()
        if record.result["success"] or not retry_failed
    }
    every = {key: spec for trials in planned.values() for key, spec in trials.items()}
    return [spec for key, spec in every.items() if key not in done], len(every)


def _newest(records: Iterable[Record]) -> dict[bytes, Record]:
    """The newest record of every spec, by the encoded spec."""
    return {_text(record.spec): record for record in records}


def _text(spec: TrialSpec) -> bytes:
    return msgspec.json.encode(spec, order="deterministic")
