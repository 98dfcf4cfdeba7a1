"""Copying, restoring and hashing of state."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from motm_twin.model.state import Stateful, state_hash


@dataclass
class WalkState:
    position: float = 0.0
    visited: list[float] = field(default_factory=list)
    rng: np.random.Generator = field(default_factory=lambda: np.random.default_rng(3))


class Walk(Stateful[WalkState]):
    def __init__(self):
        self._state = WalkState()

    def step(self):
        self._state.position += self._state.rng.normal()
        self._state.visited.append(self._state.position)


def test_a_restored_walk_continues_as_the_original_did():
    walk = Walk()
    walk.step()
    saved = walk.snapshot()
    for _ in range(10):
        walk.step()
    ended = state_hash(walk.snapshot())
    walk.restore(saved)
    for _ in range(10):
        walk.step()
    assert state_hash(walk.snapshot()) == ended


def test_a_snapshot_is_not_changed_by_going_on():
    walk = Walk()
    saved = walk.snapshot()
    before = state_hash(saved)
    walk.step()
    assert state_hash(saved) == before


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (0.0, -0.0),
        (1, 1.0),
        (True, 1),
        ("1", 1),
        ([1, 2], [2, 1]),
        ({"a": 1}, {"a": 2}),
        (np.zeros(2), np.zeros(3)),
        (np.zeros((1, 2)), np.zeros((2, 1))),
        (np.random.default_rng(1), np.random.default_rng(2)),
        (None, 0),
    ],
)
def test_different_states_have_different_hashes(one, other):
    assert state_hash(one) != state_hash(other)


def test_the_order_of_a_dictionary_does_not_matter():
    assert state_hash({"a": 1, "b": 2}) == state_hash({"b": 2, "a": 1})


def test_a_type_that_is_not_plain_state_is_refused():
    with pytest.raises(TypeError, match="not plain state"):
        state_hash(object())
