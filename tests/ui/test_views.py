"""The computing parts of the page: texts, colours, meshes, rays."""

import math

import msgspec
import numpy as np
import pytest
import trimesh
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.client import Grid
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import GRID_VERSION, GridInfo, TickMessage
from motm_twin.model.scene import Box, Cylinder, Prism, Solid
from motm_twin.ui import cards, colours
from motm_twin.ui.camera import from_above, interest, overview
from motm_twin.ui.drag import on_plane
from motm_twin.ui.free_place import free_place, is_free
from motm_twin.ui.furniture import bin_mesh, floor_glb, loose_box_mesh, solid_mesh
from motm_twin.ui.plan_view import relative_cost
from motm_twin.ui.robot_view import GHOST_GAP, GHOSTS, ghost_poses
from motm_twin.ui.rotation import matrices_wxyz, yaw_wxyz
from motm_twin.ui.textures import MARGIN, floor

EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    sent = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


def test_names_from_outside_are_escaped_on_every_card(tick):
    tasks = [msgspec.structs.replace(task, target=EVIL) for task in tick.tasks]
    placement = msgspec.structs.replace(tick.placement, rejected=[EVIL] * 72)
    bad = msgspec.structs.replace(tick, tasks=tasks, stop_reason=EVIL, placement=placement)
    texts = [cards.progress_card(bad), cards.candidate_card(placement, 0), cards.status_card("error", None, EVIL)]
    for text in texts:
        assert "<img" not in text
        assert "&lt;img" in text


def test_a_candidate_tells_its_costs_or_why_it_is_out(tick):
    placement = tick.placement
    chosen = cards.candidate_card(placement, placement.chosen)
    assert "chosen" in chosen
    assert "rank 1" in chosen
    out = next(index for index, reason in enumerate(placement.rejected) if reason)
    assert "rejected: collision with object table" in cards.candidate_card(placement, out)
    assert "global path" in cards.candidate_card(placement, None)


def test_a_pick_and_its_place_share_a_row(tick):
    rows = cards.pairs(tick.tasks)
    assert len(rows) == 4
    assert all(first.kind == "pick" and second.kind == "place" for first, second in rows)
    alone = [tick.tasks[1], *tick.tasks[:2]]
    assert [second is None for _, second in cards.pairs(alone)] == [True, False]


def test_relative_costs_run_from_the_cheapest_to_the_dearest(tick):
    relative = relative_cost(tick.placement)
    viable = np.array([not reason for reason in tick.placement.rejected])
    assert relative[viable].min() == 0.0
    assert relative[viable].max() == pytest.approx(1.0)
    assert np.isnan(relative[~viable]).all()
    assert tuple(colours.scale(np.array([0.0]))[0]) == (253, 231, 37)


def test_free_ground_is_clear_and_occupied_ground_is_red():
    table = colours.ground_table()
    assert table.shape == (256, 4)
    assert table[0, 3] == 0
    red, green, blue, alpha = (int(value) for value in table[255])
    assert red > 2 * green
    assert red > 2 * blue
    assert alpha > 100


@pytest.mark.parametrize(
    ("shape", "low", "high"),
    [
        (Box(centre=(1.0, 2.0), size=(0.8, 0.4)), (0.6, 1.8), (1.4, 2.2)),
        (Box(centre=(1.0, 2.0), size=(0.8, 0.4), yaw=math.pi / 2), (0.8, 1.6), (1.2, 2.4)),
        (Cylinder(centre=(1.0, 2.0), radius=0.3), (0.7, 1.7), (1.3, 2.3)),
        (Prism(corners=((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.5, 0.2))), (0.0, 0.0), (1.0, 1.0)),
    ],
)
@pytest.mark.parametrize("style", ["table", "desk", "cabinet", "box", "wall", "plain", "unheard of"])
def test_furniture_is_drawn_as_large_as_the_referee_knows_it(shape, low, high, style):
    solid = Solid(name="s", shape=shape, z_min=0.0, z_max=0.6, mapped=True, style=style)
    bounds = solid_mesh(solid).bounds
    np.testing.assert_allclose(bounds[0], (*low, 0.0), atol=0.003)
    np.testing.assert_allclose(bounds[1], (*high, 0.6), atol=0.003)


