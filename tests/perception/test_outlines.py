"""Outlines of seen cells: they hold every cell, and close no way that the cells leave."""

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.model.profile import Footprint, RobotProfile
from motm_twin.perception.clusters import FLAT, NARROWED, growth_of, seen_outlines, touching

RESOLUTION = 0.05
ORIGIN = np.zeros(2)
FRANKIE, JACKAL = RobotProfile().footprint, Footprint(length=0.508, width=0.43)


def cells_at(*points: tuple[float, float], radius: float = 0.075) -> np.ndarray:
    """Cells of discs round points [m], sorted by row and column."""
    rows, columns = np.mgrid[0:120, 0:120]
    x, y = RESOLUTION * (columns + 0.5), RESOLUTION * (rows + 0.5)
    taken = np.zeros(x.shape, bool)
    for px, py in points:
        taken |= np.hypot(x - px, y - py) <= radius
    return np.argwhere(taken).astype(np.int32)


def squares(cells: np.ndarray) -> shapely.Geometry:
    low = RESOLUTION * cells[:, ::-1]
    return shapely.union_all(shapely.box(*low.T, *(low + RESOLUTION).T))


def area_of(outlines: list[np.ndarray]) -> shapely.Geometry:
    return shapely.union_all([shapely.Polygon(outline) for outline in outlines])


def test_the_growth_of_outlines_is_that_of_planning():
    assert growth_of(FRANKIE) == 0.33
    assert growth_of(JACKAL) == pytest.approx(0.295)


def test_a_bay_of_posts_that_a_base_gets_into_stays_open():
    ring = [(3.0 + 1.0 * np.cos(a), 3.0 + 1.0 * np.sin(a)) for a in np.linspace(0.6, 2 * np.pi - 0.6, 22)]
    cells, g = cells_at(*ring), growth_of(JACKAL)
    outlines = seen_outlines(cells, RESOLUTION, ORIGIN, g)
    way = shapely.LineString([(3.0, 3.0), (5.0, 3.0)])
    assert squares(cells).distance(way) > 0.38
    assert area_of(outlines).distance(way) > g
    assert shapely.convex_hull(squares(cells)).contains(shapely.Point(3.0, 3.0))


def test_a_face_with_gaps_is_one_outline():
    cells = np.array([(20, column) for column in range(20, 60) if column % 5], np.int32)
    assert len(seen_outlines(cells, RESOLUTION, ORIGIN, growth_of(FRANKIE))) == 1


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    points=st.lists(st.tuples(st.floats(0.5, 5.5), st.floats(0.5, 5.5)), min_size=1, max_size=25),
    width=st.floats(0.1, 1.0),
)
def test_no_way_is_closed_and_no_cell_left_out(points, width):
    cells, g = cells_at(*points), growth_of(Footprint(width=width))
    if not len(cells):
        return
    outlines = seen_outlines(cells, RESOLUTION, ORIGIN, g)
    area, taken = area_of(outlines), squares(cells)
    assert taken.difference(area.buffer(2.0 * FLAT)).area < 1e-9
    lost = area.buffer(g, quad_segs=32).difference(taken.buffer(g + NARROWED + 0.025, quad_segs=32))
    assert lost.area < 1e-4


def test_cells_belong_to_the_anchors_that_they_touch_through_each_other() -> None:
    cells = np.array([[2, 2], [3, 3], [3, 4], [3, 6], [8, 8], [2, 3]], np.int32)
    anchors = np.array([True, False, False, False, False, False])
    others = np.array([False, True, True, True, True, False])
    near, far = (touching(cells, anchors, others, reach) for reach in (1, 2))
    assert near.tolist() == [True, True, True, False, False, False]
    assert far.tolist() == [True, True, True, True, False, False]
    assert not touching(cells, np.zeros(6, bool), others, 2).any()
