"""Evidence: beams are followed only as far as there is some."""

import numpy as np
import pytest

from motm_twin.perception.mapper import MapSettings, fading_of
from motm_twin.perception.occupancy import NEVER, clear_rays

FADING = fading_of(MapSettings())
ROWS, COLUMNS, RESOLUTION, BEAMS = 80, 100, 0.05, 721


@pytest.mark.parametrize("seed", range(8))
def test_a_beam_that_ends_at_the_last_evidence_clears_what_a_whole_one_does(seed):
    random = np.random.default_rng(seed)
    level = np.where(random.random((ROWS, COLUMNS)) < 0.01 * (1 + seed % 3), FADING.hit, 0).astype(np.int8)
    sensor = random.uniform((0.2, 0.2), (4.8, 3.8))
    angle = np.linspace(-2.4, 2.4, BEAMS) + random.uniform(-3.0, 3.0)
    ranges = random.uniform(0.1, 6.0, BEAMS)
    ends = sensor + ranges[:, None] * np.column_stack((np.cos(angle), np.sin(angle)))
    ends[::50] = np.nan
    struck = np.where(random.random(BEAMS) < 0.5, ranges, -1.0)
    left = []
    for occupied in (np.flatnonzero(level), np.arange(level.size)):
        cleared, marks = level.copy(), np.zeros((2, ROWS, COLUMNS), np.uint8)
        stamps = [np.full((ROWS, COLUMNS), NEVER, np.int32) for _ in range(3)]
        frame = np.array([0.0, 0.0, RESOLUTION])
        clear_rays(cleared, *marks, *stamps, occupied, sensor, ends, struck, 1000, frame, FADING)
        left.append(cleared)
    assert (left[0] == left[1]).all()
    assert (left[0] != level).any()
