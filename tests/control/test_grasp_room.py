"""The hand looks beside the object: which faces it takes, and when there is room for none."""

import math

import numpy as np
import pytest

from motm_twin.control.arm.geometry import tool_rotation
from motm_twin.control.arm.grasp_room import BLOCKED, GraspRoom, height_over
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.control.arm.types import ArmGoal
from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Box, Solid

TOP = 0.75
NO_TURN = np.zeros(3)


def known(*pieces):
    """A table top with pieces (x, y, size x, size y, height) on it."""
    solids = [Solid(name="table", shape=Box(centre=(0.0, 0.0), size=(2.0, 2.0)), z_min=0.72, z_max=TOP, mapped=True)]
    for k, (x, y, a, b, height) in enumerate(pieces):
        shape = Box(centre=(x, y), size=(a, b))
        solids.append(Solid(name=f"piece{k}", shape=shape, z_min=TOP, z_max=TOP + height, mapped=True))
    return KnownWorld(
        robot=RobotProfile(),
        start=(0.0, 0.0, 0.0),
        solids=tuple(solids),
        objects=(),
        object_sd=0.03,
        bins=(),
        tasks=(),
        bounds=(-3.0, -3.0, 3.0, 3.0),
    )


def goal(*others, yaw=0.0, seen=1.0):
    near = [(x, y, TOP + 0.02, turn, 0.04, seen) for x, y, turn in others]
    return ArmGoal(
        kind="pick",
        name="it",
        position=np.array([0.0, 0.0, TOP + 0.02]),
        yaw=yaw,
        side=0.04,
        position_sd=0.003,
        last_seen=0.0,
        neighbours=np.array(near).reshape(-1, 6),
        neighbour_names=tuple(f"c{k}" for k in range(len(near))),
    )


def chosen(place, target, near=0.0, T=NO_TURN, natural=None, width=0.08, sd=0.003):
    natural = near if natural is None else natural
    return GraspRoom(place, AvoidanceParameters()).yaw(target, near, natural, width, T, sd)


@pytest.mark.parametrize("near", [0.0, 0.3, -0.4])
def test_faces_nearest_to_the_natural_yaw_are_taken_where_nothing_is_near(near):
    yaw, room = chosen(known(), goal(), near)
    assert yaw == 0.0
    assert room.what == ""


@pytest.mark.parametrize("gap", [0.005, 0.02, 0.03, 0.04])
@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_other_faces_are_taken_where_a_cube_stands_in_the_way_of_a_finger(gap, side):
    """The fingers close along y at a yaw of 0."""
    yaw, room = chosen(known(), goal((0.0, side * (0.04 + gap), 0.0)))
    assert abs(yaw) == pytest.approx(math.pi / 2)
    assert not room.blocked
    yaw, _ = chosen(known(), goal((side * (0.04 + gap), 0.0, 0.0)))
    assert yaw == 0.0


@pytest.mark.parametrize("piece", [(0.0, 0.07, 0.05, 0.05, 0.3), (0.0, -0.075, 0.3, 0.02, 0.05)])
def test_the_other_faces_are_taken_beside_a_post_or_a_rim(piece):
    yaw, room = chosen(known(piece), goal())
    assert abs(yaw) == pytest.approx(math.pi / 2)
    assert not room.blocked


def test_a_palm_needs_room_beside_high_furniture_and_passes_over_low():
    low, high = (0.0, 0.15, 0.05, 0.05, 0.005), (0.0, 0.15, 0.05, 0.05, 0.3)
    assert chosen(known(low), goal())[0] == 0.0
    assert abs(chosen(known(high), goal())[0]) == pytest.approx(math.pi / 2)


def test_between_cubes_on_all_sides_there_is_no_room():
    step = 0.045
    around = [(step * i, step * j, 0.0) for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)]
    _, room = chosen(known(), goal(*around))
    assert room.blocked
    assert room.cost > BLOCKED
    assert room.what.startswith("c")


def test_a_pair_that_localisation_may_open_is_no_reason_to_give_up():
    """Between a cube and a box that localisation had 2 cm too near, a pick was given up within a second."""
    place, target = known((0.055, 0.0, 0.05, 0.05, 0.3)), goal((0.0, 0.055, 0.0))
    _, room = chosen(place, target, sd=0.02)
    assert room.blocked and not room.closed
    assert room.what == "piece0"
    assert chosen(place, target)[1].closed, "a robot that knows its place knows better"


