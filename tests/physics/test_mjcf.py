import mujoco
import numpy as np
import pytest
from sim_scenes import scene

from motm_twin.model.assets import LINKS
from motm_twin.model.kinematics import Frankie
from motm_twin.model.profile import Q_MAX, Q_MIN, RobotProfile
from motm_twin.model.scene import Physics
from motm_twin.physics.mjcf import ARM_MASS, INERTIALS, TORQUE_MAX, Kind, compile_model


@pytest.fixture(scope="module")
def model():
    return compile_model(scene(), Physics(object_density=700.0), Kind((), (("cube", 0.04),), ()))


def test_masses_are_those_of_the_maker_and_of_the_scene(model):
    for link, one in INERTIALS.items():
        assert model.body(link).mass[0] == pytest.approx(one.mass)
    assert model.body("base").subtreemass[0] == pytest.approx(70.0 + ARM_MASS)
    assert pytest.approx(17.45, abs=0.01) == ARM_MASS  # [kg] the Panda and its hand
    assert model.body("object:cube").mass[0] == pytest.approx(700.0 * 0.04**3)


def test_joints_have_the_limits_of_the_panda(model):
    joints = [model.joint(f"panda_joint{k}") for k in range(1, 8)]
    assert np.array([joint.range for joint in joints]) == pytest.approx(np.column_stack([Q_MIN, Q_MAX]))
    most = [model.jnt_actfrcrange[joint.id][1] for joint in joints]
    assert tuple(most) == TORQUE_MAX


def test_links_are_where_the_urdf_has_them(model):
    data, robot, rng = mujoco.MjData(model), Frankie(RobotProfile()), np.random.default_rng(3)
    for _ in range(5):
        q = rng.uniform(Q_MIN, Q_MAX)
        data.qpos[[model.joint(f"panda_joint{k}").qposadr[0] for k in range(1, 8)]] = q
        mujoco.mj_kinematics(model, data)
        expected = robot.link_transforms(np.zeros(3), q, 0.0)
        for link, T in zip(LINKS[1:], expected[1:], strict=True):
            assert data.body(link).xpos == pytest.approx(T[:3, 3], abs=1e-9), link
            assert data.body(link).xmat.reshape(3, 3) == pytest.approx(T[:3, :3], abs=1e-9), link
