"""What is measured about more processes."""

from pathlib import Path

import pytest

from motm_twin.studies.efficiency import counts, trials_per_hour
from motm_twin.studies.spec import TrialSpec

SCENE = str(Path(__file__).parent / "half_a_metre.yaml")


def test_processes_are_doubled_up_to_all_of_them():
    assert [list(counts(workers)) for workers in (1, 2, 3, 4, 6)] == [[1], [1, 2], [1, 2, 3], [1, 2, 4], [1, 2, 4, 6]]


def test_a_rate_is_that_of_trials_that_succeed():
    assert trials_per_hour([TrialSpec(SCENE)], 1) > 0.0
    with pytest.raises(RuntimeError, match="time limit"):
        trials_per_hour([TrialSpec(SCENE, changes={"time_limit": 0.2})], 1)
