"""Scenes from a seed: the same text for the same seed; generated ones can be solved, BARN worlds have a way."""

import itertools
import math

import numpy as np
import pytest
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from motm_twin.bus.library import FileLibrary
from motm_twin.cli import scene as cli_scene
from motm_twin.generate.challenges import (
    CIRCLE,
    COLUMNS,
    LEVELS,
    PERSON_RADIUS,
    ROBOT_RADIUS,
    ROWS,
    barn,
    field,
    has_way,
    made,
)
from motm_twin.generate.pieces import dial
from motm_twin.generate.scenes import generate, name_of, parse_name
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Cylinder, DriveTo, Pick, Scene
from motm_twin.model.scene_file import check_all, load_scene
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


@pytest.mark.parametrize("name", ["circle:4", "square:4", "dynabarn:4"])
def test_a_seed_gives_the_same_text_and_another_seed_another_one(name):
    assert made(name) == made(name)
    assert made(name)[1].split("\n", 2)[2] != made(name.replace("4", "5"))[1].split("\n", 2)[2]


@pytest.mark.parametrize("seed", range(20))
def test_five_persons_cross_the_circle_and_keep_apart_at_start_and_goal(seed):
    scene = load_scene(f"circle:{seed}")
    assert (scene.start[:2], scene.tasks[0].point, scene.time_limit) == ((0.0, -4.0), (0.0, 4.0), 25.0)
    assert scene.robot.base.forward_speed == 1.0
    assert len(scene.agents) == 5
    places = [(scene.start[:2], PERSON_RADIUS + ROBOT_RADIUS + 0.2)]
    for agent in scene.agents:
        assert (agent.behaviour, agent.radius, agent.speed, agent.sees_robot) == ("orca", 0.3, 1.0, True)
        assert np.allclose(agent.waypoints[0], -np.array(agent.start[:2]), atol=1e-4)
        assert abs(math.hypot(*agent.start[:2]) - CIRCLE) <= math.hypot(0.5, 0.5)
        assert all(math.dist(agent.start[:2], place) >= gap - 1e-3 for place, gap in places)
        places.append((agent.start[:2], 2.0 * PERSON_RADIUS + 0.2))


def test_the_invisible_robot_is_a_variant_with_the_same_ways():
    seen, unseen = load_scene("circle:7", "visible"), load_scene("circle:7", "invisible")
    assert [agent.start for agent in seen.agents] == [agent.start for agent in unseen.agents]
    assert not any(agent.sees_robot for agent in unseen.agents)


@pytest.mark.parametrize("seed", range(5))
def test_persons_of_the_square_go_from_one_half_to_the_other(seed):
    for agent in load_scene(f"square:{seed}").agents:
        (x, y), (goal_x, goal_y) = agent.start[:2], agent.waypoints[0]
        assert x * goal_x <= 0.0
        assert max(map(abs, (x, y, goal_x, goal_y))) <= 5.0


@pytest.mark.parametrize("level", LEVELS)
def test_cylinders_of_every_level_move_at_its_speeds_on_the_same_ways(level):
    scene, easy = load_scene("dynabarn:3", level), load_scene("dynabarn:3", "easy")
    slow, quick = LEVELS[level]
    assert all(slow <= agent.speed <= quick and agent.radius == 0.5 for agent in scene.agents)
    assert [agent.waypoints for agent in scene.agents] == [agent.waypoints for agent in easy.agents]


@pytest.mark.parametrize("name", ["circle:", "circle:x", "square:-1", "dynabarn:99999999999999999999"])
def test_what_is_no_crowd_is_refused(name):
    with pytest.raises(SceneError):
        load_scene(name)
