"""Models of robot and scene: geometry, profile, kinematics, scene schema, assets."""
