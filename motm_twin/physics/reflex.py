"""External torques as the arm's own controller estimates them, which does not know that its base moves.

tau_ext = tau - (M(q) ddq + c(q, dq) + g(q)), of an arm on a base at rest. Accelerations of the base, bumps of the floor
and contacts all are in it; beyond a threshold the Panda stops by a reflex. A base that drives can trip it: a phantom
collision.
"""

import xml.etree.ElementTree as ET

import mujoco
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import REFLEXES, Physics
from motm_twin.physics.robot_model import add_arm_alone
from motm_twin.physics.state import PhysicsState

APART = 10  # substeps below a threshold after which it is passed anew


def note_reflexes(p: PhysicsState, substep: int, now: float) -> None:
    """Count the thresholds that the torque of now passes; a phantom collision is one without any contact."""
    most = np.abs(p.torque)
    p.torque_peaks = np.maximum(p.torque_peaks, most)
    joint = int(most.argmax())
    for name, limit in REFLEXES.items():
        if most[joint] <= limit:
            continue
        p.reflexes.setdefault(name, f"{now:.2f} s: joint {joint + 1}, {most[joint]:.1f} Nm over {limit:g}")
        if substep - p.over.get(name, -APART) >= APART and not p.presses:
            p.trips[name] = p.trips.get(name, 0) + 1
        p.over[name] = substep


class ArmAlone:
    """The arm on a base at rest."""

    def __init__(self, profile: RobotProfile, physics: Physics) -> None:
        root = ET.Element("mujoco", model="arm")
        ET.SubElement(root, "compiler", angle="radian", autolimits="true", eulerseq="XYZ")
        world = ET.SubElement(root, "worldbody")
        files = add_arm_alone(ET.SubElement(world, "body", name="base"), root, profile, physics)
        self._model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"), files)
        self._model.body_gravcomp[:] = 0.0
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._data = mujoco.MjData(self._model)

    def torque(self, q: Array, dq: Array, ddq: Array, width: float) -> Array:
        """Torques [Nm] of a motion, shape (7,), with the gripper ``width`` [m] open."""
        data = self._data
        data.qpos[:7], data.qvel[:7], data.qacc[:7] = q, dq, ddq
        data.qpos[7:9] = 0.5 * width
        mujoco.mj_inverse(self._model, data)
        return data.qfrc_inverse[:7].copy()
