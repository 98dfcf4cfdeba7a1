"""The arm side as a whole: it picks and places in passing, and stops when it must."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.control.arm.controller import Manipulator, _gave_way
from motm_twin.control.arm.geometry import planar_joints
from motm_twin.control.arm.motion import hand_motion
from motm_twin.control.arm.parameters import ArmParameters, numbers
from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles, Phase
from motm_twin.control.arm.view import ManipulatorState
from motm_twin.model.arm_kernels import CAPSULE_RADII, capsule_segments, fk_arm
from motm_twin.model.geometry import compose, inverse
from motm_twin.model.kinematics import Frankie
from motm_twin.model.known import known_world
from motm_twin.model.scene import Box, Solid
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant

from .arm_pass import Driver, Pass, run_pick, run_place

SCENE = load_scene("exp1", "trial1", 0)
CUBE = SCENE.objects[1]


def inputs_of(plant: SimulatedPlant, *, base_twist=(0.0, 0.0), obstacles=None, time_to_range=math.inf) -> ArmInputs:
    observation = plant.observe()
    goal = ArmGoal(
        kind="pick",
        name=CUBE.name,
        position=np.array(CUBE.position),
        yaw=0.0,
        side=0.04,
        position_sd=0.03,
        last_seen=None,
    )
    return ArmInputs(
        observation=observation,
        dt=0.01,
        goal=goal,
        base_twist=np.array(base_twist),
        time_to_range=time_to_range,
        plan_times=np.zeros(0),
        plan_poses=np.zeros((0, 5)),
        obstacles=obstacles or ArmObstacles(points=np.zeros((0, 2)), static=np.zeros(0, dtype=bool)),
        T_odom_world=compose(observation.odometry, inverse(observation.pose)),
    )


@pytest.mark.parametrize("phase", [Phase.TRANSIT, Phase.CARRY])
@pytest.mark.parametrize("above", [0.03, 0.12])
def test_a_low_hand_rises_before_it_withdraws(above, phase):
    """Held back by the lidar, it was laid on its side and swept its palm, or the cube in it, over the table."""
    plant, manipulator = SimulatedPlant(SCENE), Manipulator(known_world(SCENE))
    inputs, mount = inputs_of(plant, time_to_range=1.5), SCENE.robot.arm.mount_z
    height, p = CUBE.position[2] + above, manipulator.parameters
    q = planar_joints(0.8, height - mount, 0.6)
    observation = msgspec.structs.replace(inputs.observation, q=q, odometry=np.zeros(3))
    inputs = msgspec.structs.replace(
        inputs,
        observation=observation,
        goal=msgspec.structs.replace(inputs.goal, position=np.array([1.1, 0.2, CUBE.position[2]])),
        T_odom_world=np.zeros(3),
    )
    view = manipulator.look(inputs)
    state = ManipulatorState(phase=phase, clear_z=CUBE.position[2] + p.transit_clearance)
    velocity = hand_motion(state, view, inputs, p, numbers(p)).velocity
    if above < p.hover_height:
        assert velocity[2] > 0.1 and np.abs(velocity[:2]).max() < 0.3
    else:
        assert velocity[0] < -0.5


@pytest.mark.parametrize(("at", "over"), [((0.75, 0.0), True), ((1.0, 0.0), True), ((0.75, 0.4), False)])
@pytest.mark.parametrize("held", [False, True])
def test_a_hand_on_its_way_keeps_over_the_objects_that_it_crosses(at, over, held):
    """A plan came and went, the hand swung out and back, sank, and met a cube that was 0.3 m from its target."""
    plant, manipulator = SimulatedPlant(SCENE), Manipulator(known_world(SCENE))
    inputs, mount, z = inputs_of(plant, time_to_range=0.5), SCENE.robot.arm.mount_z, CUBE.position[2]
    other = (*at, z + 0.02, 0.3, 0.08, 1.0)
    goal = msgspec.structs.replace(
        inputs.goal, kind="place" if held else "pick", position=np.array([1.2, 0.0, z]), others=np.array([other])
    )
    observation = msgspec.structs.replace(
        inputs.observation, q=planar_joints(0.5, z + 0.04 - mount, 0.4), odometry=np.zeros(3)
    )
    inputs = msgspec.structs.replace(inputs, observation=observation, goal=goal, T_odom_world=np.zeros(3))
    p = manipulator.parameters
    state = ManipulatorState(phase=Phase.TRANSIT, holding="it" if held else "", side=0.04)
    motion = hand_motion(state, manipulator.look(inputs), inputs, p, numbers(p))
    assert motion.crosses == over
    if over:
        assert motion.reference[2] > z + 0.06 + (0.02 if held else 0.009), "its lower end clears the other's top"


@pytest.mark.parametrize(("above", "aside", "low"), [(0.025, 0.035, True), (0.06, 0.035, False), (0.025, 0.0, False)])
def test_a_hand_that_hangs_low_beside_its_own_object_rises_first_of_all(above, aside, low):
    """Pushed aside by furniture it sank by 3 cm below where it hovers, and a finger met the cube."""
    plant, manipulator = SimulatedPlant(SCENE), Manipulator(known_world(SCENE))
    inputs, z = inputs_of(plant, time_to_range=0.0), CUBE.position[2]
    q = planar_joints(0.65, z + above - SCENE.robot.arm.mount_z, 0.0)
    inputs = msgspec.structs.replace(
        inputs, observation=msgspec.structs.replace(inputs.observation, q=q, odometry=np.zeros(3)),
        T_odom_world=np.zeros(3),
    )  # fmt: skip
    hand, side = manipulator.look(inputs).p, np.array([0.0, aside, 0.0])
    goal = msgspec.structs.replace(inputs.goal, position=np.array([*hand[:2], z]) + side, side=0.045)
    inputs = msgspec.structs.replace(inputs, goal=goal)
    view, p = manipulator.look(inputs), manipulator.parameters
    state = ManipulatorState(phase=Phase.TRANSIT, yaw=0.0)
    assert hand_motion(state, view, inputs, p, numbers(p)).crosses == low


@pytest.mark.parametrize(("top", "clears"), [(0.05, True), (-0.2, False), (0.5, False)])
def test_a_hand_on_its_way_home_clears_furniture_that_is_higher_than_where_it_was(top, clears):
    """From a low bin it came home against the side of a higher one, and the base that turned dragged it along that."""
    plant, z = SimulatedPlant(SCENE), CUBE.position[2]
    post = Solid(name="post", shape=Box(centre=(0.65, 0.0), size=(0.1, 0.1)), z_min=0.0, z_max=z + top, mapped=True)
    manipulator = Manipulator(msgspec.structs.replace(known_world(SCENE), solids=(post,), bins=()))
    q = planar_joints(0.8, z - SCENE.robot.arm.mount_z, 0.3)
    inputs = inputs_of(plant)
    observation = msgspec.structs.replace(inputs.observation, q=q, odometry=np.zeros(3))
    manipulator.step(msgspec.structs.replace(inputs, observation=observation, T_odom_world=np.zeros(3)))
    assert (manipulator.snapshot().clear_z >= z + top + manipulator.parameters.transit_clearance) == clears


def straight(v: float, lateral: float) -> Pass:
    x, y, _ = CUBE.position
    return Pass(start=(x - 1.4, y - lateral, 0.0), twist=lambda t: (v, 0.0), object=CUBE.name, time=9.0)


@pytest.mark.parametrize(("v", "lateral"), [(0.5, 0.6), (0.4, 0.7), (0.3, 0.65)])
def test_a_cube_is_picked_while_the_base_drives_by(v, lateral):
    result = run_pick(SCENE, straight(v, lateral))
    assert result.picked and result.held
    assert result.missed == 0 and result.contacts == [] and result.faults == () and result.stops == 0
    assert result.closing_speed == pytest.approx(v, abs=0.02)


def test_a_cube_is_picked_from_a_standing_base():
    x, y, _ = CUBE.position
    result = run_pick(
        SCENE, Pass(start=(x - 0.15, y - 0.6, 0.0), twist=lambda t: (0.0, 0.0), object=CUBE.name, time=6.0)
    )
    assert result.held and result.contacts == []


def test_the_lift_begins_when_the_fingers_report_that_they_are_firm_also_before_the_closing_time():
    x, y, _ = CUBE.position
    driver = Driver(msgspec.structs.replace(SCENE, start=(x - 0.15, y - 0.6, 0.0)))
    quick = msgspec.structs.replace(driver.scene.robot.gripper, closing_time=0.4)
    robot = msgspec.structs.replace(driver.scene.robot, gripper=quick)
    driver.plant = SimulatedPlant(msgspec.structs.replace(driver.scene, robot=robot))
    phases = [driver.step(lambda t: (0.0, 0.0), "pick", CUBE.name, 0.0).phase for _ in range(600)]
    assert phases.count("closing") == pytest.approx(40, abs=2)  # of 10 ms
    assert "lift" in phases and "retry" not in phases


def test_a_cube_is_dropped_into_a_bin_while_the_base_drives_by():
    x, y, _ = CUBE.position
    bin_x, bin_y = SCENE.bins[0].centre
    result = run_place(
        SCENE,
        Pass(
            start=(x - 0.15, y - 0.6, 0.0),
            twist=lambda t: (0.5, 0.0),
            object=CUBE.name,
            bin=SCENE.bins[0].name,
            place_start=(bin_x + 1.5, bin_y + 0.6, math.pi),
            time=6.0,
        ),
    )
    assert result.placed and result.contacts == []
    assert result.closing_speed > 0.4


def test_an_object_that_was_never_seen_is_not_grasped():
    blind = msgspec.structs.replace(
        SCENE,
        robot=msgspec.structs.replace(SCENE.robot, camera=msgspec.structs.replace(SCENE.robot.camera, range=0.01)),
    )
    result = run_pick(blind, straight(0.3, 0.6))
    assert not result.picked and result.missed == 0
    assert any("waiting to see" in reason for reason in result.reasons)


@pytest.mark.parametrize("spoil", ["q", "odometry", "twist"])
def test_a_number_that_is_not_finite_stops_the_arm_within_one_period(spoil):
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    for _ in range(30):
        inputs = inputs_of(plant, base_twist=(0.05, 0.0))
        step = manipulator.step(inputs)
        plant.command(step.actuation)
        plant.step(0.01)
    assert np.abs(step.actuation.joint_velocity).max() > 0.05
    inputs = inputs_of(plant)
    values = getattr(inputs.observation, spoil).copy()
    values[0] = np.nan
    bad = msgspec.structs.replace(inputs, observation=msgspec.structs.replace(inputs.observation, **{spoil: values}))
    rates = [manipulator.step(bad) for _ in range(5)]
    assert all(step.qp_status.startswith("damped stop: ") and step.reason for step in rates)
    assert np.abs(rates[-1].actuation.joint_velocity).max() < 1e-9
    first, last = rates[0].actuation.twist[0], rates[-1].actuation.twist[0]
    assert first - last == pytest.approx(4 * 0.005, abs=1e-9)
    again = manipulator.step(inputs)
    assert again.qp_status == "solved"


def test_a_hand_over_something_that_the_base_leaves_behind_does_not_sink_into_it():
    """A box dropped on the robot is a ring of points round the hand, which they hold while the base drives on."""
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    at = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    heights, said = [], set()
    obstacles = None
    for k in range(200):
        inputs = inputs_of(plant, base_twist=(min(0.5, 0.01 * k), 0.0), obstacles=obstacles)
        step = manipulator.step(inputs)
        hand = Frankie(SCENE.robot).tcp_pose(inputs.observation.odometry, inputs.observation.q)[0]
        if k == 20:
            ring = hand[:2] + (0.05, 0.0) + 0.24 * np.column_stack((np.cos(at), np.sin(at)))
            obstacles = ArmObstacles(points=ring, static=np.zeros(len(ring), dtype=bool))
        heights.append(hand[2])
        said.add(step.qp_status.split(":")[0])
        plant.command(step.actuation)
        plant.step(0.01)
    assert "standing" in said
    assert min(heights[20:]) > heights[20] - 0.01


def test_a_goal_that_is_not_finite_stops_the_arm_with_the_reason():
    plant = SimulatedPlant(SCENE)
    inputs = inputs_of(plant)
    goal = msgspec.structs.replace(inputs.goal, position=np.array([np.inf, 0.0, 0.8]))
    step = Manipulator(known_world(SCENE)).step(msgspec.structs.replace(inputs, goal=goal))
    assert step.qp_status == "damped stop: goal position is not finite"


def test_the_base_is_commanded_what_it_asked_for():
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    for k in range(20):
        wanted = (0.005 * (k + 1), -0.0175 * (k + 1))
        step = manipulator.step(inputs_of(plant, base_twist=wanted))
        np.testing.assert_allclose(step.actuation.twist, wanted, atol=2e-3)
        plant.command(step.actuation)
        plant.step(0.01)


def test_the_base_never_changes_faster_than_its_acceleration_limit():
    step = Manipulator(known_world(SCENE)).step(inputs_of(SimulatedPlant(SCENE), base_twist=(0.015, 0.0)))
    assert step.actuation.twist[0] <= 0.01 + 1e-9


def test_a_moving_obstacle_pushes_the_gripper_back_and_is_named():
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    p = np.array([0.15 + 0.484, 0.0])
    wall = np.array([[p[0] + 0.2, y] for y in np.arange(-0.2, 0.21, 0.05)])
    obstacles = ArmObstacles(points=wall, static=np.zeros(len(wall), dtype=bool))
    for _ in range(20):
        step = manipulator.step(inputs_of(plant, obstacles=obstacles))
        plant.command(step.actuation)
        plant.step(0.01)
    assert step.limiter == "moving obstacle"
    assert step.obstacle_distance > 0.2


@pytest.mark.parametrize(("cells", "after"), [(1, 0.3), (2, 0.0)])
def test_a_single_cell_in_the_arm_may_be_a_wrong_hit_and_counts_when_it_stays(cells, after):
    plant, manipulator = SimulatedPlant(SCENE), Manipulator(known_world(SCENE))
    seen = np.array([[0.15 + 0.484, 0.05 * k] for k in range(cells)])
    inputs = inputs_of(plant, obstacles=ArmObstacles(points=seen, static=np.zeros(cells, dtype=bool)))
    stands = []
    for k in range(50):
        now = msgspec.structs.replace(inputs.observation, time=0.01 * k)
        stands.append(manipulator.step(msgspec.structs.replace(inputs, observation=now)).program == "standing")
    assert stands.index(True) == pytest.approx(100.0 * after, abs=2)
    assert all(stands[stands.index(True) :])


def test_snapshots_restore_the_same_decisions():
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    inputs = inputs_of(plant)
    manipulator.step(inputs)
    kept = manipulator.snapshot()
    first = manipulator.step(inputs)
    after = state_hash(manipulator.snapshot())
    manipulator.restore(kept)
    second = manipulator.step(inputs)
    np.testing.assert_array_equal(first.actuation.joint_velocity, second.actuation.joint_velocity)
    assert state_hash(manipulator.snapshot()) == after


def test_the_papers_solver_can_be_chosen():
    p = ArmParameters()
    osqp = msgspec.structs.replace(p, qp=msgspec.structs.replace(p.qp, solver="osqp", residual=1e-3))
    inputs = inputs_of(SimulatedPlant(SCENE))
    first = Manipulator(known_world(SCENE), p).step(inputs)
    second = Manipulator(known_world(SCENE), osqp).step(inputs)
    np.testing.assert_allclose(first.actuation.joint_velocity, second.actuation.joint_velocity, atol=1e-2)


def test_the_stowed_arm_stays_over_the_base():
    plant = SimulatedPlant(SCENE)
    manipulator = Manipulator(known_world(SCENE))
    for _ in range(300):
        step = manipulator.step(inputs_of(plant))
        plant.command(step.actuation)
        plant.step(0.01)
    segments = capsule_segments(fk_arm(plant.observe().q)) + np.array([0.15, 0.0, 0.38])
    low = (segments.min(axis=1) - CAPSULE_RADII[:, None]).min(axis=0)
    high = (segments.max(axis=1) + CAPSULE_RADII[:, None]).max(axis=0)
    foot = SCENE.robot.footprint
    assert low[0] >= -0.5 * foot.length and high[0] <= 0.5 * foot.length
    assert low[1] >= -0.5 * foot.width - 0.01 and high[1] <= 0.5 * foot.width + 0.01
    assert low[2] > foot.height + 0.02


@pytest.mark.parametrize("row", ["hand - table", "ceiling"])
def test_a_program_whose_hard_rows_give_way_names_the_row(row):
    active, hard = ("joint 4", "lidar static", row, "forearm - lidar"), frozenset({"hand - table", "ceiling"})
    assert _gave_way(0.0, active, hard, 0.02) is None
    gave = str(_gave_way(0.05, active, hard, 0.02))
    assert gave == f"moved off at 0.05 m/s ({row}): too near for the joints to brake in time"
