"""Coming to rest without a collision: how much clearance braking leaves.

Between two tests of the clearance the base drives at most half of its length, so that the footprint at one of the tests
covers all that it sweeps in between.
"""

import math

from motm_twin.model.motion import kernel, step
from motm_twin.planning.collision import ROUNDING, SLOPE, Body, Field, clearance, clearance_from


@kernel
def _between_looks(v: float, body: Body) -> float:
    """Time [s] between two tests of the clearance: 0.1 s, less if the base drives over half its length in that."""
    return 0.1 if abs(v) * 0.2 <= body.length else 0.5 * body.length / abs(v)


@kernel
def stopping_clearance(
    x: float, y: float, heading: float, v: float, w: float, a_max: float, b_max: float, needed: float,
    field: Field, body: Body,
) -> float:  # fmt: skip
    """Least clearance [m] while braking fully from speed v and yaw rate w, followed only until it is below `needed`.

    `needed` itself is returned if the clearance cannot fall below it.
    """
    dt = _between_looks(v, body)
    least = clearance(x, y, heading, 1.0, field, body)
    if least - (v * v / (2.0 * a_max) + abs(v) * dt) - body.outer * min(math.pi, w * w / (2.0 * b_max)) >= needed:
        return needed
    while (v != 0.0 or w != 0.0) and least >= needed:
        v_end = max(0.0, abs(v) - a_max * dt) * (1.0 if v > 0.0 else -1.0)
        w_end = max(0.0, abs(w) - b_max * dt) * (1.0 if w > 0.0 else -1.0)
        x, y, heading = step(x, y, heading, v, w, v_end, w_end, dt)
        v, w = v_end, w_end
        least = min(least, clearance(x, y, heading, 1.0, field, body))
    return least


@kernel
def _sure(least: float, needed: float, reach: float) -> float:
    """Lower bound [m] on the clearance of every point of the body, where `clearance` up to 1 m is `least`."""
    if needed <= 0.0:  # at the border of the map the distance jumps
        return -math.inf
    return least if least < 1.0 else 1.0 - (SLOPE - 1.0) * reach


@kernel
def can_stop(
    x: float, y: float, c: float, s: float, heading: float, free: float, v: float, w: float, a_max: float,
    b_max: float, needed: float, field: Field, body: Body,
) -> bool:  # fmt: skip
    """Test that `stopping_clearance` is not below `needed`; the clearance is looked up only where it could be below.

    ``free``: clearance [m] of the pose, inf if not known; c, s: cosine and sine of the heading.
    """
    dt = _between_looks(v, body)
    least = clearance_from(x, y, c, s, 1.0, needed, field, body) if math.isinf(free) else free
    if least - (v * v / (2.0 * a_max) + abs(v) * dt) - body.outer * min(math.pi, w * w / (2.0 * b_max)) >= needed:
        return True
    # The distance of a point that moves by m changes by SLOPE m at most: nothing comes nearer than `room` - SLOPE m.
    reach = body.outer + abs(body.centre_x)
    room = _sure(least, needed, reach)
    while (v != 0.0 or w != 0.0) and least >= needed:
        v_end = max(0.0, abs(v) - a_max * dt) * (1.0 if v > 0.0 else -1.0)
        w_end = max(0.0, abs(w) - b_max * dt) * (1.0 if w > 0.0 else -1.0)
        x, y, heading = step(x, y, heading, v, w, v_end, w_end, dt)
        room -= SLOPE * dt * 0.5 * (abs(v + v_end) + reach * abs(w + w_end))
        v, w = v_end, w_end
        if room < needed + ROUNDING:
            least = clearance(x, y, heading, 1.0, field, body)
            room = _sure(least, needed, reach)
    return least >= needed
