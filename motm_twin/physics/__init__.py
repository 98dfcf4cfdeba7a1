"""Contact dynamics: robot and world in MuJoCo, behind the same plant as the kinematic ones."""
