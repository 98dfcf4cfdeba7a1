"""Motion of a base with two driven wheels: the only integrator of poses, for kernels and for Python.

A base at constant speed v [m/s] and yaw rate w [rad/s] moves on an arc. While both change linearly, its arc
is that of their means, to second order in time; plans are made of such steps.
"""

import math
from typing import Any

import numpy as np

from motm_twin.model.compiler import njit
from motm_twin.model.exact import wrap_angle
from motm_twin.model.geometry import Array

TINY = 1e-9  # [rad] smaller turns count as none

# Without reference counts: numba counts every array of a tuple at every call, which made a search node 30 times
# slower. Such a kernel cannot allocate; its arrays belong to the caller.
_WITHOUT_COUNTS: Any = {"_nrt": False}
kernel: Any = njit(cache=True, error_model="numpy", **_WITHOUT_COUNTS)


@kernel
def arc(x: float, y: float, heading: float, v: float, w: float, dt: float) -> tuple[float, float, float]:
    """Pose after the arc of constant v and w for dt [s]; the heading in (-pi, pi]."""
    turned = w * dt
    if abs(turned) < TINY:
        return x + v * dt * math.cos(heading), y + v * dt * math.sin(heading), wrap_angle(heading + turned)
    radius = v / w
    return (
        x + radius * (math.sin(heading + turned) - math.sin(heading)),
        y - radius * (math.cos(heading + turned) - math.cos(heading)),
        wrap_angle(heading + turned),
    )


@kernel
def step(
    x: float, y: float, heading: float, v: float, w: float, v_end: float, w_end: float, dt: float
) -> tuple[float, float, float]:
    """Pose after dt [s] in which v and w change linearly to v_end and w_end, taken as straight in the mean direction.

    For steps of up to 0.3 s, as in plans. The heading is not wrapped.
    """
    ahead = heading + 0.25 * (w + w_end) * dt
    way = 0.5 * (v + v_end) * dt
    return x + way * math.cos(ahead), y + way * math.sin(ahead), heading + 0.5 * (w + w_end) * dt


def lag_share(lag: float, dt: float) -> float:
    """Share of the gap to its command that a speed with a first-order lag [s] closes within dt [s]."""
    return 1.0 if lag <= 0.0 else 1.0 - math.exp(-dt / lag)


def drive(pose: Array, v: float, w: float, dt: float) -> Array:
    """Pose after driving the arc of constant forward speed v [m/s] and yaw rate w [rad/s] for dt [s]."""
    x, y, heading = pose.tolist()
    return np.array(arc(x, y, heading, float(v), float(w), float(dt)))


def command_pose(pose: Array, twist: Array, lag: float) -> Array:
    """Pose from which the next command acts on a base that answers with a first-order lag [s]; twist as measured.

    The point p + lag v moves with the command u alone, since p' = v and lag v' = u - v; with u = 0 the base comes to
    rest there. Plans that start from it have the right stopping distance; the base follows them delayed by the lag.
    """
    return drive(pose, float(twist[0]), float(twist[1]), lag)
