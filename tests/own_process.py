"""A fixture: trials of a sweep run in the test's own process, which has imported and compiled everything already.

Processes, their order and their deaths are shown by studies/test_run.py and test_ray.py.
"""

import pickle

import pytest


@pytest.fixture
def in_this_process(monkeypatch):
    run_in_this_process(monkeypatch)


def run_in_this_process(patch):
    """Calls of a pool run one after the other in this process, with copies of their data as a process would get."""
    patch.setattr("motm_twin.studies.pool._round", _calls)


def _calls(call, items, chosen, begun, pool):
    for index in chosen:
        begun.append(index)
        yield index, _copy(_copy(call)(_copy(items[index])))


def _copy(value):
    return pickle.loads(pickle.dumps(value))  # noqa: S301 - of this test
