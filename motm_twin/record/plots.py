"""The curves of a recording, from the ticks."""

import math

import msgspec

from motm_twin.bus.messages import TickMessage
from motm_twin.record.channels import PlotsMessage

_DIGITS = 5


def plots(tick: TickMessage) -> PlotsMessage:
    """The numbers of one period."""
    steps, score, placement = tick.arm, tick.score, tick.placement
    slacks = [[value or 0.0 for value in step.slack] for step in steps if len(step.slack) == 6]
    distances = [step.obstacle_distance for step in steps if step.obstacle_distance is not None]
    costs, chosen = placement.cost, placement.chosen
    return PlotsMessage(
        time=tick.time,
        run=tick.run,
        index=tick.index,
        speed=round(tick.robot.twist[0], _DIGITS),
        yaw_rate=round(tick.robot.twist[1], _DIGITS),
        acceleration=round(tick.plan.acceleration[0], _DIGITS),
        joint_rate=round(max((abs(rate) for rate in tick.robot.dq), default=0.0), _DIGITS),
        gripper_width=round(tick.robot.gripper_width, _DIGITS),
        path_length=_known(None if score is None else score.path_length),
        manipulability=_known(steps[-1].manipulability if steps else None),
        position_slack=_known(max((math.hypot(*slack[:3]) for slack in slacks), default=None)),
        turn_slack=_known(max((math.hypot(*slack[3:]) for slack in slacks), default=None)),
        obstacle_distance=_known(min(distances, default=None)),
        base_clearance=_known(None if score is None else score.min_base_clearance),
        chosen_cost=_known(costs[chosen] if 0 <= chosen < len(costs) else None),
        period_ms=_known(tick.stage_ms.get("period")),
        plan_ms=_known(tick.stage_ms.get("plan")),
        expansions=tick.plan.expansions,
        stopped=bool(tick.stop_reason),
    )


def _known(value: float | None) -> float | msgspec.UnsetType:
    return msgspec.UNSET if value is None else round(value, _DIGITS)
