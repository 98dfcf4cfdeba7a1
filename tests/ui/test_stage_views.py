"""The computing parts of the stage: colours, meshes, shadows, rays, framing."""

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
from motm_twin.ui import colours
from motm_twin.ui.backdrop import floor_glb, ground_glb, sky_glb
from motm_twin.ui.drag import on_plane
from motm_twin.ui.framing import ASPECT, FIELD_OF_VIEW, extent, from_above, overview
from motm_twin.ui.free_place import free_place, is_free
from motm_twin.ui.furniture import bin_mesh, loose_box_mesh, solids_mesh
from motm_twin.ui.light import SHADOW_SHIFT, on_screen, shining
from motm_twin.ui.plan_view import relative_cost
from motm_twin.ui.robot_view import GHOST_GAP, GHOSTS, ghost_poses
from motm_twin.ui.rotation import matrices_wxyz, yaw_wxyz
from motm_twin.ui.shadows import box_shadow_glb
from motm_twin.ui.textures import MARGIN, floor, ground_tone


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    sent = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


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
    bounds = solids_mesh([solid]).bounds
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


def test_the_floor_covers_the_map_and_goes_over_into_the_ground_around():
    scene = fake_scene()
    picture, centre, size = floor(scene)
    assert size[0] == scene.bounds[2] - scene.bounds[0] + 2 * MARGIN
    corner = np.asarray(picture, dtype=float)[0, 0]
    assert np.abs(corner - ground_tone(np.array(0.5 * math.hypot(*size)))).max() < 1.5
    for mesh in (floor_glb(scene), ground_glb(centre), sky_glb(centre)):
        assert mesh[:4] == b"glTF"


def test_what_shines_by_itself_is_seen_as_wanted():
    wanted = np.repeat(np.array([40.0, 120.0, 200.0, 226.0])[:, None], 3, axis=1)
    code = shining(wanted) / 255.0
    linear = np.where(code < 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    assert np.abs(on_screen(linear) - wanted).max() < 1.0


def test_a_shadow_lies_under_its_body_and_away_from_the_sun():
    mesh = trimesh.load_scene(trimesh.util.wrap_as_stream(box_shadow_glb(0.4, 0.4, 1.0)), file_type="glb")
    (low, high), shift = mesh.bounds, np.array(SHADOW_SHIFT)
    assert (low[:2] < -0.2).all()
    assert (high[:2] > 0.2).all()
    assert high[0] > 0.2 + shift[0]


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


@pytest.mark.parametrize("aspect", [0.7, ASPECT, 2.2])
@pytest.mark.parametrize("view", [overview, from_above])
def test_everything_is_in_the_picture_and_fills_it(view, aspect):
    points = extent(fake_scene())
    position, look_at = view(fake_scene(), aspect)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(forward, [0.0, 0.0, 1.0]))
    seen = points - position
    depth = seen @ forward
    half = math.tan(FIELD_OF_VIEW / 2)
    across = np.abs(seen @ right / depth / (half * aspect)).max()
    high = np.abs(seen @ np.cross(right, forward) / depth / half).max()
    assert depth.min() > 0.0
    assert max(across, high) == pytest.approx(0.93, abs=0.01)


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
