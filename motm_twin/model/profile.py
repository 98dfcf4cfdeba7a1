"""The robot profile: footprint, limits and sensors of one mobile manipulator; and the limits of the arm's joints.

Defaults are Frankie (LD-60 base, Panda arm): the speeds reproduce the paper's Bezier figure and task times;
accelerations and lags are this project's choice.
"""

import math

import msgspec
import numpy as np

from motm_twin.model.geometry import Array, frozen

DEG = math.pi / 180.0


RAISED, CARRIED = 1.22, 0.92  # [m] height of the raised and of the carried arm above its mount
OVER = 0.05  # [m] clearance that a robot without an arm keeps below things that it passes under


class Footprint(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Rectangle of the base body in the base frame, centred at ``(offset_x, 0)``."""

    length: float = 0.70  # [m] along x
    width: float = 0.50  # [m] along y
    height: float = 0.38  # [m] top of the body above the floor
    offset_x: float = 0.0  # [m]

    @property
    def outer(self) -> float:
        """Radius [m] of the circle about the base frame that holds the whole rectangle."""
        return math.hypot(0.5 * self.length + abs(self.offset_x), 0.5 * self.width)


class BaseLimits(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Limits of the differential drive, and the lag of its velocity loop."""

    forward_speed: float = 0.5  # [m/s] v_f
    reverse_speed: float = 0.25  # [m/s] v_r, a magnitude
    yaw_rate: float = 100.0 * DEG  # [rad/s]
    linear_acceleration: float = 0.5  # [m/s^2]
    yaw_acceleration: float = 1.75  # [rad/s^2]
    velocity_lag: float = 0.1  # [s] first-order time constant, known to the controller

    @property
    def full_speed(self) -> float:
        """Largest speed [m/s] in either direction."""
        return max(self.forward_speed, self.reverse_speed)

    @property
    def stopping_way(self) -> float:
        """Stopping distance [m] from full speed: v lag + v^2 / 2a."""
        v = self.full_speed
        return v * self.velocity_lag + v * v / (2.0 * self.linear_acceleration)

    @property
    def accelerations(self) -> Array:
        """Largest linear [m/s^2] and yaw acceleration [rad/s^2], shape (2,)."""
        return np.array([self.linear_acceleration, self.yaw_acceleration])

    def within(self, desired: Array) -> Array:
        """An acceleration, clipped to the limits, shape (2,)."""
        return np.clip(desired, -self.accelerations, self.accelerations)


class ArmSpec(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Mount of the arm on the base, and lag of its joints. Joint limits are in ``frankie.urdf``."""

    mount_x: float = 0.15  # [m] arm base in the base frame
    mount_y: float = 0.0
    mount_z: float = 0.38
    velocity_lag: float = 0.01  # [s] first-order time constant


class Gripper(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Parallel gripper (Franka Hand)."""

    max_width: float = 0.08  # [m] between the finger pads when open
    closing_time: float = 0.8  # [s] from the command to a firm hold; the paper's 0.8 s
    opening_time: float = 0.2  # [s] from the command until the object is free


class Lidar(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Planar lidar of the base: scanners in front and rear merged into one scan about the base's centre.

    The paper names no field of view. A single scanner in front leaves 90 deg behind the robot unseen, and it would
    back into whoever stands there; scenes may set that (``x: 0.3, field_of_view_deg: 270``).
    """

    x: float = 0.0  # [m] in the base frame
    y: float = 0.0
    z: float = 0.20  # [m] above the floor: it sees only what is at this height
    field_of_view: float = 360.0 * DEG  # [rad] symmetric about x
    beams: int = 721
    range_min: float = 0.05  # [m]
    range_max: float = 15.0  # [m]
    rate: float = 20.0  # [Hz]


class GripperCamera(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Palm camera: at the origin of ``panda_hand``, looking along its z axis."""

    half_cone: float = 45.0 * DEG  # [rad]
    range: float = 1.2  # [m]
    rate: float = 20.0  # [Hz]


class RobotProfile(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Robot data for planning, control and simulation."""

    name: str = "frankie"
    footprint: Footprint = Footprint()
    base: BaseLimits = BaseLimits()
    arm: ArmSpec = ArmSpec()
    has_arm: bool = True  # without one, `arm`, `gripper` and `camera` have no meaning, and its joints stay as they are
    gripper: Gripper = Gripper()
    lidar: Lidar = Lidar()
    camera: GripperCamera = GripperCamera()

    @property
    def top(self) -> float:
        """Height [m] up to which the robot reaches: solids that begin above it are no obstacles."""
        return self.arm.mount_z + RAISED if self.has_arm else self.driving_top

    @property
    def driving_top(self) -> float:
        """`top` while the robot drives, with the arm in its carrying posture."""
        return self.arm.mount_z + CARRIED if self.has_arm else self.footprint.height + OVER


# Limits of the joints: Franka Control Interface documentation, "Robot and interface specifications", Panda column.
# Positions and speeds are in ``frankie.urdf`` too (a test keeps them equal); a URDF has no place for accelerations.
Q_MIN = frozen([-2.8973, -1.7628, -2.8973, -3.0718, -2.8973, -0.0175, -2.8973])  # [rad], shape (7,)
Q_MAX = frozen([2.8973, 1.7628, 2.8973, -0.0698, 2.8973, 3.7525, 2.8973])  # [rad], shape (7,)
DQ_MAX = frozen([2.175, 2.175, 2.175, 2.175, 2.61, 2.61, 2.61])  # [rad/s], shape (7,)
DDQ_MAX = frozen([15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0])  # [rad/s^2], shape (7,)
WRIST_MIN = 0.75  # [rad] of joint 6: below it, the hand can touch the forearm (at some angle of joint 7, below 0.7)
_BRAKING = 0.8  # share of DDQ_MAX for joint braking: a lag of the drives must not take it above

READY = frozen([0.0, -0.3, 0.0, -2.2, 0.0, 2.0, math.pi / 4])  # [rad] hand down in front of the arm, shape (7,)


def braking_time(rates: Array) -> float:
    """Time [s] in which joints at these rates [rad/s], shape (7,), stop when they brake together.

    The hand then stays on its path. Tried and rejected: each joint brakes as hard as it can. A hand whose height fast
    joints kept constant over a driving base then sank by 9 cm.
    """
    return float(np.max(np.abs(rates) / (_BRAKING * DDQ_MAX)))