def test_a_bin_is_open_and_stands_where_it_belongs():
    box = fake_scene().bins[0]
    scene = bin_mesh(box)
    middle = (scene.bounds[0] + scene.bounds[1]) / 2
    np.testing.assert_allclose(middle[:2], box.centre, atol=1e-6)
    assert scene.bounds[:, 2] == pytest.approx([box.floor_z, box.rim_z])
    down = trimesh.util.concatenate(scene.dump()).ray.intersects_location([(*box.centre, 2.0)], [(0.0, 0.0, -1.0)])[0]
    assert down[:, 2].max() == pytest.approx(box.floor_z + box.wall)


def test_a_loose_box_has_its_size():
    np.testing.assert_allclose(loose_box_mesh((0.4, 0.3, 0.6)).extents, (0.4, 0.3, 0.6), atol=0.003)


def test_the_floor_covers_the_map_and_is_darker_under_furniture():
    scene = fake_scene()
    picture, _, centre, size = floor(scene)
    assert size[0] == scene.bounds[2] - scene.bounds[0] + 2 * MARGIN
    pixels = np.asarray(picture, dtype=float)

    def tone(x, y):
        column = (x - centre[0] + size[0] / 2) / size[0] * pixels.shape[1]
        row = (centre[1] + size[1] / 2 - y) / size[1] * pixels.shape[0]
        return pixels[int(row), int(column)].mean()

    assert tone(-0.1, 2.2) < 0.8 * tone(1.5, 0.5)
    assert pixels[0, 0].mean() > 250.0
    assert floor_glb(scene)[:4] == b"glTF"


def test_quaternions_turn_like_their_matrices():
    rng = np.random.default_rng(1)
    q = rng.normal(size=(200, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    R = np.array([trimesh.transformations.quaternion_matrix(row)[:3, :3] for row in q])
    assert np.abs(np.abs((matrices_wxyz(R) * q).sum(axis=1)) - 1.0).max() < 1e-12
    turn = trimesh.transformations.quaternion_matrix(yaw_wxyz(0.7))
    np.testing.assert_allclose(turn[:2, :2] @ [1.0, 0.0], [math.cos(0.7), math.sin(0.7)])


def test_ghosts_keep_apart_and_are_few():
    line = np.array([(0.05 * i, 0.0, 0.0) for i in range(200)])
    poses = ghost_poses(line)
    assert len(poses) == GHOSTS
    assert poses[0, 0] >= GHOST_GAP - 1e-9
    assert poses[-1, 0] > 9.0
    assert len(ghost_poses(np.zeros((0, 3)))) == 0
    assert len(ghost_poses(np.zeros((5, 3)))) == 0


def test_a_ray_meets_the_plane_it_points_at_and_no_other():
    eye = np.array([0.0, 0.0, 2.0])
    assert on_plane(eye, np.array([1.0, 0.5, 1.0]), 0.0) == pytest.approx((2.0, 1.0))
    assert on_plane(eye, np.array([1.0, 0.5, 3.0]), 0.0) is None
    assert on_plane(eye, np.array([1.0, 0.0, 2.0]), 0.0) is None


def test_the_overview_looks_at_the_scene_from_outside():
    scene = fake_scene()
    centre, reach = interest(scene)
    assert reach > 1.6
    position, look_at = overview(scene)
    assert position[2] > 2.0
    assert np.linalg.norm(look_at[:2] - np.array(centre)) < 1e-9
    above, below = from_above(scene)
    assert np.hypot(*(above[:2] - below[:2])) < 0.05


def test_a_new_obstacle_comes_to_free_floor_away_from_others():
    cells = np.zeros((100, 100), dtype=np.uint8)
    cells[:, 60:] = 255  # x > 1 m is occupied
    info = GridInfo(
        version=GRID_VERSION, run=1, encoding="", resolution=0.05, origin=[-2.0, -2.0], width=100, height=100, stamp=0.0
    )
    grid = Grid(info=info, cells=cells)
    taken = []
    for _ in range(4):
        x, y, _ = free_place([0.0, 0.0, math.pi], grid, taken)
        assert x < 0.62
        assert all(math.dist((x, y), other) > 0.7 for other in taken)
        assert is_free(grid, (x, y))
        taken.append((x, y))
    assert not is_free(grid, (0.9, 0.0))
    assert not is_free(grid, (9.0, 0.0))
