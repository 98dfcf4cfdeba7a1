"""The experiments on errors and late grasps: their trials can be run, and begin with no error."""

import msgspec

from motm_twin.bench import robustness
from motm_twin.bench.experiments.catalogue import experiment
from motm_twin.bench.experiments.spec import job_of
from motm_twin.bench.published import FAILURE_RECOVERY, published


def test_every_level_of_every_error_is_one_that_a_scene_can_have():
    for name in ("robustness", "grasp_delay"):
        specs = experiment(name, ["motm"], trials=1).specs
        changes = [item for spec in specs for item in spec.changes.items()]
        assert len(changes) == len(specs)
        assert all(job_of(spec).scene.seed == 0 for spec in specs)


def test_methods_are_compared_on_the_same_seeds_and_levels():
    for name in ("robustness", "grasp_delay"):
        trials = {method: [] for method in robustness.METHODS}
        for spec in experiment(name, trials=2).specs:
            trials[spec.method].append((spec.scene, spec.variant, spec.seed, spec.changes))
        ours = trials.pop("motm")
        assert all(theirs == ours for theirs in trials.values())


def test_each_sweep_of_errors_begins_with_none():
    assert all(levels[0] == 0.0 for levels in (*robustness.ERRORS.values(), *robustness.GRASP_FAULTS.values()))
    quiet = job_of(experiment("robustness", ["motm"], trials=1).specs[0]).scene.noise
    kinds = ("_sd", "_latency", "_probability")
    assert not any(value for name, value in msgspec.structs.asdict(quiet).items() if name.endswith(kinds))


def test_the_tasks_of_failure_recovery_have_their_published_times():
    assert set(FAILURE_RECOVERY) == set(robustness.TASKS)
    assert [row.seconds for row in published("line", "line")] == [9.4, 11.6, 18.8, 21.9]