def test_fingers_that_open_less_have_room_beside_furniture():
    """A tin beside a cube, 3 cm from its face: fingers wide open were in it whatever their width."""
    place = known((0.0, 0.07, 0.16, 0.04, 0.03), (0.07, 0.0, 0.04, 0.04, 0.3))
    assert chosen(place, goal())[1].blocked
    _, room = chosen(place, goal(), width=0.052)
    assert not room.blocked


def test_what_the_robot_does_not_know_of_its_place_is_kept_from_furniture_in_addition():
    place = known((0.0, 0.145, 0.3, 0.04, 0.3), (0.145, 0.0, 0.04, 0.3, 0.3))
    assert chosen(place, goal(), sd=0.0)[1].what == ""
    assert chosen(place, goal(), sd=0.02)[1].what != ""


def test_a_neighbour_that_nobody_has_seen_costs_but_does_not_block():
    _, room = chosen(known(), goal((0.045, 0.0, 0.0), (0.0, 0.045, 0.0), seen=0.0))
    assert not room.blocked
    assert room.what


@pytest.mark.parametrize(("natural", "yaw"), [(0.9, 1.0), (-0.9, -1.0)])
def test_the_hand_turns_to_the_other_faces_from_the_side_of_its_natural_yaw(natural, yaw):
    """Else it turned by a quarter each time that the faces changed, until joint 7 was at its end."""
    assert chosen(known(), goal((0.0, 0.06, 0.0)), natural=natural)[0] == pytest.approx(yaw * math.pi / 2)


def test_an_object_seen_a_little_too_low_is_in_the_way_all_the_same():
    target = goal((0.0, 0.08, 0.0))
    target.neighbours[0, 2] -= 0.008
    assert abs(chosen(known(), target)[0]) == pytest.approx(math.pi / 2)


def test_the_choice_is_the_same_in_every_odometry_frame():
    T = np.array([1.0, -2.0, 0.7])
    c, s = math.cos(0.7), math.sin(0.7)
    post = known((0.0, 0.07, 0.05, 0.05, 0.3))
    turned = ArmGoal(
        kind="pick",
        name="it",
        position=np.array([1.0, -2.0, TOP + 0.02]),
        yaw=0.7,
        side=0.04,
        position_sd=0.003,
        last_seen=0.0,
        neighbours=np.array([[1.0 + 0.06 * c, -2.0 + 0.06 * s, TOP + 0.02, 0.7, 0.04, 1.0]]),
        neighbour_names=("c0",),
    )
    yaw, room = chosen(post, goal((0.06, 0.0, 0.0)))
    other, room_there = chosen(post, turned, 0.7, T)
    assert other - 0.7 == pytest.approx(yaw)
    assert room_there.cost == pytest.approx(room.cost)


@pytest.mark.parametrize(
    ("place", "yaw", "low"),
    [
        ((0.0, 0.0), 0.0, True),  # as it grasps: the neighbour is beside the fingers, not below them
        ((0.0, 0.0), math.pi / 2, False),  # not yet turned: a finger over the neighbour
        ((0.05, 0.05), 0.0, False),  # not yet there
        ((0.0, 0.025), 0.0, False),  # a finger over the object itself
        ((0.0, 0.0), 0.3, True),
    ],
)
def test_the_hand_comes_down_only_where_no_finger_comes_down_on_an_object(place, yaw, low):
    target = goal((0.055, 0.0, 0.0))
    height = height_over(np.array([[*place, TOP + 0.1]]), tool_rotation(yaw, 0.0, 0.0), 0.08, target)
    assert (height < TOP + 0.02) == low
    assert height < TOP + 0.02 + 0.06, "hovering it is over all of them"


def test_an_object_that_nobody_has_seen_does_not_keep_the_hand_up():
    over, down = np.array([[0.0, 0.0, TOP + 0.1]]), tool_rotation(0.0, 0.0, 0.0)
    assert height_over(over, down, 0.08, goal((0.0, 0.055, 0.0), seen=0.0)) == -math.inf


