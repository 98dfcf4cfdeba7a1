"""Prediction, switched on and off while methods drive among the Temis."""

import pytest

from motm_twin.methods.registry import find_method
from motm_twin.model.edits import SetParameter
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.twin import Twin

BESIDE_TEMIS = 3  # periods


def twin_of(name: str) -> Twin:
    """Among four Temis."""
    return Twin(load_scene("exp2", "random", 1), method=find_method(name))


@pytest.mark.parametrize("name", ["fast", "sequential"])
def test_it_can_be_changed_during_a_run_and_a_copy_goes_on_bit_for_bit(name: str):
    twin, plain = twin_of(name), twin_of(name)
    for _ in range(40):
        assert state_hash(twin.advance().plan) == state_hash(plain.advance().plan)
    twin.post(SetParameter(name="prediction", value=1.0))
    twin.post(SetParameter(name="moving_weight", value=1.0))
    assert any(state_hash(twin.advance().plan) != state_hash(plain.advance().plan) for _ in range(60))
    copy = twin_of(name)
    copy.restore(twin.snapshot())
    for _ in range(BESIDE_TEMIS):
        assert state_hash(copy.advance().plan) == state_hash(twin.advance().plan)
    for each in (twin, copy):
        each.post(SetParameter(name="prediction", value=0.0))
        each.post(SetParameter(name="moving_weight", value=None))
    for _ in range(BESIDE_TEMIS):
        assert state_hash(copy.advance().plan) == state_hash(twin.advance().plan)
    assert twin.loop.planner.ahead is None
