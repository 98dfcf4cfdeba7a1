"""What a robot and a scene are: geometry, profile, kinematics, scene schema, assets."""
