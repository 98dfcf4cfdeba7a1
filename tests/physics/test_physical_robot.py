import msgspec
import pytest
from sim_scenes import scene

from motm_twin.bus.plant_messages import VERSION, ResetRequest
from motm_twin.external.robot import ReferenceRobot
from motm_twin.model.scene import Faults, Physics


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
