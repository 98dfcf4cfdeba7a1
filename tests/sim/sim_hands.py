"""A hand above a cube on a pedestal, for tests of grasping and of the referee."""

import math

import numpy as np
from sim_scenes import box, scene

from motm_twin.model.assets import LINKS
from motm_twin.model.kinematics import Frankie
from motm_twin.model.plant import Actuation
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import SceneObject
from motm_twin.sim.plant import SimulatedPlant

DOWN = np.array([0.0, -0.3, 0.0, -2.2, 0.0, 1.9, math.pi / 4])  # tool axis straight down
ROBOT = Frankie(RobotProfile())
START = np.zeros(3)


def tcp(pose=START, q=DOWN):
    return ROBOT.tcp_pose(pose, q)


def hand_pose(pose, q):
    """Position and rotation of ``panda_hand``, where the palm camera is."""
    T = ROBOT.link_transforms(np.array(pose, dtype=float), q)[LINKS.index("panda_hand")]
    return T[:3, 3], T[:3, :3]


def act(twist=(0.0, 0.0), dq=None, gripper="open", opening=None):
    joints = np.zeros(7) if dq is None else np.asarray(dq, dtype=float)
    return Actuation(twist=np.array(twist, dtype=float), joint_velocity=joints, gripper=gripper, opening=opening)


def over_a_cube(offset=(0.0, 0.0, 0.0), turn=0.0, q=DOWN, side=0.04, pedestal=True, **changes):
    """A plant whose hand stands over a cube that is off by offset, in the axes of the hand, and turned."""
    position, rotation = tcp(q=q)
    centre = position + rotation @ np.array(offset)
    yaw = math.atan2(rotation[1, 1], rotation[0, 1]) + turn
    cube = SceneObject(name="cube", position=tuple(float(v) for v in centre), yaw=yaw, side=side)
    stand = box("stand", (centre[0], centre[1]), (0.1, 0.1), float(centre[2]) - 0.5 * side, mapped=True)
    solids = (stand,) if pedestal else ()
    return SimulatedPlant(scene(solids=(*solids, *changes.pop("solids", ())), objects=(cube,), **changes), arm_start=q)


def cube_of(plant, name="cube"):
    return next(item for item in plant.truth().objects if item.name == name)


def move(plant, velocity, seconds, gripper="close", twist=(0.0, 0.0)):
    """Move the tool centre point along the world's axes [m/s] for a time."""
    for _ in range(round(seconds / 0.01)):
        seen = plant.observe()
        J = ROBOT.tcp_jacobian(plant.truth().pose, seen.q)[:, 2:]
        dq = np.linalg.pinv(J) @ np.array([*velocity, 0.0, 0.0, 0.0])
        plant.command(act(twist, dq, gripper))
        plant.step(0.01)


def grasp(plant, lift=0.0):
    """The same plant after its fingers have closed and have lifted what they hold [m]."""
    plant.command(act(gripper="close"))
    plant.step(0.9)
    move(plant, (0.0, 0.0, 0.1), lift / 0.1)
    return plant
