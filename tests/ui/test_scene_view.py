"""The 3D scene: its nodes, meshes, shadows, colours and marks."""

import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
import trimesh
from fake_twin import fake_scene
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Answer, ReleaseBody
from motm_twin.bus.connection import free_port
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import BodyMessage, TrackMessage
from motm_twin.model.kinematics import Frankie
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Bin, Box, Bump, Cylinder, Prism, Solid
from motm_twin.model.scene_file import list_scenes, load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.planning.prediction import ellipses
from motm_twin.twin import Twin
from motm_twin.ui import colours
from motm_twin.ui.hub import Hub, Shown
from motm_twin.ui.scene import light
from motm_twin.ui.scene.drag import SELECTION
from motm_twin.ui.scene.furniture import bin_mesh, bump_mesh, loose_box_mesh, solids_mesh
from motm_twin.ui.scene.picking import Surroundings
from motm_twin.ui.scene.robot_view import APART, FREE, SILHOUETTES, reaching, silhouette_poses
from motm_twin.ui.scene.scene_view import SceneView, believed, dashes, drive_points, hits, relative_cost, target_spot
from motm_twin.ui.what_if import Other

FIXED = ("/scene/", "/light/", "/furniture/")
replace = msgspec.structs.replace
SCENE = fake_scene()


@pytest.fixture
def view(server):
    """A view on a page that nobody looks at, with no twin behind it."""
    with TwinClient(f"tcp/127.0.0.1:{free_port()}") as client:
        hub = Hub(client)
        drawn = SceneView(server, hub)
        yield drawn
        drawn.stop()
        hub.stop()


def show(view, tick, scene=SCENE):
    looks = view._hub.view
    shown = Shown(state="playing", status=None, scene=scene, tick=tick, newest=tick, live=True, view=looks)
    view.draw(shown, 0.03, slow=True)


def test_a_run_of_another_seed_keeps_floor_and_furniture_as_they_are(view, tick):
    """A browser showed an empty room until it had read the same meshes again."""

    def handles():
        table = view._server.scene._handle_from_node_name
        return {name: handle for name, handle in table.items() if name.startswith(("/scene/", "/furniture/"))}

    show(view, tick)
    before = handles()
    show(view, tick, replace(SCENE, seed=SCENE.seed + 1))
    assert handles() == before
    higher = tuple(replace(solid, z_max=solid.z_max + 0.1) for solid in SCENE.solids)
    show(view, tick, replace(SCENE, solids=higher))
    assert not any(before.get(name) is handle for name, handle in handles().items())


def nodes(view):
    """Names of all nodes that are drawn."""
    table = view._server.scene._handle_from_node_name
    return {name for name, handle in table.items() if type(handle).__name__ != "FrameHandle"}


def person(name):
    return BodyMessage(
        name=name, kind="person", position=[0.5, 0.5, 0.0], yaw=0.3, state="standing", size=[0.5, 0.5, 1.75]
    )


