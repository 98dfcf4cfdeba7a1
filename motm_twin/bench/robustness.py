"""Grasp delay and robustness: which errors the reactive loop bears, and which the same plan does, executed open-loop.

`grasp_delay`: the tasks of Failure Recovery for On-The-Move Mobile Manipulation (arXiv 2305.08351), each grasp late or
failing. All methods know the cube's place beforehand, since a plan has to; every other error is there. The times that
are published are in `bench.published`.

`robustness`: one error at a time, added to a world that has none. The trials are of one pick where the way turns, so
that success is that of a grasp.

`mismatch`: what robot and world do otherwise than the robot is told, on top of the usual noise, in Experiment 1.
"""

import math
from collections.abc import Iterable, Mapping, Sequence

from motm_twin.bench.experiments.spec import TrialSpec

REACTIVE, SEQUENTIAL, PLANNED = "motm", "sequential", "open_loop"
METHODS = (REACTIVE, SEQUENTIAL, PLANNED)
SEEDS = 5  # of each level, unless a number of trials is asked for

TASKS = ("line", "turn", "obstructed_turn")
DELAY, MISSES, SLIPS = "faults.grasp_delay", "faults.grasp_misses", "faults.grasp_slips"
GRASP_FAULTS: Mapping[str, tuple[float, ...]] = {
    DELAY: (0.0, 1.0, 2.0, 5.0, 10.0),  # [s]
    MISSES: (0, 1, 2, 3),
    SLIPS: (0, 1, 2, 3),
}

_DEG = math.pi / 180.0
ERRORS: Mapping[str, tuple[float, ...]] = {  # field of the scene: levels, the first is none
    "noise.localisation_position_sd": (0.0, 0.01, 0.02, 0.05, 0.1),  # [m]
    "noise.localisation_heading_sd": tuple(degrees * _DEG for degrees in (0.0, 0.5, 1.0, 2.0, 5.0)),  # [rad]
    "noise.slot_error_until_seen": (0.0, 0.01, 0.03, 0.06, 0.1),  # [m]
    "noise.camera_position_sd_at_1m": (0.0, 0.02, 0.05, 0.1, 0.2),  # [m]
    "noise.camera_position_sd_at_01m": (0.0, 0.002, 0.005, 0.01, 0.02),  # [m]
    "noise.base_speed_scale_sd": (0.0, 0.02, 0.05, 0.1, 0.2),  # share
    "noise.arm_rate_sd": (0.0, 0.005, 0.01, 0.02, 0.05),  # [rad/s]
    "faults.cube_moved_by": (0.0, 0.02, 0.05, 0.1, 0.15),  # [m] when the base is within 1 m
}
SHAKEN = "joint rates 2 deg/s"
MISMATCHES: Mapping[str, Mapping[str, float]] = {  # name of the row: fields of the scene
    "none": {},
    "delay 100 ms": {"mismatch.command_delay": 0.1},
    "delay 200 ms": {"mismatch.command_delay": 0.2},
    "base lag 0.3 s": {"mismatch.base_lag": 0.2},  # 0.1 s are in its profile
    "base scale 8 %": {"mismatch.base_scale": 0.08},
    "camera latency 200 ms": {"noise.camera_latency": 0.2},
    "hand-eye 10 mm": {"mismatch.hand_eye": 0.01},
    "map off by 4 cm": {"mismatch.map_offset": 0.04},
    "table 1 cm higher": {"mismatch.table_height": 0.01},
    SHAKEN: {"noise.arm_rate_sd": 2.0 * _DEG},
    "moderate mixture": {
        "mismatch.command_delay": 0.05,
        "mismatch.base_lag": 0.1,
        "mismatch.base_scale": 0.04,
        "noise.camera_latency": 0.1,
        "mismatch.hand_eye": 0.005,
        "mismatch.map_offset": 0.02,
        "mismatch.table_height": 0.005,
        "noise.arm_rate_sd": 0.25 * _DEG,
    },
}
MISMATCH_SCENE, MISMATCH_VARIANT, MISMATCH_SEEDS = "exp1", "random", 10
ROBUSTNESS_SCENE, QUIET, KNOWN_CUBE = "turn", "quiet", "known_cube"


def grasp_delay_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every level of every grasp fault, on all three tasks; ``trials``: seeds of each."""
    for scene in TASKS:
        yield from _sweep(scene, KNOWN_CUBE, GRASP_FAULTS, methods, trials)


def robustness_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every level of every error alone; ``trials``: seeds of each."""
    yield from _sweep(ROBUSTNESS_SCENE, QUIET, ERRORS, methods, trials)


def mismatch_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every mismatch alone, and the mixture; ``trials``: seeds of each."""
    for seed in range(trials or MISMATCH_SEEDS):
        for method in methods:
            for changes in MISMATCHES.values():
                yield TrialSpec(MISMATCH_SCENE, MISMATCH_VARIANT, seed, method, changes=dict(changes))


def _sweep(
    scene: str, variant: str, levels: Mapping[str, tuple[float, ...]], methods: Sequence[str], trials: int | None
) -> Iterable[TrialSpec]:
    """Seeds last: an early end has all levels of some seeds."""
    for seed in range(trials or SEEDS):
        for method in methods:
            for name, values in levels.items():
                for value in values:
                    yield TrialSpec(scene, variant, seed, method, changes={name: value})
