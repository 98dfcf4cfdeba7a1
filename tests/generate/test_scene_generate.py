"""Generated scenes: the same text from the same seed, always one that can be solved, and harder by the dial."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motm_twin.bus.library import FileLibrary
from motm_twin.cli import scene as cli_scene
from motm_twin.generate.pieces import dial
from motm_twin.generate.scenes import generate, name_of, parse_name
from motm_twin.model.scene import DriveTo, Pick, Scene
from motm_twin.model.scene_file import SceneError, check_all, load_scene
from motm_twin.model.scene_shapes import outline
from motm_twin.trial import run_scene

STEP = 0.1  # [m] of the search for a way
TURNS = 16  # headings
SPARE = 0.05  # [m] that the base controller keeps
NEAR = 0.70  # [m] from the arm's mount to a target


def test_the_same_seed_and_difficulty_give_the_same_bytes_everywhere(tmp_path, capsys):
    path = tmp_path / "new.yaml"
    assert cli_scene.generate_scene(17, 0.6, path, None) == 0
    assert path.read_bytes() == generate(17, 0.6).encode()
    capsys.readouterr()
    assert cli_scene.generate_scene(17, 0.6, None, None) == 0
    assert capsys.readouterr().out == path.read_text()
    mine, named = load_scene(str(path)), load_scene("generated:17@0.60")
    assert (mine.solids, mine.tasks, mine.seed) == (named.solids, named.tasks, 17)
    assert (named.name, load_scene("generated:17").name) == ("generated:17@0.6", "generated:17@0.5")


@settings(max_examples=6, deadline=None, derandomize=True)
@example(seed=0, difficulty=1e-5)
@given(seed=st.integers(0, 2**63 - 1), difficulty=st.floats(0.0, 1.0))
def test_every_seed_and_difficulty_is_a_scene_as_large_as_the_dial_says(seed, difficulty):
    scene, numbers = load_scene(name_of(seed, difficulty)), dial(parse_name(name_of(seed, difficulty))[1])
    assert len(scene.objects) == numbers.cubes == sum(isinstance(task, Pick) for task in scene.tasks)
    assert len(scene.bins) == numbers.bins
    assert len(scene.agents) == numbers.agents
    assert sum(isinstance(task, DriveTo) for task in scene.tasks) == numbers.drives
    assert sum(not solid.mapped for solid in scene.solids) == numbers.boxes
    start = shapely.Point(scene.start[:2])  # seed 82 at 0.95 once began with the hand in a column
    assert min(outline(solid.shape).distance(start) for solid in scene.solids) >= 0.9


def test_a_harder_scene_has_no_less_of_anything_and_stands_no_wider():
    numbers = [dial(step / 40) for step in range(41)]
    for before, after in itertools.pairwise(numbers):
        for count in ("surfaces", "bins", "cubes", "drives", "clutter", "boxes", "agents", "doors", "spread"):
            assert getattr(after, count) >= getattr(before, count)
        assert (after.gap, after.doorway) < (before.gap, before.doorway)
    assert numbers[-1].agents > 0 == numbers[0].agents
    assert numbers[-1].doorway == pytest.approx(0.9)


def test_what_is_no_seed_or_no_difficulty_is_refused_with_a_sentence(tmp_path, capsys):
    for name in ("generated:", "generated:x", "generated:-1", "generated:1@", "generated:1@1.01", "generated:1@nan"):
        with pytest.raises(SceneError, match="generated"):
            load_scene(name)
    with pytest.raises(SceneError, match="whole number"):
        load_scene(f"generated:{2**63}")
    taken = tmp_path / "taken.yaml"
    taken.touch()
    for arguments in ((None, 0.5, None, None), (1, math.inf, None, None), (1, 0.5, taken, None), (1, 0.5, None, "x")):
        assert cli_scene.generate_scene(*arguments) == 2
        assert capsys.readouterr().err.count("\n") == 1
    assert not taken.read_bytes()


def test_a_server_offers_the_generated_scene_that_it_was_started_with():
    library = FileLibrary("generated:4@0.3")
    assert library.own_name in [choice.name for choice in library.choices()]
    assert library.load(library.own_name, None, None).title == "Generated scene, seed 4, difficulty 0.3"
    assert not library.changed()


def places_reached(scene: Scene) -> np.ndarray:
    """Poses of the footprint, shape (n, 3), that it gets to by driving straight and turning, `SPARE` from everything.

    A search on a raster that knows nothing of how the generator argues.
    """
    body = scene.robot.footprint
    x_min, y_min, x_max, y_max = scene.bounds
    x, y = (
        at + STEP * np.arange(math.ceil((low - at) / STEP), math.floor((high - at) / STEP))
        for at, low, high in zip(scene.start[:2], (x_min, y_min), (x_max, y_max), strict=True)
    )
    heading = np.arange(TURNS) * 2.0 * np.pi / TURNS
    grid = np.stack(np.meshgrid(x, y, heading, indexing="ij"), axis=-1)
    a, b = 0.5 * body.length + SPARE, 0.5 * body.width + SPARE
    corners = np.array([[-a, -b], [a, -b], [a, b], [-a, b]])
    c, s = np.cos(heading)[:, None], np.sin(heading)[:, None]
    turned = np.stack((c * corners[:, 0] - s * corners[:, 1], s * corners[:, 0] + c * corners[:, 1]), axis=-1)
    footprints = shapely.polygons(grid[..., None, :2] + turned)
    walls = shapely.union_all([outline(solid.shape) for solid in scene.solids if solid.z_min < 1.3])
    shapely.prepare(walls)
    free = ~shapely.intersects(walls, footprints)
    reached = np.zeros_like(free)
    reached[np.abs(x - scene.start[0]).argmin(), np.abs(y - scene.start[1]).argmin(), :] = True
    reached &= free
    count = 0
    while reached.sum() > count:
        count = reached.sum()
        reached |= np.roll(reached, 1, axis=2) | np.roll(reached, -1, axis=2)
        for turn in range(0, TURNS, TURNS // 8):
            along = round(math.cos(heading[turn])), round(math.sin(heading[turn]))
            reached[1:-1, 1:-1, turn] |= np.roll(reached[:, :, turn], along, axis=(0, 1))[1:-1, 1:-1]
        reached &= free
    return grid[reached]


@pytest.mark.parametrize("name", ["generated:5@1", "generated:55@0.65", "generated:41@1"])
def test_from_the_start_there_is_a_way_to_where_every_target_is_served(name):
    scene = load_scene(name)
    pose = places_reached(scene)
    mount = pose[:, :2] + scene.robot.arm.mount_x * np.column_stack((np.cos(pose[:, 2]), np.sin(pose[:, 2])))
    targets = [item.position[:2] for item in scene.objects] + [item.centre for item in scene.bins]
    assert all((np.hypot(*(mount - target).T) <= NEAR).any() for target in targets)
    goals = [task.point for task in scene.tasks if isinstance(task, DriveTo)]
    assert all((np.hypot(*(pose[:, :2] - goal).T) <= STEP).any() for goal in goals)


def test_a_generated_scene_is_completed():
    result = run_scene(load_scene("generated:41@0"))
    assert (result["success"], result["reason"], result["contacts"]) == (True, "", [])


def test_a_file_that_was_written_checks_as_any_other(tmp_path):
    path = tmp_path / "mine.yaml"
    assert cli_scene.generate_scene(8, 0.8, path, None) == 0
    assert len(check_all(str(path))) == 1
