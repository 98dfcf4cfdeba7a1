"""Experiments by name: the paper's, each modification switched off alone, and sweeps of its parameters."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass

from motm_twin.bench import robustness
from motm_twin.bench.experiments import unseen
from motm_twin.bench.experiments.spec import Experiment, TrialSpec
from motm_twin.methods.error import MethodError
from motm_twin.methods.fast import FAST
from motm_twin.methods.modifications import ABLATIONS, MOTM
from motm_twin.methods.registry import METHODS, find_method
from motm_twin.model.names import hint

ALL = "all"
PUBLISHED = 10  # arrangements of Experiment 1 in the paper, "trial1" to "trial10"
MOST_TRIALS = 1_000_000
NAMES_OF_ABLATIONS = tuple(method.name for method in ABLATIONS)
NOT_COMPARED = (*NAMES_OF_ABLATIONS, "open_loop")  # it executes a plan blindly: the other side of robustness only

SWEEPS: dict[str, tuple[float, ...]] = {  # parameter of `control.tuning`: values besides the shipped one
    "next_weight": (0.0, 0.5, 2.0, 3.0),
    "bezier_offset": (0.1, 0.4, 0.5),
    "radius_min": (0.45, 0.5, 0.55, 0.65, 0.7),
    "radius_max": (0.7, 0.75, 0.85, 0.9, 0.95),
}
SWEPT_AMONG_BOXES = {"radius_max": ("exp1a",)}  # Experiment 1 needs no ring beyond 0.7 m

QUICK_ROBOT = {  # twice the speed and acceleration, and a gripper that closes in 0.2 s
    "robot.base.forward_speed": 1.0,  # [m/s]
    "robot.base.linear_acceleration": 1.0,  # [m/s^2]
    "robot.gripper.closing_time": 0.2,  # [s]
}

Specs = Iterable[TrialSpec]


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An experiment that can be asked for by name."""

    title: str
    specs: Callable[[Sequence[str], int | None], Specs]  # methods, number of trials (None: as published)
    methods: tuple[str, ...] = (MOTM.name,)  # when none are named


def methods_of(names: Iterable[str]) -> tuple[str, ...]:
    """Names of methods: "all" are the systems that are compared, "ablations" the modifications switched off alone.

    Raises MethodError for a name that is none.
    """
    found: list[str] = []
    for name in names:
        if name == ALL:
            found += [method for method in METHODS if method not in NOT_COMPARED]
        elif name == "ablations":
            found += [MOTM.name, *NAMES_OF_ABLATIONS]
        else:
            _known(name)
            found.append(name)
    return tuple(dict.fromkeys(found))


def experiment(name: str, methods: Sequence[str] = (), trials: int | None = None) -> Experiment:
    """The experiment of this name. Raises ValueError for a name or a number that is not possible."""
    if name not in EXPERIMENTS:
        raise ValueError(f"there is no experiment {name!r}; {hint(name, EXPERIMENTS)}")
    if trials is not None and not 1 <= trials <= MOST_TRIALS:
        raise ValueError(f"{trials} trials: allowed are 1 to {MOST_TRIALS:,}")
    entry = EXPERIMENTS[name]
    chosen = methods_of(methods) or entry.methods
    return Experiment(name, entry.title, tuple(entry.specs(chosen, trials)))


def arrangements(trials: int | None) -> list[tuple[str, int | None]]:
    """Variants and seeds of Experiments 1 and 1a: the ten published ones, or random ones with the seeds 0 to n - 1."""
    if trials is None:
        return [(f"trial{number}", None) for number in range(1, PUBLISHED + 1)]
    return [("random", seed) for seed in range(trials)]


def _known(name: str) -> None:
    try:
        find_method(name)
    except MethodError as error:
        raise MethodError(f"{error}; or 'all', or 'ablations'") from error


def _on(scene: str, changes: Mapping[str, float] | None = None) -> Callable[[Sequence[str], int | None], Specs]:
    """Every method on every arrangement: all of one arrangement, then the next, so that an early end compares."""
    return lambda methods, trials: (
        TrialSpec(scene, variant, seed, method, changes=dict(changes or {}))
        for variant, seed in arrangements(trials)
        for method in methods
    )


def _with_temis(variant: str) -> Callable[[Sequence[str], int | None], Specs]:
    """Experiment 2, and the same arrangements and seeds of Experiment 1 to compare with."""
    alone = {"one_temi": "trial1", "blind": "random"}.get(variant, variant)
    return lambda methods, trials: (
        TrialSpec(scene, which, seed, method)
        for seed in range(trials or PUBLISHED)
        for method in methods
        for scene, which in (("exp2", variant), ("exp1", alone))
    )


def _sweep(parameter: str) -> Callable[[Sequence[str], int | None], Specs]:
    """The shipped value, and the others."""
    settings = [{}, *({parameter: value} for value in SWEEPS[parameter])]
    return lambda methods, trials: (
        TrialSpec(scene, variant, seed, method, parameters)
        for scene in ("exp1", *SWEPT_AMONG_BOXES.get(parameter, ()))
        for variant, seed in arrangements(trials)
        for method in methods
        for parameters in settings
    )


EXPERIMENTS: dict[str, Entry] = {
    "exp1": Entry(title="Experiment 1: six cubes from a table into two bins", specs=_on("exp1")),
    "exp1a": Entry(title="Experiment 1a: two boxes that the map does not know", specs=_on("exp1a")),
    "exp2": Entry(title="Experiment 2: four Temis drive round the table", specs=_with_temis("random")),
    "blind": Entry(title="Experiment 2 with Temis that do not stop for the robot", specs=_with_temis("blind")),
    "one_temi": Entry(title="Experiment 2 with one Temi", specs=_with_temis("one_temi")),
    "ablations": Entry(
        title="Experiment 1 with each modification of the paper switched off alone",
        specs=_on("exp1"),
        methods=(MOTM.name, *NAMES_OF_ABLATIONS),
    ),
    "grasp_delay": Entry(
        title="Line, Turn and Obstructed turn with grasps that take longer or fail",
        specs=robustness.grasp_delay_specs,
        methods=robustness.METHODS,
    ),
    "robustness": Entry(
        title="One pick with one error at a time: reactive, and the same plan open-loop",
        specs=robustness.robustness_specs,
        methods=robustness.METHODS,
    ),
    "mismatch": Entry(
        title="Experiment 1 with a robot and a world that are otherwise than the robot is told",
        specs=robustness.mismatch_specs,
        methods=(FAST.name,),
    ),
    "quick_robot": Entry(
        title="Experiment 1 with a robot of 1 m/s, 1 m/s^2 and a quick gripper", specs=_on("exp1", QUICK_ROBOT)
    ),
    "further_scenes": Entry(title="Six further scenes, same code and parameters", specs=unseen.further_specs),
    "generated": Entry(title="Generated scenes of growing difficulty", specs=unseen.generated_specs),
    **{
        f"sweep_{parameter}": Entry(title=f"Experiment 1 with other values of {parameter}", specs=_sweep(parameter))
        for parameter in SWEEPS
    },
}