def test_a_place_that_was_clicked_tells_its_costs(view, tick):
    placement = replace(
        tick.placement, poses=[[1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [3.0, 0.0, 0.0]], cost_current=[2.0, 3.0, None],
        cost_next=[4.0, None, None], cost=[6.0, 3.0, None], rejected=["", "", "collision with desk"], chosen=0,
    )  # fmt: skip
    label, now = view._plan.candidates._cost, replace(tick, placement=placement)
    show(view, now)  # another scene forgets what was picked
    there = "2.0 s to get there, 4.0 s on to the next target"
    for picked, words in enumerate((there, "3.0 s to get there", "collision with desk")):
        view._hub.view.picked = picked
        show(view, now)
        assert label.visible and label.text == words
        assert label.position[0] == pytest.approx(placement.poses[picked][0], abs=0.05)
    view._hub.view.picked = None
    show(view, now)
    assert not label.visible
    view._hub.view.picked = 1
    show(view, replace(now, task_index=tick.task_index + 1))
    assert not label.visible and view._hub.view.picked is None, "it was of another task"


def a_track(number, position, velocity):
    row = np.array([*position, *velocity, 0.25, 0.02, number])
    return TrackMessage(
        track=number, position=list(position), velocity=list(velocity), radius=0.25, position_sd=0.02,
        expected=ellipses(row, (1.0, 2.0, 3.0)).tolist(),
    )  # fmt: skip


def test_tracks_have_a_number_an_arrow_and_ellipses_that_grow_and_a_ring_marks_the_one_that_is_met(view, tick):
    why = Reason(kind=Kind.MEETS_MOVER, value=0.4, limit=0.5)
    tracks = [a_track(3, (2.0, 1.0), (0.5, 0.0)), a_track(7, (3.0, 2.0), (0.0, 0.0))]
    show(view, replace(tick, tracks=tracks, why=why))
    drawn = view._tracks
    assert [label.text for label in drawn._labels if label.visible] == ["3", "7"]
    assert np.allclose([label.position[:2] for label in drawn._labels[:2]], [(2.5, 1.0), (3.0, 1.55)])
    points, corners = drawn._lines.points, 48
    assert len(points) == 3 + 2 * corners  # of the one that moves
    assert np.allclose(points[0, :, :2], [(2.0, 1.0), (2.5, 1.0)])
    first, second = points[3 : 3 + corners, 0], points[3 + corners :, 0]
    assert np.allclose(first.mean(axis=0)[:2], (2.5, 1.0), atol=1e-3)
    assert np.allclose(second.mean(axis=0)[:2], (3.0, 1.0), atol=1e-3)
    assert np.all(np.ptp(second, axis=0)[:2] > np.ptp(first, axis=0)[:2])
    assert np.ptp(second, axis=0)[0] > np.ptp(second, axis=0)[1] > 0.5  # longer along its way
    assert drawn._ring.visible and np.allclose(drawn._ring.position[:2], (2.0, 1.0))
    show(view, replace(tick, tracks=[], why=None))
    assert not (drawn._lines.visible or drawn._ring.visible or any(label.visible for label in drawn._labels))


def test_a_trail_is_left_by_what_goes_and_not_by_what_is_put_elsewhere_or_seen_earlier(view, tick):
    def at(x, time):
        walker = replace(person("Ann"), position=[x, 0.5, 0.0])
        show(view, replace(tick, agents=[walker], time=time))
        return len(view._bodies._bodies["body/Ann"].trail)

    assert [at(0.5 + 0.1 * k, 1.0 + 0.1 * k) for k in range(4)] == [1, 2, 3, 4]
    assert at(3.0, 1.3) == 1  # while time stands
    assert [at(3.1, 1.4), at(3.2, 1.5), at(6.0, 1.6)] == [2, 3, 1]  # while it runs
    assert [at(6.1, 1.7), at(3.1, 1.4)] == [2, 1]  # looking back
    assert not view._bodies._trails.visible


def test_what_the_robot_holds_is_hidden_with_it(view, tick):
    """A cube of the hidden robot hung in the air while both runs were watched."""
    held, *rest = tick.objects
    now = replace(tick, objects=[replace(held, state="held"), *rest])
    for on in (True, False):
        view._bodies.on = on
        view._bodies.update(now)
        assert view._bodies._bodies[f"object/{held.name}"].handle.visible == on
        assert all(view._bodies._bodies[f"object/{other.name}"].handle.visible for other in rest)


def test_fewer_than_a_hundred_nodes_move(view, tick):
    show(view, tick)
    view._others.update([Other(label="changed: 7.1 s", pose=(0.0, 0.0, 0.0), q=(0.0,) * 7, gripper=0.08)])
    moving = [name for name in nodes(view) if not name.startswith(FIXED)]
    assert 20 < len(moving) <= 100


def test_the_same_tick_again_sends_nothing(view, tick):
    show(view, tick)
    sent = []
    view._server.scene._queue_scene_message = sent.append
    show(view, tick)
    assert sent == []


def test_a_body_comes_moves_is_marked_frozen_and_goes_without_a_trace(view, tick):
    show(view, tick)
    before = nodes(view)
    show(view, replace(tick, obstacles=[person("ann")]))
    show(view, replace(tick, obstacles=[replace(person("ann"), state="frozen")]))
    assert any(name.endswith("sign") for name in nodes(view) - before)
    show(view, replace(tick, obstacles=[]))
    assert nodes(view) == before


@pytest.mark.parametrize("name", ["crate/lid", "crate/sign", "/crate", "crate/", "crate%2Flid", "../crate"])
def test_a_name_with_a_slash_is_no_place_in_the_tree_of_nodes(view, tick, name):
    """The body "crate/lid" was drawn in the frame of "crate" and went with it: then the page showed none at all."""
    bodies, cubes = ([replace(like, name=each) for each in ("crate", name)] for like in (person(""), tick.objects[0]))
    show(view, tick)
    before = nodes(view)
    show(view, replace(tick, objects=cubes, obstacles=bodies))
    assert sorted(node.count("/") for node in nodes(view) - before) == [3, 3, 3, 3, 4, 4], "with two shadows"
    moved = replace(bodies[1], position=[2.0, 2.0, 0.0], state="frozen")
    show(view, replace(tick, objects=cubes[1:], obstacles=[moved]))
    (drawn,) = (drawn for drawn in view._bodies._bodies.values() if drawn.sign is not None)
    assert tuple(drawn.handle.position[:2]) == (2.0, 2.0) and drawn.handle.name in nodes(view)
    show(view, tick)
    assert nodes(view) == before


@pytest.mark.parametrize("name", ["desk/lid", "desk/mesh", "bin0", "/"])
def test_furniture_of_any_name_is_a_piece_of_its_own(view, tick, name):
    """Furniture named as a part of another piece, or as the page calls a bin, took its place or went with it."""
    desk, table = (next(solid for solid in SCENE.solids if solid.name == each) for each in ("desk", "round table"))
    scene = replace(SCENE, solids=(desk, replace(table, name=name)), bins=(Bin(name="drop", centre=(6.0, 3.0)),))
    show(view, tick, scene)
    handles, drawn = view._server.scene._handle_from_node_name, view._furniture._drawn
    assert set(drawn) == {"desk", name} and "/furniture/bin0" in handles
    for piece in drawn.values():
        assert handles[piece.frame.name] is piece.frame and piece.frame.name.count("/") == 2
    show(view, replace(tick, removed=["desk"]), scene)
    assert [drawn["desk"].frame.visible, drawn[name].frame.visible] == [False, True]


def test_furniture_stands_where_the_tick_has_it_and_is_hidden_when_gone(view, tick):
    show(view, tick)
    name = next(iter(view._surroundings.pieces))
    frame = view._furniture._drawn[name].frame
    body = replace(person(name), kind="furniture", position=[1.0, -2.0, 0.0], yaw=math.pi / 2)
    show(view, replace(tick, furniture=[body]))
    assert tuple(frame.position[:2]) == (1.0, -2.0)
    assert frame.wxyz[3] == pytest.approx(math.sin(math.pi / 4))
    show(view, replace(tick, removed=[name]))
    assert not frame.visible
    show(view, tick)
    assert frame.visible


def test_another_scene_replaces_everything_of_the_last_one(view, tick):
    show(view, tick)
    before = nodes(view)
    show(view, tick, replace(SCENE, seed=5))
    assert nodes(view) == before


def test_every_shipped_scene_is_drawn(view):
    for listing in list_scenes():
        scene = load_scene(listing.name)
        show(view, tick_message(Twin(scene).advance(), run=1, server_time=0.0), scene)
        drawn = {name: piece.frame.name for name, piece in view._furniture._drawn.items()}
        assert set(drawn) == set(pieces(scene)), listing.name
        assert set(drawn.values()) <= set(view._server.scene._handle_from_node_name), listing.name
        assert any(name.startswith("/robot/") for name in nodes(view)), listing.name


def test_relative_costs_run_from_the_cheapest_to_the_dearest(tick):
    relative = relative_cost(tick.placement)
    viable = np.array([not reason for reason in tick.placement.rejected])
    assert (relative[viable].min(), relative[viable].max()) == (0.0, pytest.approx(1.0))
    assert np.isnan(relative[~viable]).all()
    assert tuple(colours.scale(np.array([0.0]))[0]) == (253, 231, 37)


@pytest.mark.parametrize(
    ("given", "drawn"), [("purple", (122, 63, 160)), ("#7a3fa1", (122, 63, 161)), ("pnik", (232, 22, 28))]
)
def test_a_cube_is_drawn_in_the_colour_that_its_scene_gives(given, drawn):
    """Purple, brown and all of `#rrggbb` were drawn red."""
    assert colours.of_cube(given) == drawn


def test_free_ground_is_clear_and_occupied_ground_is_dark_brown():
    table = colours.ground_table()
    assert table.shape == (256, 4) and table[0, 3] == 0
    red, green, blue, alpha = (int(value) for value in table[255])
    assert 200 > red > green > blue and alpha > 100


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
    np.testing.assert_allclose(solids_mesh([solid]).bounds, [(*low, 0.0), (*high, 0.6)], atol=0.003)


def test_a_bump_is_drawn_as_wide_and_high_as_wheels_meet_it():
    bump = Bump(name="b", centre=(1.0, 2.0), length=0.8, yaw=math.pi / 2, width=0.1, height=0.01)
    np.testing.assert_allclose(bump_mesh([bump]).bounds, [(0.95, 1.6, 0.0), (1.05, 2.4, 0.01)], atol=1e-3)


def test_a_shelf_of_one_board_is_drawn():
    shape = Box(centre=(1.0, 2.0), size=(0.8, 0.4))
    board = Solid(name="s", shape=shape, z_min=0.6, z_max=0.63, mapped=True, style="shelf")
    assert solids_mesh([board]).bounds[:, 2] == pytest.approx([0.6, 0.63])


def test_a_bin_is_open_and_stands_where_it_belongs():
    box = SCENE.bins[0]
    scene = bin_mesh(box)
    middle = (scene.bounds[0] + scene.bounds[1]) / 2
    np.testing.assert_allclose(middle[:2], box.centre, atol=1e-6)
    assert scene.bounds[:, 2] == pytest.approx([box.floor_z, box.rim_z])
    down = trimesh.util.concatenate(scene.dump()).ray.intersects_location([(*box.centre, 2.0)], [(0.0, 0.0, -1.0)])[0]
    assert down[:, 2].max() == pytest.approx(box.floor_z + box.wall)


def test_a_loose_box_has_its_size():
    np.testing.assert_allclose(loose_box_mesh((0.4, 0.3, 0.6)).extents, (0.4, 0.3, 0.6), atol=0.003)


def test_the_floor_covers_the_map_and_goes_over_into_the_ground_around():
    picture, (x, y, u, v) = light.floor(SCENE)
    assert u - x == SCENE.bounds[2] - SCENE.bounds[0] + 2 * light.MARGIN
    assert np.abs(picture[0, 0] - light.ground_tone(np.array(0.5 * math.hypot(u - x, v - y)))).max() < 1.5
    for mesh in (light.floor_glb(SCENE), light.ground_glb((1.0, 2.0)), light.sky_glb((1.0, 2.0))):
        assert mesh[:4] == b"glTF"


def test_what_shines_by_itself_is_seen_as_wanted():
    wanted = np.repeat(np.array([40.0, 120.0, 200.0, 226.0])[:, None], 3, axis=1)
    code = light.before_tone_curve(wanted) / 255.0
    linear = np.where(code < 0.04045, code / 12.92, ((code + 0.055) / 1.055) ** 2.4)
    assert np.abs(light.on_screen(linear) - wanted).max() < 1.0


def test_a_shadow_lies_under_its_body_and_away_from_the_sun():
    mesh = trimesh.load_scene(trimesh.util.wrap_as_stream(light.box_shadow_glb(0.4, 0.4, 1.0)), file_type="glb")
    low, high = mesh.bounds
    assert (low[:2] < -0.2).all() and (high[:2] > 0.2).all()
    assert high[0] > 0.2 + light.SHADOW_SHIFT[0]


def test_silhouettes_are_few_and_keep_off_the_robot_the_arrival_and_each_other():
    line = np.array([(0.05 * i, 0.0, 0.0) for i in range(100)])
    poses = silhouette_poses(line, np.array([4.95, 0.0, 0.0]))
    assert len(poses) == SILHOUETTES
    assert poses[0, 0] >= FREE - 1e-9 and np.diff(poses[:, 0]).min() >= APART - 1e-9
    assert poses[-1, 0] <= 4.95 - APART
    for short in (np.zeros((0, 3)), np.zeros((5, 3)), line[:10]):
        assert len(silhouette_poses(short, None)) == 0


@pytest.mark.parametrize("base", [(0.0, 0.0, 0.0), (1.0, -2.0, 2.5), (-0.5, 0.3, -1.2)])
@pytest.mark.parametrize("away", [(0.55, 0.2, 0.75), (-0.1, 0.6, 0.8), (0.5, -0.4, 0.5)])
def test_the_arm_of_the_ghost_reaches_for_the_target_from_above(base, away):
    kinematics, base = Frankie(RobotProfile()), np.array(base)
    c, s = math.cos(base[2]), math.sin(base[2])
    point = np.array([base[0] + c * away[0] - s * away[1], base[1] + s * away[0] + c * away[1], away[2]])
    position, rotation = kinematics.tcp_pose(base, reaching(kinematics, base, point))
    assert np.linalg.norm(position - point) < 0.03
    assert rotation[2, 2] < -0.9


def test_dashes_leave_gaps_and_end_where_the_line_ends():
    line = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], dtype=np.float32)
    pieces = dashes(line)
    drawn = np.linalg.norm(pieces[:, 1] - pieces[:, 0], axis=1).sum()
    assert 0.8 < drawn < 1.2
    assert np.linalg.norm(pieces, axis=2).max() <= math.sqrt(2.0) + 1e-6
    assert dashes(line[:2] * 0.01).shape[1:] == (2, 2)


