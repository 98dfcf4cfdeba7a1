import math

import numpy as np
import pytest
from edit_scenes import TABLE_TOP, body, room
from sim_hands import DOWN, act, cube_of, grasp, over_a_cube
from sim_scenes import box, scene

from motm_twin.model.edits import AddObstacle, MoveBody, MoveObject, RemoveBody
from motm_twin.model.geometry import from_frame
from motm_twin.model.scene import Agent, Bin, Pick, Place
from motm_twin.model.scene_shapes import pieces, rigid
from motm_twin.sim.plant import SimulatedPlant


def scan_of(plant):
    plant.step(0.05)
    return plant.observe().scan.ranges.copy()


def test_a_piece_is_moved_and_turned_with_what_stands_on_it():
    plant = SimulatedPlant(room())
    before = {name: np.array(cube_of(plant, name).position) for name in ("cube1", "cube2")}
    plant.apply(MoveBody(name="table", x=1.0, y=-3.0, heading=math.pi / 3))
    plant.step(0.5)
    transform = rigid(pieces(plant.scene)["table"], (1.0, -3.0, math.pi / 3))
    for name, position in before.items():
        cube = cube_of(plant, name)
        np.testing.assert_allclose(cube.position, from_frame(transform, position), atol=1e-12)
        assert cube.state == "resting"
    assert cube_of(plant, "cube1").yaw == pytest.approx(0.3 + math.pi / 3)
    (piece,) = plant.truth().furniture
    assert (piece.name, piece.kind, piece.position, piece.yaw) == ("table", "furniture", (1.0, -3.0, 0.0), math.pi / 3)
    assert piece.size == pytest.approx((1.6, 0.8, TABLE_TOP))
    assert plant.truth().plant_faults == ()


def test_many_small_moves_end_where_one_move_does():
    one, many = SimulatedPlant(room()), SimulatedPlant(room())
    one.apply(MoveBody(name="table", x=1.0, y=-3.0, heading=1.0))
    for k in range(1, 101):
        share = k / 100
        many.apply(MoveBody(name="table", x=3.0 - 2.0 * share, y=2.0 - 5.0 * share, heading=share))
    np.testing.assert_allclose(cube_of(one, "cube2").position, cube_of(many, "cube2").position, atol=1e-9)


def test_a_moved_piece_is_where_the_lidar_sees_it_and_no_longer_where_it_was():
    plant = SimulatedPlant(scene(solids=room().solids))
    plant.apply(MoveBody(name="cabinet", x=1.5, y=0.0))
    ranges = scan_of(plant)
    assert ranges[360] == pytest.approx(1.3)
    gone = SimulatedPlant(scene(solids=tuple(s for s in room().solids if s.name != "cabinet")))
    gone.apply(AddObstacle(name="copy", x=1.5, y=0.0, size=(0.4, 0.4, 0.8)))
    np.testing.assert_allclose(ranges, scan_of(gone), atol=1e-9)


def test_a_heading_of_none_keeps_the_turn_of_a_piece():
    plant = SimulatedPlant(room())
    plant.apply(MoveBody(name="table", x=1.0, y=-3.0, heading=0.5))
    plant.apply(MoveBody(name="table", x=2.0, y=-3.0))
    assert plant.truth().furniture[0].yaw == 0.5


def test_a_cube_in_the_gripper_does_not_ride_on_a_table_that_is_pulled_away():
    plant = grasp(over_a_cube())
    held = cube_of(plant)
    assert held.state == "held"
    plant.apply(MoveBody(name="stand", x=3.0, y=3.0))
    plant.step(0.2)
    assert cube_of(plant).state == "held"
    np.testing.assert_allclose(cube_of(plant).position, held.position, atol=1e-9)


def test_a_stack_rides_along_and_a_binned_cube_stays_binned():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=3.0, y=-2.0))
    plant.apply(MoveObject(name="cube2", x=3.0, y=-2.0))
    assert [item.state for item in plant.truth().objects] == ["binned:bin", "binned:bin"]
    plant.apply(MoveBody(name="stand", x=0.0, y=-3.0, heading=0.4))
    plant.step(0.2)
    for item, z in zip(plant.truth().objects, (0.64, 0.68), strict=True):
        np.testing.assert_allclose(item.position, (0.0, -3.0, z), atol=1e-9)
        assert item.state == "binned:bin"


@pytest.mark.parametrize("brought", [True, False])
def test_a_delivery_counts_where_the_bin_is_now_and_not_where_it_was(brought):
    """The hand drops the cube at one place; the bin is brought there, or taken from there."""
    x, y, _ = cube_of(over_a_cube()).position
    here, away = (x, y), (x, y + 2.0)
    start, target = (away, here) if brought else (here, away)
    plant = over_a_cube(
        bins=(Bin(name="bin", centre=start, floor_z=0.15, rim_z=0.25),),
        solids=(box("shelf", start, (0.5, 0.5), 0.13),),
        tasks=(Pick(object="cube"), Place(bin="bin")),
    )
    grasp(plant, lift=0.05)
    plant.apply(RemoveBody(name="stand"))
    plant.apply(MoveBody(name="shelf", x=target[0], y=target[1], heading=0.3))
    plant.command(act(gripper="open"))
    plant.step(1.5)
    assert plant.truth().picks == 1
    assert plant.truth().places == int(brought)
    assert plant.truth().drops == int(not brought)
    assert cube_of(plant).state == ("binned:bin" if brought else "dropped")


