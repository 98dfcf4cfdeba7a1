"""Experiments by name: the paper's, ablations and sweeps, further scenes, and errors of all kinds.

`grasp_delay`: tasks of Failure Recovery for On-The-Move Mobile Manipulation (arXiv 2305.08351), with each grasp late or
failing. All methods know the cube's place in advance, because a planner needs it; all other errors are present.
Published times are in `measures.references`.

`robustness`: one error at a time, in a world without others. Each trial is one pick where the path turns, so
that success means a successful grasp.

`mismatch`: deviations of robot and world from the robot's model, on top of the usual noise, in Experiment 1.
"""

from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from motm_twin.generate.scenes import is_generated, name_of, parse_name
from motm_twin.methods.registry import ABLATIONS, FAST, METHODS, MOTM, find_method
from motm_twin.model.names import MethodError, hint
from motm_twin.model.profile import DEG
from motm_twin.model.scene_file import listing, load_document, strangers_names
from motm_twin.studies.spec import Experiment, TrialSpec

REACTIVE, SEQUENTIAL, PLANNED = "motm", "sequential", "open_loop"
COMPARED_METHODS = (REACTIVE, SEQUENTIAL, PLANNED)
SEEDS = 5  # seeds of each level, by default

TASKS = ("line", "turn", "obstructed_turn")
DELAY, MISSES, SLIPS = "faults.grasp_delay", "faults.grasp_misses", "faults.grasp_slips"
GRASP_FAULTS: Mapping[str, tuple[float, ...]] = {
    DELAY: (0.0, 1.0, 2.0, 5.0, 10.0),  # [s]
    MISSES: (0, 1, 2, 3),
    SLIPS: (0, 1, 2, 3),
}

ERRORS: Mapping[str, tuple[float, ...]] = {  # field of the scene: levels, the first without error
    "noise.localisation_position_sd": (0.0, 0.01, 0.02, 0.05, 0.1),  # [m]
    "noise.localisation_heading_sd": tuple(degrees * DEG for degrees in (0.0, 0.5, 1.0, 2.0, 5.0)),  # [rad]
    "noise.slot_error_until_seen": (0.0, 0.01, 0.03, 0.06, 0.1),  # [m]
    "noise.camera_position_sd_at_1m": (0.0, 0.02, 0.05, 0.1, 0.2),  # [m]
    "noise.camera_position_sd_at_01m": (0.0, 0.002, 0.005, 0.01, 0.02),  # [m]
    "noise.base_speed_scale_sd": (0.0, 0.02, 0.05, 0.1, 0.2),  # share
    "noise.arm_rate_sd": (0.0, 0.005, 0.01, 0.02, 0.05),  # [rad/s]
    "faults.cube_moved_by": (0.0, 0.02, 0.05, 0.1, 0.15),  # [m] shift when the base is within 1 m
}
SHAKEN = "joint rates 2 deg/s"
MISMATCHES: Mapping[str, Mapping[str, float]] = {  # name of the row: fields of the scene
    "none": {},
    "delay 100 ms": {"mismatch.command_delay": 0.1},
    "delay 200 ms": {"mismatch.command_delay": 0.2},
    "base lag 0.3 s": {"mismatch.base_lag": 0.2},  # plus 0.1 s in its profile
    "base scale 8 %": {"mismatch.base_scale": 0.08},
    "camera latency 200 ms": {"noise.camera_latency": 0.2},
    "hand-eye 10 mm": {"mismatch.hand_eye": 0.01},
    "map off by 4 cm": {"mismatch.map_offset": 0.04},
    "table 1 cm higher": {"mismatch.table_height": 0.01},
    SHAKEN: {"noise.arm_rate_sd": 2.0 * DEG},
    "moderate mixture": {
        "mismatch.command_delay": 0.05, "mismatch.base_lag": 0.1, "mismatch.base_scale": 0.04,
        "noise.camera_latency": 0.1, "mismatch.hand_eye": 0.005, "mismatch.map_offset": 0.02,
        "mismatch.table_height": 0.005, "noise.arm_rate_sd": 0.25 * DEG,
    },
}  # fmt: skip
MISMATCH_SCENE, MISMATCH_VARIANT, MISMATCH_SEEDS = "exp1", "random", 10
ROBUSTNESS_SCENE, QUIET, KNOWN_CUBE = "turn", "quiet", "known_cube"


