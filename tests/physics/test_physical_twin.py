import msgspec
import pytest
from sim_scenes import scene

from motm_twin.bus.encode import tick_message
from motm_twin.bus.plant_messages import VERSION, ResetRequest
from motm_twin.external.robot import ReferenceRobot
from motm_twin.model.edits import AddObstacle, RemoveBody
from motm_twin.model.scene import Faults, Physics
from motm_twin.model.scene_file import load_scene
from motm_twin.plants import with_plant
from motm_twin.sessions.session import MUJOCO
from motm_twin.twin import Twin

PICKED = 170  # periods until the first cube is in the air
BRANCH = 130


@pytest.fixture(scope="module")
def picked():
    """A twin that has picked its first cube on the move, its state before, and the hash in between."""
    twin = Twin(with_plant(load_scene("exp1", "trial1"), "mujoco"))
    while twin.index < BRANCH:
        twin.advance()
    before = twin.snapshot()
    while twin.index < PICKED:
        twin.advance()
    return twin, before


def test_a_cube_is_picked_on_the_move_and_held_by_friction(picked):
    twin, _ = picked
    truth = twin.plant.truth()
    assert truth.picks == 1
    assert truth.drops == 0
    assert truth.contacts == ()
    assert truth.plant_faults == ()
    assert truth.physics.disagreements == ()
    (grasp,) = truth.physics.grasps
    assert grasp.firm == pytest.approx(0.8, abs=0.03)
    assert grasp.shift < 0.01
    assert grasp.slip < 0.002
    assert min(truth.physics.finger_forces) > 35.0


def test_readers_of_the_tick_get_the_forces(picked):
    twin, _ = picked
    kept = twin.snapshot()
    forces = tick_message(twin.advance(), 1, 0.0).forces
    assert min(forces.fingers) > 35.0
    assert forces.grasp.object == twin.plant.truth().physics.grasps[0].object
    assert forces.wrist[0] > 7.0 and max(forces.torque_peaks) > 1.0
    twin.restore(kept)


def test_a_branch_goes_on_as_the_run_did_and_another_twin_too(picked):
    twin, before = picked
    end = twin.state_hash()
    other = Twin(twin.scene)
    other.restore(before)
    while other.index < PICKED:
        other.advance()
    assert other.state_hash() == end


def test_a_branch_from_before_an_edit_forgets_the_body_that_was_added(picked):
    twin, _ = picked
    kept, end = twin.snapshot(), twin.state_hash()
    twin.post(AddObstacle(name="crate", x=-1.0, y=-3.0))
    twin.advance()
    twin.post(RemoveBody(name="crate"))
    twin.advance()
    twin.restore(kept)
    assert twin.state_hash() == end
    twin.advance()
    assert twin.plant.truth().obstacles == ()


def test_a_session_names_the_version_of_mujoco_and_its_numbers(picked):
    twin, _ = picked
    session = twin.session()
    assert MUJOCO in session.made_with
    assert session.scene.physics == twin.scene.physics


def test_a_robot_with_contact_dynamics_keeps_them_in_the_scene_of_its_twin():
    plain = scene()
    robot = ReferenceRobot(msgspec.structs.replace(plain, physics=Physics(base_mass=90.0)), send=lambda *_: None)
    assert robot.reset(ResetRequest(version=VERSION, scene=plain)).ok
    assert robot.scene.physics == Physics(base_mass=90.0)
    robot.show()
    robot.step()
    assert robot.time == pytest.approx(0.01)
    assert robot.report()["physics"]["disagreements"] == ()
    faulty = msgspec.structs.replace(plain, faults=Faults(grasp_slips=1))
    answer = robot.reset(ResetRequest(version=VERSION, scene=faulty))
    assert not answer.ok
    assert "grasp_slips" in answer.reason
    assert robot.scene.faults == Faults()
