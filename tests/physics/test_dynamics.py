import math
import time

import msgspec
import numpy as np
import pytest
from physics_hands import hand_over_a_cube, in_hand, physical
from sim_hands import act, move
from sim_scenes import box, scene

from motm_twin.model.edits import AddObstacle, InjectFault, MoveBody, MoveObject, PushRobot, RemoveBody
from motm_twin.model.names import SceneError
from motm_twin.model.plant import Contact, ContactForce
from motm_twin.model.profile import Gripper, RobotProfile
from motm_twin.model.scene import Agent, Bump, Faults, Physics
from motm_twin.model.state import state_hash
from motm_twin.physics.forces import ENDED, disagreements
from motm_twin.plants import make_plant, with_plant
from motm_twin.sim.plant import SimulatedPlant


def drive(plant, v, w, seconds):
    for _ in range(round(seconds / 0.01)):
        plant.command(act((v, w)))
        plant.step(0.01)


def test_wheels_drive_straight_at_the_speed_that_they_are_told():
    plant = physical(scene())
    drive(plant, 0.3, 0.0, 2.0)
    before = plant.truth().pose
    drive(plant, 0.3, 0.0, 1.0)
    x, y, heading = plant.truth().pose - before
    assert x == pytest.approx(0.3, rel=0.01)
    assert abs(y) < 1e-3
    assert abs(heading) < 1e-3


@pytest.mark.parametrize("slip", [0.5, 1.0])
def test_wheels_that_slip_turn_as_they_are_told_and_the_base_lags_behind(slip):
    """Of wheels that slipped altogether, standing was reported, and a thousand times their trembling."""
    plant = physical(scene())
    plant.apply(InjectFault(fault="wheel_slip", amount=slip, seconds=10.0))
    drive(plant, 0.3, 0.0, 2.0)
    assert plant.observe().twist == pytest.approx([0.3, 0.0], abs=0.02)
    assert plant.observe().odometry[0] > 0.4
    assert plant.truth().pose[0] < (1.0 - slip) * 0.6 + 0.01


def test_the_base_turns_about_its_middle_and_odometry_knows_it():
    plant = physical(scene())
    drive(plant, 0.0, 0.8, 1.0)
    before = plant.observe().odometry, plant.truth().pose
    drive(plant, 0.0, 0.8, 1.0)
    seen, true = plant.observe().odometry - before[0], plant.truth().pose - before[1]
    assert true[2] == pytest.approx(0.8, rel=0.01)
    assert math.hypot(true[0], true[1]) < 0.005
    assert seen[2] == pytest.approx(true[2], rel=0.01)


def test_a_wall_stops_the_base_and_the_referee_sees_what_the_forces_say():
    plant = physical(scene(solids=(box("wall", (0.6, 0.0), (0.1, 2.0), 0.35),)))
    drive(plant, 0.3, 0.0, 2.0)
    truth = plant.truth()
    assert truth.pose[0] < 0.21
    assert [(one.body, one.other) for one in truth.contacts] == [("base", "wall")]
    assert truth.contacts[0].caused_by_robot
    assert truth.physics.forces[0].other == "wall"
    assert truth.physics.forces[0].force > 50.0
    assert truth.physics.disagreements == ()


def contact(start, lasts, other):
    return Contact(
        time=start, body="base", other=other, depth=0.001, closing_speed=0.0, other_speed=0.0, caused_by_robot=False,
        duration=lasts,
    )  # fmt: skip


def force(start, lasts, other):
    return ContactForce(time=start, body="base", other=other, force=3.0, impulse=1.0, duration=lasts)


def test_contacts_and_forces_are_told_whose_other_is_missing_in_their_time():
    rng = np.random.default_rng(1)
    seen, felt = (
        [
            make(start, lasts, f"cube{k % 2}")
            for k, (start, lasts) in enumerate(zip(rng.uniform(0, 60, 90), rng.uniform(0, 1, 90), strict=True))
        ]
        for make in (contact, force)
    )

    def alone(ones, others):
        """Those that end too soon for, or begin too late after, every one of the others."""
        gaps = [
            min(max(b.time - a.time - a.duration, a.time - b.time - b.duration) for b in others if a.other == b.other)
            for a in ones
        ]
        return sum(gap > ENDED for gap in gaps)

    told = disagreements(seen, felt)
    assert sum("unseen" in text for text in told) == alone(felt, seen) > 10
    assert sum("without a force" in text for text in told) == alone(seen, felt) > 10


