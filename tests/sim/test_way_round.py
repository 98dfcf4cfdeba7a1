import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.model.geometry import rectangle
from motm_twin.sim.agent_kernels import free_cells
from motm_twin.sim.kernels import clearance

CELL, HALF = 0.1, 12
place = st.floats(-1.5, 1.5)
boxes = st.lists(st.tuples(place, place, st.floats(-3.0, 3.0), st.floats(0.05, 2.0), st.floats(0.05, 2.0)), max_size=4)
discs = st.lists(st.tuples(place, place, st.floats(0.0, 0.6)), max_size=4)


@given(start=st.tuples(place, place), boxes=boxes, discs=discs, radius=st.floats(0.1, 0.5))
@settings(deadline=None, max_examples=60)
def test_cells_well_clear_of_everything_are_free_and_others_only_where_they_lead_away(start, boxes, discs, radius):
    corners = np.vstack([np.zeros((0, 2)), *(rectangle((x, y, turn), size) for x, y, turn, *size in boxes)])
    first, round_ones = 4 * np.arange(len(boxes) + 1), np.array(discs).reshape(-1, 3)
    found = free_cells(np.array(start), radius, CELL, HALF, corners, first, round_ones)
    here = clearance(*start, corners, first, round_ones)
    for i, j in np.ndindex(found.shape):
        x, y = start[0] + (i - HALF) * CELL, start[1] + (j - HALF) * CELL
        gap, away = clearance(x, y, corners, first, round_ones), np.hypot(x - start[0], y - start[1])
        assert found[i, j] == (gap >= radius or (away < 0.4 and gap >= here + 0.3 * away))
