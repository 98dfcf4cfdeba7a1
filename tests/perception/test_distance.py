"""Distance field and proximity cost."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt, uniform_filter

from motm_twin.perception.distance import FAR, proximity_cost, seen_distance, squared_cells


def transform(occupied: np.ndarray) -> np.ndarray:
    return squared_cells(np.argwhere(occupied).astype(np.int32), *occupied.shape)


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 40), st.integers(1, 40), st.floats(0.0, 1.0), st.integers(0, 2**31))
def test_squared_distance_equals_scipy_on_any_grid(rows, columns, share, seed):
    occupied = np.random.default_rng(seed).random((rows, columns)) < share
    if not occupied.any():
        assert (transform(occupied) == FAR).all()
        return
    expected = distance_transform_edt(~occupied) ** 2
    np.testing.assert_array_equal(transform(occupied), np.rint(expected).astype(int))


def test_distance_to_a_seen_cell_stays_within_the_stated_bounds_of_its_square():
    occupied = np.zeros((60, 60), bool)
    occupied[30, 30] = True
    distance = seen_distance(transform(occupied), 0.05)
    rows, columns = np.indices(occupied.shape)
    gap = np.maximum(np.abs(np.stack([rows, columns]) - 30) * 0.05 - 0.025, 0.0)
    error = distance - np.hypot(*gap)
    assert error.min() > -1e-6
    assert error.max() < 0.0104


def test_without_seen_cells_the_distance_is_infinite():
    assert np.isinf(seen_distance(transform(np.zeros((5, 7), bool)), 0.05)).all()


@pytest.mark.parametrize("blur", [0, 1, 2])
def test_proximity_is_the_inflated_cost_box_blurred(blur):
    occupied = np.random.default_rng(3).random((50, 40)) < 0.01
    distance = seen_distance(transform(occupied), 0.05)
    inflated = np.clip(1.0 - distance / 0.2, 0.0, 1.0)
    expected = uniform_filter(inflated, 2 * blur + 1, mode="nearest")
    np.testing.assert_allclose(proximity_cost(distance, 0.2, blur), expected, atol=1e-5)


def test_proximity_of_an_empty_map_is_zero():
    assert (proximity_cost(np.full((6, 8), np.inf, np.float32), 0.12, 1) == 0.0).all()
