"""Cells with times, against dictionaries; and which cells hang together."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.perception.cell_times import CellTimes, _numbers
from motm_twin.perception.clusters import touching
from motm_twin.perception.grid import grid_over

CELLS = st.lists(st.tuples(st.integers(-5, 5), st.floats(0.0, 9.0)), max_size=12)


@settings(deadline=None)  # the first compiles
@given(first=CELLS, second=CELLS, now=st.floats(0.0, 9.0))
def test_each_cell_keeps_its_latest_time(first: list[tuple[int, float]], second: list[tuple[int, float]], now: float):
    wanted: dict[int, float] = {}
    for cell, time in first + second:
        wanted[cell] = max(time, wanted.get(cell, 0.0))
    parts = [(np.array([c for c, _ in part], np.int64), np.array([t for _, t in part])) for part in (first, second)]
    found = CellTimes()
    for cells, times in parts:
        found = found.also(cells, times)
    assert dict(zip(found.cells.tolist(), found.times.tolist(), strict=True)) == wanted
    asked = np.arange(-6, 7)
    assert found.of(asked, -1.0).tolist() == [wanted.get(cell, -1.0) for cell in asked.tolist()]
    assert found.has(asked).tolist() == [cell in wanted for cell in asked.tolist()]
    assert set(found.after(now).cells.tolist()) == {cell for cell, time in wanted.items() if time > now}


@settings(deadline=None)  # the first compiles
@given(low=st.tuples(st.integers(-400, 400), st.integers(-400, 400)))
def test_every_cell_has_its_own_number_wherever_the_map_begins(low: tuple[int, int]) -> None:
    """Two rows had one number where the map began at half a cell: each centre was at an edge, to either side of it."""
    x, y = 0.025 * np.array(low)
    centres = grid_over((x, y, x + 2.0, y + 2.0), 0.05).centres().reshape(-1, 2)
    assert (np.diff(_numbers(centres, 0.05)) > 0).all()


def test_cells_belong_to_the_anchors_that_they_touch_through_each_other() -> None:
    cells = np.array([[2, 2], [3, 3], [3, 4], [3, 6], [8, 8], [2, 3]], np.int32)
    anchors = np.array([True, False, False, False, False, False])
    others = np.array([False, True, True, True, True, False])
    near, far = (touching(cells, anchors, others, reach) for reach in (1, 2))
    assert near.tolist() == [True, True, True, False, False, False]
    assert far.tolist() == [True, True, True, True, False, False]
    assert not touching(cells, np.zeros(6, bool), others, 2).any()
