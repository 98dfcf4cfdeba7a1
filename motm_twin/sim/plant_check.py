"""Checks that the plant keeps its limits of speed and acceleration, and does not teleport."""

import math

import numpy as np
from numba import njit

from motm_twin.model.geometry import Array
from motm_twin.model.joint_limits import DDQ_MAX, DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.profile import RobotProfile
from motm_twin.sim.referee_state import PlantCheckState, World

SLACK = 1e-6  # by which a limit may be exceeded
OBJECT_JUMP = 0.08  # [m] per axis and substep that only a teleported object moves
KINDS = (
    "forward speed",
    "reverse speed",
    "yaw rate",
    "linear acceleration",
    "yaw acceleration",
    "way of the base by its speed",
    "sideways motion of the base",
    "turn of the base by its rate",
    "joint position",
    "joint speed",
    "joint acceleration",
    "way of a joint by its speed",
    "jump of an object",
)


class PlantCheck:
    """Compares consecutive substeps, from positions as well as from reported rates."""

    def __init__(self, profile: RobotProfile, dt: float) -> None:
        """Limits of the profile; substeps of dt [s]."""
        base = profile.base
        self._limits = np.array(
            [base.forward_speed, base.reverse_speed, base.yaw_rate, base.linear_acceleration, base.yaw_acceleration]
        )
        self.dt = dt

    def start(self, world: World) -> PlantCheckState:
        """State before the first substep."""
        return PlantCheckState(
            world.pose.copy(), world.twist.copy(), world.q.copy(), world.dq.copy(), _positions(world)
        )

    @staticmethod
    def edited(state: PlantCheckState, world: World) -> None:
        """A person moved the base or objects between two substeps: motion is judged from where they are now."""
        state.pose, state.objects = world.pose, _positions(world)

    def step(self, state: PlantCheckState, world: World) -> None:
        """Compare with the substep before and go on."""
        objects = _positions(world)
        before = (state.pose, state.twist, state.q, state.dq, state.objects)
        now = (world.pose, world.twist, world.q, world.dq, objects)
        excess, kept = _excess(*before, *now, self._limits, self.dt)
        if not kept:
            for kind, value in zip(KINDS, excess.tolist(), strict=True):
                if not value <= SLACK:
                    state.faults.setdefault(kind, f"{world.time:.2f} s: {kind} exceeded by {value:.3g}")
        state.pose, state.twist, state.q, state.dq, state.objects = now


@njit(cache=True)
def _excess(
    pose0: Array,
    twist0: Array,
    q0: Array,
    dq0: Array,
    objects0: Array,
    pose: Array,
    twist: Array,
    q: Array,
    dq: Array,
    objects: Array,
    limits: Array,
    dt: float,
) -> tuple[Array, bool]:
    """By how much each of `KINDS` is exceeded, and whether all are kept.

    Limits are speeds forward, back, yaw, accelerations linear, yaw.
    """
    excess = np.full(13, -np.inf)
    v, w, v0, w0 = twist[0], twist[1], twist0[0], twist0[1]
    excess[0], excess[1], excess[2] = v - limits[0], -v - limits[1], abs(w) - limits[2]
    excess[3], excess[4] = abs(v - v0) / dt - limits[3], abs(w - w0) / dt - limits[4]
    dx, dy, turned = pose[0] - pose0[0], pose[1] - pose0[1], pose[2] - pose0[2]
    turned -= 2.0 * math.pi * round(turned / (2.0 * math.pi))
    middle = pose0[2] + 0.5 * turned
    excess[5] = math.hypot(dx, dy) - max(abs(v), abs(v0)) * dt
    excess[6] = abs(math.cos(middle) * dy - math.sin(middle) * dx)
    excess[7] = abs(turned) - max(abs(w), abs(w0)) * dt
    for i in range(q.shape[0]):
        excess[8] = max(excess[8], q[i] - Q_MAX[i], Q_MIN[i] - q[i])
        excess[9] = max(excess[9], abs(dq[i]) - DQ_MAX[i])
        excess[10] = max(excess[10], abs(dq[i] - dq0[i]) / dt - DDQ_MAX[i])
        excess[11] = max(excess[11], abs(q[i] - q0[i]) - max(abs(dq[i]), abs(dq0[i])) * dt)
    for i in range(objects.shape[0]):
        for k in range(3):
            excess[12] = max(excess[12], abs(objects[i, k] - objects0[i, k]) - OBJECT_JUMP)
    return excess, (excess <= SLACK).all()


def _positions(world: World) -> Array:
    positions = [item.position for item in world.objects]
    return np.array(positions) if positions else np.zeros((0, 3))
