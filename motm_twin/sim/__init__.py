"""The simulated plant: base, arm, gripper, sensors, agents, and the referee."""
