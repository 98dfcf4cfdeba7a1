"""World to cell and back."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.perception.grid import grid_over

coordinate = st.floats(-20.0, 20.0)


@given(coordinate, coordinate, st.floats(0.1, 15.0), st.floats(0.1, 15.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_every_point_of_the_bounds_lies_in_the_cell_that_it_is_given(x, y, width, height, part_x, part_y):
    grid = grid_over((x, y, x + width, y + height), 0.05)
    point = np.array([x + part_x * width * (1 - 1e-9), y + part_y * height * (1 - 1e-9)])
    cell = grid.cell_of(point)
    assert grid.contains(cell)
    assert np.abs(grid.centre_of(cell) - point).max() <= 0.025 + 1e-9


@given(st.integers(0, 99), st.integers(0, 99))
def test_the_centre_of_a_cell_lies_in_that_cell(row, column):
    grid = grid_over((-2.0, -3.0, 3.0, 2.0), 0.05)
    np.testing.assert_array_equal(grid.cell_of(grid.centre_of(np.array([row, column]))), [row, column])


def test_rows_go_along_y_and_columns_along_x():
    grid = grid_over((0.0, 0.0, 4.0, 2.0), 0.5)
    assert grid.shape == (4, 8)
    np.testing.assert_array_equal(grid.cell_of(np.array([3.9, 0.1])), [0, 7])


@pytest.mark.parametrize("bounds", [(0, 0, 0, 1), (1, 0, 0, 1), (0, 0, float("nan"), 1)])
def test_empty_bounds_are_refused(bounds):
    with pytest.raises(ValueError, match="bounds"):
        grid_over(bounds, 0.05)