def test_furniture_that_carries_something_cannot_be_removed_and_says_what_stands_on_it():
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="'table' cannot be removed: cube1 and cube2 stand on it"):
        plant.apply(RemoveBody(name="table"))
    with pytest.raises(ValueError, match="bin stands on it"):
        plant.apply(RemoveBody(name="stand"))
    plant.apply(MoveObject(name="cube1", x=-2.0, y=2.0))
    plant.apply(MoveObject(name="cube2", x=1.0, y=3.0))
    plant.apply(RemoveBody(name="table"))
    truth = plant.truth()
    assert truth.removed == ("table",)
    with pytest.raises(ValueError, match="not an agent"):
        plant.apply(MoveBody(name="table", x=0.0, y=0.0))
    with pytest.raises(ValueError, match="taken"):
        plant.apply(AddObstacle(name="table", x=0.0, y=0.0))


def test_removed_pieces_loose_boxes_and_agents_are_named():
    plant = SimulatedPlant(room())
    for name in ("cabinet", "crate", "temi"):
        plant.apply(RemoveBody(name=name))
    assert plant.truth().removed == ("cabinet", "crate", "temi")
    assert plant.truth().agents == ()
    plant.apply(MoveBody(name="table", x=5.0, y=2.0))
    scan = scan_of(plant)
    empty = SimulatedPlant(scene(solids=tuple(s for s in room().solids if s.name in ("stand", "slab", "post"))))
    empty.apply(MoveBody(name="table", x=5.0, y=2.0))
    np.testing.assert_array_equal(scan, scan_of(empty))


def test_a_loose_box_stays_a_loose_box_and_carries_cubes_like_furniture():
    plant = SimulatedPlant(room())
    plant.apply(MoveObject(name="cube1", x=-2.0, y=-2.0))
    plant.apply(MoveBody(name="crate", x=-1.0, y=-3.0, heading=0.5))
    plant.step(0.1)
    crate = body(plant, "crate")
    assert (crate.kind, crate.position, crate.yaw) == ("box", (-1.0, -3.0, 0.0), 0.5)
    np.testing.assert_allclose(cube_of(plant, "cube1").position, (-1.0, -3.0, 0.62), atol=1e-9)
    assert plant.truth().furniture == ()


def test_parts_of_a_piece_are_not_moved_alone_and_near_names_are_given():
    plant = SimulatedPlant(room())
    with pytest.raises(ValueError, match="not an agent"):
        plant.apply(MoveBody(name="slab", x=0.0, y=0.0))
    with pytest.raises(ValueError, match="did you mean table"):
        plant.apply(MoveBody(name="tabel", x=0.0, y=0.0))


def test_agents_go_round_furniture_where_it_stands_now():
    agent = Agent(name="temi", start=(-1.0, 3.5, 0.0), waypoints=((4.0, 3.5), (-1.0, 3.5)))
    plant = SimulatedPlant(room(agents=(agent,)))
    plant.apply(MoveBody(name="cabinet", x=1.0, y=3.5))
    farthest = -1.0
    for _ in range(300):
        plant.step(0.1)
        x, y, _ = body(plant, "temi").position
        farthest = max(farthest, x)
        assert math.hypot(max(abs(x - 1.0) - 0.2, 0.0), max(abs(y - 3.5) - 0.2, 0.0)) > 0.25
    assert farthest > 3.5


def test_the_camera_does_not_see_through_furniture_that_was_put_in_between():
    plant = over_a_cube(offset=(0.0, 0.0, 0.3))
    plant.step(0.05)
    assert plant.observe().detections
    x, y, z = cube_of(plant).position
    plant.apply(AddObstacle(name="lid", x=x, y=y, size=(0.3, 0.3, z + 0.1)))
    plant.step(0.05)
    assert plant.observe().detections == ()


def test_hand_of_the_robot_meets_a_moved_table_where_it_is():
    plant = SimulatedPlant(scene(solids=room().solids), arm_start=DOWN)
    plant.step(0.1)
    assert plant.truth().contacts == ()
    plant.apply(MoveBody(name="cabinet", x=0.6, y=0.0))
    plant.step(0.05)
    assert {item.other for item in plant.truth().contacts} == {"cabinet"}


def test_furniture_that_was_moved_is_in_no_map_until_it_is_announced_there():
    plant = SimulatedPlant(room())
    others = plant.truth().ee_obstacle
    pose = (1.6, 1.4, 0.2)
    plant.apply(MoveBody(name="table", x=pose[0], y=pose[1], heading=pose[2]))
    plant.step(0.1)
    assert plant.truth().ee_obstacle < others - 0.5
    plant.expect_map({"table": pose})
    plant.step(0.1)
    assert plant.truth().ee_obstacle == others
    plant.apply(MoveBody(name="table", x=pose[0], y=pose[1] + 0.2, heading=pose[2]))
    plant.step(0.1)
    assert plant.truth().ee_obstacle < others - 0.5
