"""The computing parts of the stage: colours, meshes, shadows, rays, framing."""

import math

import msgspec
import numpy as np
import pytest
import trimesh
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.client import Grid
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import GRID_VERSION, BodyMessage, GridInfo, TickMessage
from motm_twin.model.scene import Box, Cylinder, DriveTo, Prism, Solid
from motm_twin.model.scene_file import load_scene
from motm_twin.ui import colours
from motm_twin.ui.panel.disturb import free_place, is_free
from motm_twin.ui.scene.cameras import ASPECT, FIELD_OF_VIEW, extent, from_above, overview
from motm_twin.ui.scene.drag import on_plane, spot_of, throw
from motm_twin.ui.scene.furniture import bin_mesh, loose_box_mesh, solids_mesh
from motm_twin.ui.scene.light import (
    MARGIN,
    SHADOW_SHIFT,
    box_shadow_glb,
    floor,
    floor_glb,
    ground_glb,
    ground_tone,
    on_screen,
    shining,
    sky_glb,
)
from motm_twin.ui.scene.picking import Ray, Surroundings, waiting_job
from motm_twin.ui.scene.plan_view import believed, dashes, drive_points, relative_cost, target_spot
from motm_twin.ui.scene.robot_view import GHOST_GAP, GHOSTS, ghost_poses


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
@pytest.mark.parametrize("style", ["table", "desk", "cabinet", "shelf", "box", "wall", "plain", "unheard of"])
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
    picture, (x, y, u, v) = floor(scene)
    assert u - x == scene.bounds[2] - scene.bounds[0] + 2 * MARGIN
    assert np.abs(picture[0, 0] - ground_tone(np.array(0.5 * math.hypot(u - x, v - y)))).max() < 1.5
    for mesh in (floor_glb(scene), ground_glb((1.0, 2.0)), sky_glb((1.0, 2.0))):
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


def test_the_picture_of_a_scene_holds_where_its_robot_is_sent():
    scene = load_scene("line")
    (end,) = (task.point for task in scene.tasks if isinstance(task, DriveTo))
    assert end[0] + 0.4 < extent(scene)[:, 0].max()


def test_a_new_obstacle_comes_to_free_floor_away_from_others():
    cells = np.zeros((100, 100), dtype=np.uint8)
    cells[:, 60:] = 255  # x > 1 m is occupied
    info = GridInfo(
        version=GRID_VERSION, run=1, encoding="", resolution=0.05, origin=[-2.0, -2.0], width=100, height=100, stamp=0.0
    )
    grid = Grid(info=info, cells=cells)
    taken = []
    for _ in range(4):
        x, y, _, _ = free_place([0.0, 0.0, math.pi], grid, taken)
        assert x < 0.62
        assert all(math.dist((x, y), other) > 0.7 for other in taken)
        assert is_free(grid, (x, y))
        taken.append((x, y))
    assert not is_free(grid, (0.9, 0.0))
    assert not is_free(grid, (9.0, 0.0))


def test_a_hand_that_moves_on_release_throws_and_one_that_rests_does_not():
    moving = [(0.05 * i, 0.05 * i, 0.0) for i in range(9)]  # 1 m/s along x
    assert throw(moving, 0.42) == pytest.approx((1.0, 0.0))
    assert throw(moving, 0.9) == (0.0, 0.0)
    assert throw([(t, 0.2 * x, 0.0) for t, x, _ in moving], 0.42) == (0.0, 0.0)
    assert math.hypot(*throw([(t, 9.0 * x, 9.0 * x) for t, x, _ in moving], 0.42)) == pytest.approx(2.5)
    assert throw(moving[:1], 0.0) == (0.0, 0.0)
    slow_page = [(0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.97, 1.0, 0.0), (1.0, 1.0, 0.0)]
    assert throw(slow_page, 1.0) == pytest.approx((1.0, 0.0))
    assert throw([*moving, (0.9, 0.4, 0.0)], 0.9) == (0.0, 0.0)
    rested = [*moving, *((0.4 + 0.05 * i, 0.4, 0.0) for i in range(1, 9))]
    assert throw(rested, 0.82) == (0.0, 0.0)


def test_dashes_leave_gaps_and_end_where_the_line_ends():
    line = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], dtype=np.float32)
    pieces = dashes(line)
    drawn = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum()
    assert 0.8 < drawn < 1.2
    assert np.linalg.norm(pieces, axis=2).max() <= math.sqrt(2.0) + 1e-6
    assert dashes(line[:2] * 0.01).shape[1:] == (2, 2)


@pytest.fixture
def around(tick):
    """What the pointer can be at."""
    surroundings = Surroundings(fake_scene())
    surroundings.update(tick)
    return surroundings


def aimed(around, tick, point, *, candidates=True):
    return around.first(Ray.through((point[0] - 1.0, point[1] - 2.0, 3.0), point), tick, candidates=candidates)