def test_contacts_and_forces_of_a_long_run_are_compared_at_once():
    """Each was compared with each, in every period: a thousand of both took it longer than the period."""
    seen, felt = ([make(2.0 * k, 0.3, "temi") for k in range(5000)] for make in (contact, force))
    began = time.process_time()
    assert disagreements(seen, felt) == ()
    assert time.process_time() - began < 0.5


def test_a_cube_between_the_pads_stays_there():
    plant = hand_over_a_cube()
    move(plant, (0.0, 0.0, 0.0), 0.9)
    assert plant.truth().objects[0].state == "held"
    assert min(plant.truth().physics.finger_forces) == pytest.approx(40.0, rel=0.05)
    move(plant, (0.0, 0.0, 0.1), 0.5)
    before = in_hand(plant)
    move(plant, (0.0, 0.0, 0.0), 2.0)
    assert np.abs(in_hand(plant) - before).max() < 2e-4  # [m]
    assert plant.truth().picks == 1
    move(plant, (0.0, 0.0, 0.0), 0.1, gripper="open")
    assert plant.truth().objects[0].state == "falling"


def test_fingers_that_are_told_to_close_fast_enough_report_a_hold_in_the_closing_time():
    plant = hand_over_a_cube()
    move(plant, (0.0, 0.0, 0.0), 0.75)
    assert plant.observe().gripper_moving
    move(plant, (0.0, 0.0, 0.0), 0.07)
    assert not plant.observe().gripper_moving
    assert plant.observe().gripper_width == pytest.approx(0.04, abs=1e-3)


def test_fingers_open_as_far_as_they_are_told_and_let_go_all_the_same():
    plant = hand_over_a_cube()
    for opening in (0.06, 0.05, None, 0.055):
        plant.command(act(gripper="open", opening=opening))
        plant.step(0.4)
        assert not plant.observe().gripper_moving
        assert plant.observe().gripper_width == pytest.approx(opening or 0.08, abs=2e-3)
    plant.command(act(gripper="close"))
    plant.step(1.0)
    assert plant.snapshot().gripper.held
    plant.command(act(gripper="open", opening=0.02))
    plant.step(0.4)
    assert not plant.snapshot().gripper.held


def test_a_wider_gripper_opens_as_far_as_its_profile_says():
    """The fingers stopped at 80 mm, and never reported that they were open."""
    robot = RobotProfile(gripper=Gripper(max_width=0.1))
    plant = make_plant(scene(robot=robot, physics=Physics()))
    for command in ("close", "open"):
        plant.command(act(gripper=command))
        plant.step(1.5)
    assert not plant.observe().gripper_moving
    assert plant.observe().gripper_width == pytest.approx(0.1, abs=2e-3)


def test_a_cube_slips_out_of_fingers_without_friction():
    plant = hand_over_a_cube(pad_friction=0.05, object_mass=1.5)
    move(plant, (0.0, 0.0, 0.0), 0.9)
    move(plant, (0.0, 0.0, 0.15), 1.0)
    assert plant.truth().objects[0].state != "held"
    assert plant.truth().picks == 0


def test_a_hand_that_moves_across_the_pads_shifts_the_cube_and_one_beside_it_misses():
    plant = hand_over_a_cube(offset=(0.0, 0.006, 0.0))
    move(plant, (0.0, 0.0, 0.0), 0.9)
    grasp = plant.truth().physics.grasps[0]
    assert grasp.shift == pytest.approx(0.006, abs=0.001)
    beside = hand_over_a_cube(offset=(0.06, 0.0, 0.0))
    move(beside, (0.0, 0.0, 0.0), 2.0)
    assert beside.truth().physics.grasps == ()
    assert beside.observe().gripper_width < 0.002


def test_equal_plants_stay_equal_and_a_restored_one_goes_on_as_it_did():
    one, other = (hand_over_a_cube() for _ in range(2))
    for plant in (one, other):
        move(plant, (0.0, 0.0, 0.0), 0.9, twist=(0.02, 0.0))
    assert state_hash(one.snapshot()) == state_hash(other.snapshot())
    kept = one.snapshot()
    for plant in (one, other):
        move(plant, (0.02, 0.0, 0.1), 0.5)
    end = state_hash(one.snapshot())
    assert state_hash(other.snapshot()) == end
    one.restore(kept)
    move(one, (0.02, 0.0, 0.1), 0.5)
    assert state_hash(one.snapshot()) == end