def grasp_delay_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every level of every grasp fault, on all three tasks; ``trials``: seeds of each."""
    for scene in TASKS:
        yield from _levels(scene, KNOWN_CUBE, GRASP_FAULTS, methods, trials)


def robustness_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every level of every error alone; ``trials``: seeds of each."""
    yield from _levels(ROBUSTNESS_SCENE, QUIET, ERRORS, methods, trials)


def mismatch_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every mismatch alone, and the mixture; ``trials``: seeds of each."""
    for seed in range(trials or MISMATCH_SEEDS):
        for method in methods:
            for changes in MISMATCHES.values():
                yield TrialSpec(MISMATCH_SCENE, MISMATCH_VARIANT, seed, method, changes=dict(changes))


def _levels(
    scene: str, variant: str, levels: Mapping[str, tuple[float, ...]], methods: Sequence[str], trials: int | None
) -> Iterable[TrialSpec]:
    """Trials of all levels, seed by seed: an early end leaves all levels of some seeds."""
    for seed in range(trials or SEEDS):
        for method in methods:
            for name, values in levels.items():
                for value in values:
                    yield TrialSpec(scene, variant, seed, method, changes={name: value})


FURTHER = ("l_bench", "island", "facing_tables", "doorway", "far_targets", "shelf_run")
GENERATED = 21  # scenes, by default
STEPS = 20  # difficulties go from 0 to 1 in this many steps
BANDS = (0.0, 0.25, 0.5, 0.75)  # lower limits of the difficulty in the rows of generated scenes


def further_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every variant of the six scenes; ``trials``: seeds of each, from 0."""
    for seed in range(trials) if trials else (None,):
        for scene in FURTHER:
            for variant in listing(load_document(scene)).variants:
                yield from (TrialSpec(scene, variant, seed, method) for method in methods)


def strangers_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """The scenes by strangers and their variants with the seeds of their files; ``trials``: further seeds, from 0."""
    names = strangers_names()
    kinds = [(scene, variant) for scene in names for variant in load_document(scene).variants() or (None,)]
    for seed in (None, *range(trials or 0)):
        for scene, variant in kinds:
            yield from (TrialSpec(scene, variant, seed, method) for method in methods)


def generated_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """The generated scenes of the seeds 0 to n - 1, with the difficulties of `difficulty_of`."""
    for seed in range(trials or GENERATED):
        for method in methods:
            yield TrialSpec(name_of(seed, difficulty_of(seed)), None, seed, method)


def difficulty_of(seed: int) -> float:
    """Difficulty of the scene of a seed in the experiment: 0, 0.05, ... 1, then again from 0."""
    return (seed % (STEPS + 1)) / STEPS


def row_of(scene: str) -> str:
    """Row of a scene in a table: its name, or the band of difficulties of a generated one."""
    if not is_generated(scene):
        return scene
    _, difficulty = parse_name(scene)
    band = max(index for index, low in enumerate(BANDS) if difficulty >= low)
    upper = (*BANDS, 1.0)[band + 1]
    return f"generated, difficulty {BANDS[band]:g} to {upper:g}"


def reasons(results: Iterable[dict[str, Any]]) -> list[tuple[str, int, str]]:
    """Reasons of trials without success, the number of trials of each, and its first scene."""
    counted: Counter[str] = Counter()
    first: dict[str, str] = {}
    for result in results:
        if not result["success"]:
            reason = result["reason"] or "no reason was given"
            counted[reason] += 1
            first.setdefault(reason, f"{result['scene']} {result['variant']}".strip() + f" seed {result['seed']}")
    return [(reason, count, first[reason]) for reason, count in counted.most_common()]


ALL = "all"
PUBLISHED = 10  # arrangements of Experiment 1 in the paper, "trial1" to "trial10"
MOST_TRIALS = 1_000_000
NAMES_OF_ABLATIONS = tuple(method.name for method in ABLATIONS)
NOT_COMPARED = (*NAMES_OF_ABLATIONS, "open_loop", "orca")  # for contrast: a plan executed blindly; a base alone

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