def test_points_to_drive_to_are_read_from_the_tasks_that_are_left(tick):
    drive = replace(tick.tasks[0], kind="drive_to", target="(1.50, -0.25)", status="waiting")
    assert drive_points(replace(tick, tasks=[drive, *tick.tasks], task_index=0)) == [(1.5, -0.25)]
    assert drive_points(replace(tick, tasks=[drive, *tick.tasks], task_index=1)) == []


def test_beliefs_are_marked_only_where_they_are_off(tick):
    item = tick.objects[0]
    for off, count in ((0.004, 0), (0.02, 1)):
        belief = replace(tick.beliefs[0], name=item.name, position=[p + off for p in item.position])
        assert believed(replace(tick, beliefs=[belief])).shape == (count, 3)


def test_the_target_is_marked_where_the_robot_believes_it(tick):
    surroundings, item = Surroundings(SCENE), tick.objects[0]
    surroundings.update(tick)
    picks = [task for task in tick.tasks if task.kind == "pick" and task.target == item.name]
    assert picks, "the first cube is to be picked"
    active = replace(tick, task_index=tick.tasks.index(picks[0]))
    off = [item.position[0] + 0.3, item.position[1] - 0.1, item.position[2] + 0.05]
    belief = replace(tick.beliefs[0], name=item.name, position=off)
    spot = target_spot(replace(active, beliefs=[belief]), surroundings)
    assert (spot.x, spot.y, spot.z) == pytest.approx((off[0], off[1], off[2] - 0.5 * item.size[0]))
    known = target_spot(replace(active, beliefs=[]), surroundings)
    assert (known.x, known.y) == pytest.approx(tuple(item.position[:2]))