def test_a_plant_that_gets_the_state_of_an_edited_one_goes_on_as_that_does():
    temi = Agent(name="temi", start=(2.0, 1.5, 0.0), waypoints=((2.0, -1.5), (2.0, 1.5)))
    hall = scene(agents=(temi,), solids=(box("crate", (1.5, -1.0), (0.4, 0.4), 0.5, mapped=False),))
    one, other = physical(hall), physical(hall)
    drive(one, 0.2, 0.1, 0.3)
    for edit in (
        AddObstacle(name="box", x=3.0, y=0.0, size=(0.3, 0.3, 0.4)),
        AddObstacle(name="visitor", shape="person", x=-1.5, y=0.0),
        MoveBody(name="crate", x=2.5, y=-1.0, heading=0.4),
        PushRobot(dx=0.0, dy=0.2, turn=0.3),
        RemoveBody(name="temi"),
    ):
        one.apply(edit)
        drive(one, 0.2, 0.1, 0.1)
    other.restore(one.snapshot())
    for plant in (one, other):
        drive(plant, 0.3, 0.0, 0.3)
    assert state_hash(one.snapshot()) == state_hash(other.snapshot())
    assert one.truth().plant_faults == ()


def test_a_person_pushes_the_base_and_takes_the_cube():
    plant = hand_over_a_cube()
    move(plant, (0.0, 0.0, 0.0), 0.9)
    move(plant, (0.0, 0.0, 0.1), 0.5)
    before = in_hand(plant)
    plant.apply(PushRobot(dx=-0.1, dy=0.05, turn=0.2))
    move(plant, (0.0, 0.0, 0.0), 0.3)
    assert plant.truth().objects[0].state == "held"
    assert math.hypot(*(in_hand(plant) - before)) < 0.002
    plant.apply(MoveObject(name="cube", x=0.0, y=1.0))
    move(plant, (0.0, 0.0, 0.0), 0.5)
    assert plant.truth().objects[0].state in ("resting", "dropped")
    assert plant.truth().objects[0].position[:2] == pytest.approx((0.0, 1.0), abs=1e-3)
    assert plant.truth().drops == 0


def test_an_agent_gives_way_to_a_base_that_pushes_it():
    temi = Agent(name="temi", start=(0.75, 0.0, 0.0))
    plant = physical(scene(agents=(temi,), robot=RobotProfile(has_arm=False)))
    drive(plant, 0.3, 0.0, 2.0)
    truth = plant.truth()
    assert truth.pose[0] > 0.2
    assert truth.agents[0].position[0] > truth.pose[0] + 0.55
    assert truth.contacts[0].other == "temi"


def test_faults_of_the_kinematic_gripper_are_refused(monkeypatch):
    with pytest.raises(SceneError, match="closing_delay"):
        with_plant(msgspec.structs.replace(scene(), faults=Faults(grasp_misses=1)), "mujoco")
    monkeypatch.setattr("motm_twin.plants.find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"pip install .motm_twin\[physics\]"):
        with_plant(scene(), "mujoco")
    assert make_plant(scene()) is not None


RIDGE = Bump(name="cable", centre=(0.8, 0.0), length=2.0, yaw=0.5 * math.pi)


def test_wheels_and_casters_roll_over_a_bump_of_10_mm_which_the_arm_feels():
    level, bumpy = physical(scene()), physical(scene(bumps=(RIDGE,)))
    rises = []
    for plant in (level, bumpy):
        heights = [float(plant.snapshot().tcp[2])]
        for _ in range(300):
            drive(plant, 0.4, 0.0, 0.01)
            heights.append(float(plant.snapshot().tcp[2]))
        rises.append(max(heights) - heights[0])
    assert rises[0] < 1e-3
    assert 0.008 < rises[1] < 0.03
    plain, felt = level.truth(), bumpy.truth()
    assert felt.pose[0] == pytest.approx(plain.pose[0], abs=0.02)
    assert plain.physics.phantoms == (0, 0)
    assert felt.physics.phantoms[0] > 0 and max(felt.physics.torque_peaks) > 10.0
    assert felt.physics.wrist_peaks[0] > plain.physics.wrist_peaks[0] + 3.0
    assert felt.contacts == () and felt.physics.disagreements == ()


def test_the_kinematic_plant_ignores_bumps():
    plain, bumpy = SimulatedPlant(scene()), SimulatedPlant(scene(bumps=(RIDGE,)))
    for plant in (plain, bumpy):
        drive(plant, 0.4, 0.1, 1.0)
    assert state_hash(plain.snapshot()) == state_hash(bumpy.snapshot())


def test_a_hand_at_rest_feels_the_weight_of_hand_and_fingers_at_its_mount():
    plant = physical(scene())
    drive(plant, 0.0, 0.0, 0.5)
    assert plant.truth().physics.wrist[0] == pytest.approx(0.76 * 9.81, rel=1e-3)