def test_the_pointer_finds_the_first_thing_on_its_way(around, tick):
    item, box = tick.objects[0], around.now.bins[0]
    assert aimed(around, tick, item.position).name == item.name
    hit = aimed(around, tick, (*box.centre, box.rim_z))
    assert (hit.kind, hit.name) == ("bin", box.name)
    piece = next(iter(around.pieces.values()))
    top = max(solid.z_max for solid in around.now.solids if solid.name in piece.solids)
    corner = (piece.centre[0], piece.centre[1], top)
    assert aimed(around, tick, corner, candidates=False).kind in ("piece", "bin", "object")
    x, y, _ = tick.robot.true_pose
    assert aimed(around, tick, (x, y, 0.4), candidates=False).kind == "robot"
    far = (tick.robot.true_pose[0] + 40.0, 40.0, 0.0)
    assert aimed(around, tick, far).kind == "floor"
    assert around.first(Ray.through((0.0, 0.0, 1.0), (1.0, 0.0, 2.0)), tick, candidates=True) is None


def test_a_candidate_is_found_by_its_place_only_while_they_are_shown(around, tick):
    viable = next(i for i, reason in enumerate(tick.placement.rejected) if not reason)
    x, y, _ = tick.placement.poses[viable]
    hit = aimed(around, tick, (x, y, 0.035))
    assert hit.kind == "candidate"
    assert math.dist(tick.placement.poses[hit.index][:2], (x, y)) < 0.05
    assert aimed(around, tick, (x, y, 0.035), candidates=False).kind != "candidate"


def test_a_cube_is_put_on_the_surface_under_the_pointer(around):
    box = around.now.bins[0]
    down = Ray.through((*box.centre, 3.0), (*box.centre, 0.0))
    put = around.surface(down)
    tops = [s.z_max for s in around.now.solids] + [b.floor_z for b in around.now.bins]
    assert any(abs(put[2] - top) < 1e-9 for top in tops)
    assert around.surface(Ray.through((40.0, 40.0, 2.0), (40.0, 41.0, 0.0)))[2] == pytest.approx(0.0)


def test_a_moved_piece_is_found_where_it_is_now(around, tick):
    name, piece = next(iter(around.pieces.items()))
    body = BodyMessage(name=name, kind="furniture", position=[20.0, 20.0, 0.0], yaw=1.0, state="", size=[1.0, 1.0, 1.0])
    moved = msgspec.structs.replace(tick, furniture=[body])
    around.update(moved)
    spot = spot_of(name, moved, around)
    assert (spot.x, spot.y, spot.heading) == (20.0, 20.0, 1.0)
    assert around.first(Ray.through((20.0, 19.9, 9.0), (20.0, 20.0, 0.0)), moved, candidates=False).kind != "floor"
    assert spot_of(name, msgspec.structs.replace(tick, removed=[name]), around) is None
    assert piece.centre != (20.0, 20.0)


def test_points_to_drive_to_are_read_from_the_tasks_that_are_left(tick):
    drive = msgspec.structs.replace(tick.tasks[0], kind="drive_to", target="(1.50, -0.25)", status="waiting")
    assert drive_points(msgspec.structs.replace(tick, tasks=[drive, *tick.tasks], task_index=0)) == [(1.5, -0.25)]
    assert drive_points(msgspec.structs.replace(tick, tasks=[drive, *tick.tasks], task_index=1)) == []


def test_beliefs_are_marked_only_where_they_are_off(tick):
    item = tick.objects[0]
    belief = msgspec.structs.replace(tick.beliefs[0], name=item.name, position=[p + 0.004 for p in item.position])
    assert len(believed(msgspec.structs.replace(tick, beliefs=[belief]))) == 0
    off = msgspec.structs.replace(belief, position=[p + 0.02 for p in item.position])
    assert believed(msgspec.structs.replace(tick, beliefs=[off])).shape == (1, 3)


def test_the_target_is_marked_where_the_robot_believes_it(tick):
    surroundings, item = Surroundings(fake_scene()), tick.objects[0]
    surroundings.update(tick)
    picks = [task for task in tick.tasks if task.kind == "pick" and task.target == item.name]
    assert picks, "the first cube is to be picked"
    active = msgspec.structs.replace(tick, task_index=tick.tasks.index(picks[0]))
    off = [item.position[0] + 0.3, item.position[1] - 0.1, item.position[2] + 0.05]
    belief = msgspec.structs.replace(tick.beliefs[0], name=item.name, position=off)
    spot = target_spot(msgspec.structs.replace(active, beliefs=[belief]), surroundings)
    assert (spot.x, spot.y, spot.z) == pytest.approx((off[0], off[1], off[2] - 0.5 * item.size[0]))
    known = target_spot(msgspec.structs.replace(active, beliefs=[]), surroundings)
    assert (known.x, known.y) == pytest.approx(tuple(item.position[:2]))


def test_a_cube_that_waits_in_the_list_is_found_with_its_bin(tick):
    waiting = [msgspec.structs.replace(task, status="waiting") for task in tick.tasks]
    assert waiting_job(waiting, waiting[0].target) == (0, waiting[1].target)
    assert waiting_job(waiting, "nothing") is None
    done = [msgspec.structs.replace(task, status="done") for task in tick.tasks]
    assert waiting_job(done, done[0].target) is None