@pytest.mark.parametrize(
    ("piece", "top"),
    [
        ((-0.3, 0.0, 0.06, 1.0, 0.15), 0.15),  # a ledge across the way
        ((-0.3, 0.07, 0.06, 0.06, 0.15), 0.15),  # a finger meets it
        ((-0.3, 0.2, 0.06, 0.06, 0.15), None),  # beside the way
        ((0.0, 0.09, 0.1, 0.04, 0.15), None),  # beside the target, where the hand comes down
        ((0.3, 0.0, 0.06, 1.0, 0.15), None),  # beyond it
        ((-0.3, 0.0, 0.06, 1.0, 0.01), None),  # lower than the target
        ((-0.3, 0.0, 0.06, 1.0, 0.5), None),  # too high to get over
    ],
)
def test_the_hand_knows_the_top_of_what_is_on_its_way_to_the_target(piece, top):
    room, here, target = GraspRoom(known(piece), AvoidanceParameters()), np.array([-0.5, 0.0, 0.9]), goal().position
    assert room.top_between(here, target, NO_TURN) == pytest.approx(-math.inf if top is None else TOP + top)
    if top is not None:
        past = np.array([-0.2, 0.0, 0.95])
        assert room.top_between(past, target, NO_TURN) == -math.inf


@pytest.mark.parametrize(("x", "z", "top"), [(0.6, 0.85, TOP), (1.03, 0.85, TOP), (1.1, 0.85, None), (0.6, 0.6, None)])
def test_a_hand_over_a_table_keeps_over_it_however_low_its_target_is(x, z, top):
    """On its way to a bin 0.35 m lower it sank into a tray that it swung across, and stood there for 5 s."""
    room, target = GraspRoom(known(), AvoidanceParameters()), np.array([1.3, 0.0, 0.2])
    assert room.top_between(np.array([x, 0.0, z]), target, NO_TURN) == (-math.inf if top is None else top)


@pytest.mark.parametrize(("outward", "higher"), [(math.pi, True), (0.0, False)])
def test_a_tilted_palm_clears_an_object_that_is_higher_than_its_target(outward, higher):
    """Tilted by 9 deg, the palm came down 4 mm into a cube 1 cm higher than the one between the fingers."""
    target = goal((0.1, 0.0, 0.0))
    target.neighbours[0, 2:5] = (TOP + 0.025, 0.0, 0.05)
    grasp, quarter = np.array([0.0, 0.0, TOP + 0.02]), math.pi / 2
    level, tilted = (
        height_over(grasp[None], tool_rotation(quarter, tilt, outward), 0.055, target) - grasp[2]
        for tilt in (0.0, math.radians(9.0))
    )
    assert 0.0 < level < 0.008, "level, the palm has room a little above the middle of the target"
    assert (tilted > level + 0.07 * math.sin(math.radians(9.0))) == higher
    assert not GraspRoom(known(), AvoidanceParameters()).room(target, quarter, 0.055, NO_TURN, 0.0).blocked


@pytest.mark.parametrize("tilt", [-0.6, -0.3, 0.0, 0.3, 0.6])
def test_a_hand_tilted_across_its_fingers_comes_down_only_where_the_tips_clear_the_object(tilt):
    """Tilted by 33 deg, a hand hovered 4 s with its lower finger 5 mm in the cube: seen from above it had room."""
    free = []
    for off in np.linspace(-0.03, 0.03, 61):
        tool = np.array([0.0, off, TOP + 0.02])
        R = tool_rotation(0.0, tilt, math.pi / 2)
        tips = [tool + R @ np.array([0.0, side * 0.04, 0.009]) for side in (1.0, -1.0)]
        if height_over(tool[None], R, 0.08, goal()) == -math.inf:
            free.append(off)
            assert all(abs(tip[1]) > 0.02 for tip in tips)
    assert len(free) > 4, "in the middle there is room"


@pytest.mark.parametrize("tilt", [1.4, 1.575, 1.58, 1.8])
def test_a_hand_that_lies_on_its_side_over_an_object_is_not_told_to_rise_without_bound(tilt):
    tool, R = np.array([[0.0, 0.0, TOP + 0.1]]), tool_rotation(0.0, tilt, 0.0)
    assert abs(height_over(tool, R, 0.08, goal((-0.04, 0.09, 0.0))) - TOP) < 0.1