Specs = Callable[[Sequence[str], int | None], Iterable[TrialSpec]]  # methods, number of trials (None: as published)


@dataclass(frozen=True, kw_only=True)
class Entry:
    """An experiment with a name."""

    title: str
    specs: Specs
    methods: tuple[str, ...] = (MOTM.name,)  # default methods


def methods_of(names: Iterable[str]) -> tuple[str, ...]:
    """Names of methods: "all" stands for the compared systems, "ablations" for single modifications switched off.

    Raises MethodError for an unknown name.
    """
    found: list[str] = []
    for name in names:
        if name == ALL:
            found += [method for method in METHODS if method not in NOT_COMPARED]
        elif name == "ablations":
            found += [MOTM.name, *NAMES_OF_ABLATIONS]
        else:
            try:
                find_method(name)
            except MethodError as error:
                raise MethodError(f"{error}; or 'all', or 'ablations'") from error
            found.append(name)
    return tuple(dict.fromkeys(found))


def experiment(name: str, methods: Sequence[str] = (), trials: int | None = None) -> Experiment:
    """The experiment of this name. Raises ValueError for an unknown name or an impossible number."""
    if name not in EXPERIMENTS:
        raise ValueError(f"there is no experiment {name!r}; {hint(name, EXPERIMENTS)}")
    if trials is not None and not 1 <= trials <= MOST_TRIALS:
        raise ValueError(f"{trials} trials: give 1 to {MOST_TRIALS:,}")
    entry = EXPERIMENTS[name]
    chosen = methods_of(methods) or entry.methods
    return Experiment(name, entry.title, tuple(entry.specs(chosen, trials)))


def arrangements(trials: int | None) -> list[tuple[str, int | None]]:
    """Variants and seeds of Experiments 1 and 1a: the ten published ones, or random ones with the seeds 0 to n - 1."""
    if trials is None:
        return [(f"trial{number}", None) for number in range(1, PUBLISHED + 1)]
    return [("random", seed) for seed in range(trials)]


def _on(scene: str, changes: Mapping[str, float] | None = None) -> Specs:
    """Every method on every arrangement, arrangement by arrangement, so that an early end still allows a comparison."""
    return lambda methods, trials: (
        TrialSpec(scene, variant, seed, method, changes=dict(changes or {}))
        for variant, seed in arrangements(trials)
        for method in methods
    )


def _with_temis(variant: str) -> Specs:
    """Experiment 2, and for comparison the same arrangements and seeds of Experiment 1."""
    alone = {"one_temi": "trial1", "blind": "random"}.get(variant, variant)
    return lambda methods, trials: (
        TrialSpec(scene, which, seed, method)
        for seed in range(trials or PUBLISHED)
        for method in methods
        for scene, which in (("exp2", variant), ("exp1", alone))
    )


def _sweep(parameter: str) -> Specs:
    """Trials with the shipped value of a parameter, and with others."""
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
    "exp1a": Entry(title="Experiment 1a: two unmapped boxes", specs=_on("exp1a")),
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
        specs=grasp_delay_specs,
        methods=COMPARED_METHODS,
    ),
    "robustness": Entry(
        title="One pick with one error at a time: reactive, and the same plan open-loop",
        specs=robustness_specs,
        methods=COMPARED_METHODS,
    ),
    "mismatch": Entry(
        title="Experiment 1 with a robot and a world that are otherwise than the robot is told",
        specs=mismatch_specs,
        methods=(FAST.name,),
    ),
    "quick_robot": Entry(
        title="Experiment 1 with a robot of 1 m/s, 1 m/s^2 and a quick gripper", specs=_on("exp1", QUICK_ROBOT)
    ),
    "further_scenes": Entry(title="Six further scenes, same code and parameters", specs=further_specs),
    "strangers": Entry(title="Tight scenes by people who did not know the controller", specs=strangers_specs),
    "generated": Entry(title="Generated scenes of growing difficulty", specs=generated_specs),
    **{
        f"sweep_{parameter}": Entry(title=f"Experiment 1 with other values of {parameter}", specs=_sweep(parameter))
        for parameter in SWEEPS
    },
}
