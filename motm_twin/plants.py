"""The plant of a scene: kinematic, or with contact dynamics if the scene has numbers for them."""

from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

import msgspec

from motm_twin.model.names import SceneError
from motm_twin.model.rvo import require_pyrvo
from motm_twin.model.scene import Faults, Physics, Scene

if TYPE_CHECKING:
    from motm_twin.sim.plant import SimulatedPlant

MUJOCO = "mujoco"
PLANTS = ("simulated", MUJOCO)  # names of the kinematic plant, and of contact dynamics


def make_plant(scene: Scene) -> "SimulatedPlant":
    """The plant of a scene at its start. Raises SceneError when the scene or this installation does not allow it."""
    from motm_twin.sim.plant import SimulatedPlant  # slow to import; most callers have only names of plants

    require_orca(scene)
    if scene.physics is None:
        return SimulatedPlant(scene)
    require_physics(scene)
    return SimulatedPlant(scene, mechanics=import_module("motm_twin.physics.mechanics").Dynamics)


def with_plant(scene: Scene, plant: str) -> Scene:
    """The scene for a plant of this name. Raises SceneError when the scene or this installation does not allow it."""
    if plant != MUJOCO:
        return scene
    scene = msgspec.structs.replace(scene, physics=scene.physics or Physics())
    require_physics(scene)
    return scene


def require_orca(scene: Scene) -> None:
    """Raise SceneError when agents use ORCA and pyrvo is not installed."""
    if any(agent.behaviour == "orca" for agent in scene.agents):
        require_pyrvo(SceneError)


def require_mujoco() -> None:
    """Raise SceneError when MuJoCo is not installed."""
    if find_spec("mujoco") is None:
        raise SceneError('contact dynamics need MuJoCo: pip install "motm_twin[physics]"')


def require_physics(scene: Scene) -> None:
    """Raise SceneError when MuJoCo is not installed, or when the scene has faults of the kinematic gripper."""
    require_mujoco()
    faults, none = scene.faults, Faults()
    for field in ("grasp_misses", "grasp_slips", "grasp_failure_probability", "grasp_delay", "grasp_delay_spread"):
        if getattr(faults, field) != getattr(none, field):
            raise SceneError(
                f"faults.{field} is a fault of the kinematic gripper: contact dynamics have physics.closing_delay, "
                "physics.pad_friction and physics.grip_force"
            )
