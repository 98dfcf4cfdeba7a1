"""Whatever drives the arm: it stops before mapped furniture and before its own base."""

import numpy as np
import pytest

from motm_twin.control.arm_monitor import ArmMonitor
from motm_twin.control.targets import odometry_to_world
from motm_twin.model.joint_limits import DDQ_MAX
from motm_twin.model.known import known_world
from motm_twin.model.plant import Actuation
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.plant import SimulatedPlant

SCENE = """
format: motm-scene/1
robot: frankie
start: {x: 0.0, y: 0.0, heading_deg: 0}
furniture:
  table_top: {shape: box, centre: [1.05, 0.0], size: [0.6, 2.0], z: [0.75, 0.78], group: table}
  shelf: {shape: box, centre: [0.0, 0.75], size: [2.0, 0.4], z: [0.0, 1.2]}
tasks: [{drive_to: {x: -3.0, y: 0.0}}]
time_limit: 40
"""
DT = 0.01  # [s]


def _deepest(scene, seed: int, *, guarded: bool) -> tuple[float, str]:
    """Deepest contact [m] but of the arm with itself, in 12 s of rates drawn anew every 0.4 s, and what was said."""
    rng = np.random.default_rng(seed)
    plant, monitor, base = SimulatedPlant(scene), ArmMonitor(known_world(scene)), scene.robot.base
    rates, twist, said = np.zeros(7), np.zeros(2), ""
    steps = np.array([base.linear_acceleration, base.yaw_acceleration]) * DT
    for k in range(1200):
        if k % 40 == 0:
            rates_wanted, twist_wanted = rng.uniform(-2.0, 2.0, 7), np.array([0.0, rng.uniform(-0.5, 0.5)])
        observation = plant.observe()
        rates = np.clip(rates_wanted, rates - DDQ_MAX * DT, rates + DDQ_MAX * DT)
        asked = np.clip(twist_wanted, twist - steps, twist + steps)
        actuation = Actuation(twist=asked, joint_velocity=rates, gripper="open")
        if guarded:
            answer = monitor.check(
                actuation, observation, twist, DT, T_odom_world=odometry_to_world(observation), held_side=0.0
            )
            actuation, said = answer.actuation, answer.reason or said
        rates, twist = actuation.joint_velocity.copy(), actuation.twist.copy()
        plant.command(actuation)
        plant.step(DT)
    found = [
        one.depth for one in plant.truth().contacts if not one.other.startswith("panda")
    ]  # not of the arm with itself
    return max(found, default=0.0), said


@pytest.mark.parametrize("seed", [0, 2, 4, 5, 6, 7])
def test_an_arm_that_is_driven_at_random_stops_before_furniture_and_its_own_base(tmp_path, seed):
    """At 2 rad/s, wedged between a wall, a table and its own base, it comes to touch them at most as it brakes."""
    path = tmp_path / "narrow.yaml"
    path.write_text(SCENE)
    scene = load_scene(str(path), None, 0)
    free, _ = _deepest(scene, seed, guarded=False)
    kept, said = _deepest(scene, seed, guarded=True)
    assert free > 0.03
    assert kept < 0.01
    assert said.startswith("braking: the ")
