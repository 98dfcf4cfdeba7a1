"""The commands of the Disturb tab, from what is shown, and free places for new bodies."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.bus.client import Grid
from motm_twin.bus.commands import AddObstacle, FreezeBody, MoveBody, MoveObject, RemoveBody, check_command
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import GRID_VERSION, BodyMessage, GridInfo
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_shapes import pieces
from motm_twin.twin import Twin
from motm_twin.ui.panel import disturb
from motm_twin.ui.panel.disturb import NEAREST, free_place, is_free


@pytest.fixture(scope="module")
def scene():
    return load_scene("exp2", "random", 0)


@pytest.fixture(scope="module")
def tick(scene):
    return tick_message(Twin(scene).advance(), run=1, server_time=0.0)


def body(name, kind, state="standing", place=(1.0, 2.0, 0.0), yaw=0.3):
    return BodyMessage(name=name, kind=kind, position=list(place), yaw=yaw, state=state, size=[0.5, 0.5, 1.0])


def with_(tick, **changes):
    return msgspec.structs.replace(tick, **changes)


def test_everything_in_the_scene_can_be_selected(scene, tick):
    listed = disturb.things(scene, tick)
    kinds = {kind: {thing.name for thing in listed.values() if thing.kind == kind} for kind in ("agent", "piece")}
    assert kinds == {"agent": {agent.name for agent in scene.agents}, "piece": set(pieces(scene))}
    assert {item.name for item in scene.objects} <= set(listed)
    gone = next(iter(pieces(scene)))
    assert gone not in disturb.things(scene, with_(tick, removed=[gone]))


@pytest.mark.parametrize("kind", disturb.SIZES)
def test_new_bodies_have_names_of_their_own_and_are_taken_by_the_server(scene, tick, kind):
    first, _ = disturb.new_body(kind, scene, tick, None)
    second, _ = disturb.new_body(kind, scene, with_(tick, obstacles=[body(first.name, kind)]), None)
    assert first.name != second.name and first.shape == kind
    check_command(first)


def test_bodies_are_turned_where_they_stand(scene, tick):
    shown = with_(tick, obstacles=[body("box 1", "box")])
    thing = disturb.things(scene, shown)["box 1"]
    command = disturb.turned(thing, scene, shown, disturb.TURN)
    assert command == MoveBody(name="box 1", x=1.0, y=2.0, heading=0.3 + disturb.TURN, held=False)
    assert disturb.turned(thing, scene, tick, disturb.TURN) is None


def test_furniture_is_turned_from_how_the_scene_has_it(scene, tick):
    name, piece = next(iter(pieces(scene).items()))
    thing = disturb.things(scene, tick)[name]
    first = disturb.turned(thing, scene, tick, disturb.TURN)
    assert first == MoveBody(name=name, x=piece.centre[0], y=piece.centre[1], heading=disturb.TURN, held=False)
    moved = with_(tick, furniture=[body(name, "piece", place=(3.0, 1.0, 0.0), yaw=disturb.TURN)])
    again = disturb.turned(thing, scene, moved, disturb.TURN)
    assert (again.x, again.y) == (3.0, 1.0) and again.heading == pytest.approx(2 * disturb.TURN)


def test_pushes_are_as_seen_from_the_robot(tick):
    robot = msgspec.structs.replace(tick.robot, true_pose=[0.0, 0.0, math.pi / 2])
    left = disturb.pushed(with_(tick, robot=robot), "◀ Left")
    assert (left.dx, left.dy) == (pytest.approx(-disturb.PUSH), pytest.approx(0.0))
    for way in disturb.PUSHES:
        check_command(disturb.pushed(tick, way))


def test_cubes_go_before_the_robot_and_back(scene, tick):
    item = scene.objects[0]
    assert disturb.put_back(item.name, scene) == MoveObject(name=item.name, x=item.position[0], y=item.position[1])
    assert disturb.put_back("no cube", scene) is None
    front = disturb.put_in_front(item.name, tick)
    x, y, heading = tick.robot.true_pose
    ahead = (front.x - x) * math.cos(heading) + (front.y - y) * math.sin(heading)
    assert ahead == pytest.approx(disturb.AHEAD)


def test_the_held_cube_is_known(tick):
    assert disturb.held_cube(tick) == ""
    assert disturb.held_cube(with_(tick, objects=[body("cube", "cube", "held")])) == "cube"


def test_clearing_takes_away_what_was_added_and_puts_furniture_back(scene, tick):
    assert disturb.cleared(scene, tick) == []
    own, (name, piece) = tick.agents[0], next(iter(pieces(scene).items()))
    agents = [msgspec.structs.replace(own, state="frozen"), *tick.agents[1:], body("temi 1", "temi")]
    shown = with_(tick, agents=agents, obstacles=[body("box 1", "box")], furniture=[body(name, "piece")])
    assert disturb.cleared(scene, shown) == [
        RemoveBody(name="box 1"),
        RemoveBody(name="temi 1"),
        FreezeBody(name=own.name, frozen=False),
        MoveBody(name=name, x=piece.centre[0], y=piece.centre[1], heading=0.0, held=False),
    ]


def test_an_added_body_is_an_edit_the_twin_takes(scene):
    twin = Twin(scene)
    tick = tick_message(twin.advance(), run=1, server_time=0.0)
    added, _ = disturb.new_body("box", scene, tick, None)
    twin.post(added)
    assert any(isinstance(edit, AddObstacle) for edit in twin.advance().edits)


def test_a_new_obstacle_comes_to_free_floor_away_from_others():
    cells = np.zeros((100, 100), dtype=np.uint8)
    cells[:, 60:] = 255  # x > 1 m is occupied
    about = {"version": GRID_VERSION, "run": 1, "encoding": "", "resolution": 0.05, "stamp": 0.0}
    grid = Grid(info=GridInfo(**about, origin=[-2.0, -2.0], width=100, height=100), cells=cells)
    taken = []
    for _ in range(4):
        x, y, _, _ = free_place([0.0, 0.0, math.pi], grid, taken)
        assert x < 0.62 and is_free(grid, (x, y))
        assert all(math.dist((x, y), other) > 0.7 for other in taken)
        taken.append((x, y))
    assert not is_free(grid, (0.9, 0.0)) and not is_free(grid, (9.0, 0.0))


def test_it_stands_on_the_way_and_says_so():
    place = free_place([0.0, 0.0, 0.0], None, [], way=[(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])
    assert (place.x, place.y) == pytest.approx((1.0, 0.5))
    assert place.where == "1.5 m in front of the robot, on its way"
    taken = free_place([0.0, 0.0, 0.0], None, [place[:2]], way=[(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])
    assert math.dist(taken[:2], place[:2]) > 0.7


def test_without_a_way_it_stands_before_the_robot_and_out_of_sight_only_when_nothing_else_is_left():
    before = free_place([0.0, 0.0, math.pi / 2], None, [])
    assert (before.x, before.y) == pytest.approx((0.0, 1.5)) and before.where == "1.5 m in front of the robot"
    seen = free_place([0.0, 0.0, 0.0], None, [], sees=lambda p: p[1] > 1.0)
    assert seen.y > 1.0
    looked_at = free_place([0.0, 0.0, 0.0], None, [], look_at=(9.0, 9.0), sees=lambda p: math.dist(p, (9, 9)) < 1)
    assert (looked_at.x, looked_at.y) == (9.0, 9.0) and looked_at.where == "in the middle of the view"
    assert free_place([0.0, 0.0, 0.0], None, [], sees=lambda _: False).x == 1.5
    for k in (-2.0, 0.0, 1.0):
        place = free_place([0.0, 0.0, 0.0], None, [], look_at=(0.2, 0.0), sees=lambda p, k=k: p[0] < k)
        assert math.hypot(*place[:2]) >= NEAREST
