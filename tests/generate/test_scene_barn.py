"""Worlds like those of BARN: the same text from the same seed, always with a way, in the lane of the challenge."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.bus.library import FileLibrary
from motm_twin.generate.barn import COLUMNS, ROWS, barn, field, has_way
from motm_twin.model.scene import Cylinder
from motm_twin.model.scene_file import SceneError, load_scene


@settings(max_examples=10, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**63 - 1))
def test_every_seed_is_a_world_with_a_way_in_the_lane(seed):
    scene = load_scene(f"barn:{seed}")
    assert (scene.name, scene.seed, scene.start[:2]) == (f"barn:{seed}", seed, (-2.25, 3.0))
    assert not any(solid.mapped for solid in scene.solids)
    middles = np.array([solid.shape.centre for solid in scene.solids if isinstance(solid.shape, Cylinder)])
    assert ((middles > (-4.3, 5.1)) & (middles < (-0.2, 9.6))).all()
    cells = np.zeros((ROWS, COLUMNS), bool)
    columns, rows = np.rint((middles - (-4.425, 5.175)) / 0.15).astype(int).T
    cells[rows, columns] = cells[:, 0] = cells[:, -1] = True
    assert has_way(cells)
    assert barn(seed) == barn(seed)


def test_a_seed_says_how_much_is_filled_and_how_often_it_is_smoothed():
    rng = [np.random.default_rng(3) for _ in range(3)]
    rough, smooth = field(rng[0], 0.3, 0), field(rng[1], 0.3, 4)
    assert 0.25 < rough[:, 1:-1].mean() < 0.35
    alone = sum(
        smooth[i, k] and smooth[i - 1 : i + 2, k - 1 : k + 2].sum() <= 1 for i in range(1, 29) for k in range(1, 29)
    )
    assert alone == 0
    assert field(rng[2], 0.15, 2)[:, 1:-1].mean() < 0.15
    assert "25% filled at first, smoothed 3 times" in barn(6)


def test_a_wall_across_the_lane_leaves_no_way():
    cells = np.zeros((ROWS, COLUMNS), bool)
    cells[:, [0, -1]] = True
    assert has_way(cells)
    cells[12, :25] = True  # 4 cells of room
    assert not has_way(cells)
    cells[12, 24] = False
    assert has_way(cells)


@pytest.mark.parametrize("name", ["barn:", "barn:-1", "barn:x", "barn:1@0.5", f"barn:{2**63}"])
def test_a_name_that_is_none_is_refused_in_one_sentence(name):
    with pytest.raises(SceneError, match="write barn:SEED"):
        load_scene(name)


def test_a_server_offers_the_world_that_it_was_started_with():
    library = FileLibrary("barn:3")
    assert library.own_name == "barn:3"
    assert library.load("barn:3", None, None).seed == 3
    assert not library.changed()
