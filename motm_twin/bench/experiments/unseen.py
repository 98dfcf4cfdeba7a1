"""Experiments on other scenes than the paper's, with the same code and parameters: further ones, and generated ones."""

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

from motm_twin.bench.experiments.spec import TrialSpec
from motm_twin.model.scene_file import listing
from motm_twin.model.scene_generate import is_generated, name_of, parse_name
from motm_twin.model.scene_load import load_document

FURTHER = ("l_bench", "island", "facing_tables", "doorway", "far_targets", "shelf_run")
GENERATED = 21  # scenes, unless a number is asked for
STEPS = 20  # difficulties from 0 to 1 in steps of 1/20, one after the other
BANDS = (0.0, 0.25, 0.5, 0.75)  # lower ends of the rows in which generated scenes are counted together


def further_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """Every variant of the six scenes; ``trials``: seeds of each, from 0."""
    for seed in range(trials) if trials else (None,):
        for scene in FURTHER:
            for variant in listing(load_document(scene)).variants:
                yield from (TrialSpec(scene, variant, seed, method) for method in methods)


def generated_specs(methods: Sequence[str], trials: int | None) -> Iterable[TrialSpec]:
    """The generated scenes of the seeds 0 to n - 1, each as hard as `difficulty_of` says."""
    for seed in range(trials or GENERATED):
        for method in methods:
            yield TrialSpec(name_of(seed, difficulty_of(seed)), None, seed, method)


def difficulty_of(seed: int) -> float:
    """How hard the scene of a seed is in the experiment: 0, 0.05, ... 1, and again."""
    return (seed % (STEPS + 1)) / STEPS


def row_of(scene: str) -> str:
    """What a scene is counted under in a table: itself, or the band of difficulties that a generated one is in."""
    if not is_generated(scene):
        return scene
    _, difficulty = parse_name(scene)
    band = max(index for index, low in enumerate(BANDS) if difficulty >= low)
    upper = (*BANDS, 1.0)[band + 1]
    return f"generated, difficulty {BANDS[band]:g} to {upper:g}"


def reasons(results: Iterable[dict[str, Any]]) -> list[tuple[str, int, str]]:
    """Why trials were without success: reason, how often, and the first scene that it happened in."""
    counted: Counter[str] = Counter()
    first: dict[str, str] = {}
    for result in results:
        if not result["success"]:
            reason = result["reason"] or "no reason was given"
            counted[reason] += 1
            first.setdefault(reason, f"{result['scene']} {result['variant']}".strip() + f" seed {result['seed']}")
    return [(reason, count, first[reason]) for reason, count in counted.most_common()]
