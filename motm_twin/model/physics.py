"""Numbers of the contact dynamics of a scene: masses, friction, forces. A scene without them is kinematic."""

from typing import Annotated

import msgspec

from motm_twin.model.bounds import Between

# [Nm] of external torque from which the Panda stops, while a joint keeps its rate and while it accelerates: libfranka,
# examples/examples_common.cpp, setDefaultBehavior, setCollisionBehavior for all joints
REFLEXES = {"nominal": 10.0, "accelerating": 20.0}


class Physics(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Contact dynamics instead of kinematics (`motm_twin.physics`).

    base_mass: the Omron LD-60 weighs 62 kg with its battery; with electronics of the arm 70 kg.

    grip_force: the Franka Hand holds with up to 70 N (data sheet of the Franka Hand, continuous force); 40 N of them.

    pad_friction: rubber on wood 0.7 to 0.95; object_friction: wood on wood 0.25 to 0.5; wheel_friction: rubber on
    concrete 0.6 to 0.85, all dry (The Engineering ToolBox, Friction Coefficients).

    object_density: beech wood, 700 kg/m^3 (The Wood Database, 720): a cube of 4 cm weighs 45 g.
    """

    base_mass: Annotated[float, Between(20.0, 500.0, unit="kg")] = 70.0  # without the arm
    wheel_friction: Annotated[float, Between(0.1, 2.0)] = 0.8
    grip_force: Annotated[float, Between(5.0, 70.0, unit="N")] = 40.0  # of each pad
    pad_friction: Annotated[float, Between(0.05, 2.0)] = 0.8
    object_friction: Annotated[float, Between(0.05, 2.0)] = 0.4  # on furniture and on each other
    object_density: Annotated[float, Between(20.0, 8000.0, unit="kg/m^3")] = 700.0
    object_mass: Annotated[float, Between(0.0, 2.0, unit="kg")] = 0.0  # of every object; 0: by its density
    closing_delay: Annotated[float, Between(0.0, 1.0, unit="s")] = 0.0  # from a command to the first motion of fingers