def test_hits_of_the_lidar_stand_where_the_beams_have_ended():
    scan = SimpleNamespace(
        pose=[1.0, 2.0, math.pi / 2], origin=[0.3, 0.0], angle_min=-math.pi / 2, angle_step=math.pi / 2,
        ranges=[2.0, None, 1.0],
    )  # fmt: skip
    assert hits(scan, 0.2) == pytest.approx(np.array([[3.0, 2.3, 0.2], [0.0, 2.3, 0.2]]))


def test_the_knob_lets_go_of_what_it_turned_wherever_the_pointer_ends(view, tick):
    """A gesture that ended above the horizon, or after another selection, held the body and the lease for good."""
    selection, drag, name = view._selection, view._drag, tick.agents[0].name
    sent = []
    view._hub.command = lambda _, command: sent.append(command) or Answer(ok=True)
    show(view, tick, SCENE)
    selection.update(name, tick, view._surroundings, live=True)
    eye = SimpleNamespace(camera=SimpleNamespace(position=(0.0, 0.0, 5.0)))
    visitor = SimpleNamespace()
    view._hub.refusal = lambda _: ""

    def gesture(phase, z):
        event = SimpleNamespace(
            phase=phase, client_id=1, client=eye, start_position=(0, 0, 0), end_position=(1.0, 0.0, z)
        )
        selection._turn(event, visitor)

    gesture("start", 0.0)
    gesture("update", 0.0)
    assert not drag.held(name).free
    selection.update("", tick, view._surroundings, live=True)
    gesture("end", 9.0)
    assert drag.held(name) is None or drag.held(name).free
    until(lambda: any(isinstance(command, ReleaseBody) and command.name == name for command in sent))


def test_a_refused_turn_is_sent_once_and_stops_nobody_else(view, tick):
    drag, name, sent = view._drag, tick.agents[0].name, []

    def refuse(_, command):
        sent.append(command)
        return Answer(ok=False, reason="no")

    view._hub.command, view._hub.refusal = refuse, lambda _: ""
    one, other = (SimpleNamespace(client_id=k, phase="update") for k in (1, 2))
    drag.turn(name, SimpleNamespace(), (1, SELECTION), (0.0, 0.0), 1.0)
    until(lambda: drag.held(name) is None)
    assert len(sent) == 1
    assert not drag.allowed(SELECTION, one, None)
    assert drag.allowed(name, other, None)
