"""Decides what of the stream is drawn for Foxglove and Lichtblick, and how often: ten times a second is enough."""

import math
from collections.abc import Callable

import msgspec

from motm_twin.bus.messages import (
    GridInfo,
    NumberedEvent,
    PlacementMessage,
    RobotStateMessage,
    ScanMessage,
    TickMessage,
)
from motm_twin.model.scene import Scene
from motm_twin.record import channels as ch
from motm_twin.record import foxglove as fox
from motm_twin.record.channels import Channel, PlotsMessage
from motm_twin.record.foxglove import furniture, robot_model

INTERVAL = 0.1  # [s] between two messages of a drawn topic
SLOW = 0.25  # [s] for candidates
_TOLERANCE = 0.01  # [s] a message that comes a little early is taken
Add = Callable[[Channel, float, bytes], None]
_DIGITS = 5


class Drawer:
    """Adds drawn messages to a recording, through ``add`` (channel, server time, JSON)."""

    def __init__(self, add: Add) -> None:
        self._add, self._encode = add, msgspec.json.Encoder().encode
        self._next: dict[str, float] = {}
        self._robot_shown, self._frames_known = False, False
        self._placement: PlacementMessage | None = None

    def tick(self, tick: TickMessage) -> None:
        """Bodies, paths, candidates and curves of a period."""
        now = tick.server_time
        if not self._frames_known and self._due(ch.DRAWN_FRAMES, now):
            self._put(ch.DRAWN_FRAMES, now, fox.base_transform(tick))
        if self._due(ch.DRAWN_CANDIDATES, now, SLOW) and tick.placement != self._placement:
            self._placement = tick.placement
            self._put(ch.DRAWN_CANDIDATES, now, fox.candidates(tick.placement, now))
        if self._due(ch.PLOTS, now):
            self._put(ch.PLOTS, now, plots(tick))
            self._put(ch.DRAWN_BODIES, now, fox.bodies(tick))
            self._put(ch.DRAWN_GLOBAL, now, fox.path(tick.plan.global_path, now))
            self._put(ch.DRAWN_NEXT, now, fox.path(tick.plan.next_path, now))
            self._put(ch.DRAWN_LOCAL, now, fox.path([row[:3] for row in tick.plan.local_poses], now, fox.LOCAL_HEIGHT))

    def wants_tick(self, server_time: float) -> bool:
        """True when `tick` would add anything now."""
        return any(server_time >= self._next.get(channel.topic, 0.0) - _TOLERANCE for channel in _FROM_TICK)

    def robot(self, robot: RobotStateMessage) -> None:
        """The frames of the robot, and once its shape."""
        self._frames_known = True
        if not self._robot_shown:
            self._robot_shown = True
            self._put(ch.DRAWN_ROBOT, robot.server_time, robot_model(robot.server_time))
        if self._due(ch.DRAWN_FRAMES, robot.server_time, INTERVAL / 2):
            self._put(ch.DRAWN_FRAMES, robot.server_time, fox.transforms(robot))

    def scan(self, scan: ScanMessage) -> None:
        """A sweep."""
        if self._due(ch.DRAWN_SCAN, scan.server_time):
            self._put(ch.DRAWN_SCAN, scan.server_time, fox.scan(scan))

    def scene(self, scene: Scene, server_time: float) -> None:
        """The furniture."""
        self._put(ch.DRAWN_FURNITURE, server_time, furniture(scene, server_time))

    def grid(self, info: GridInfo, cells: bytes, server_time: float) -> None:
        """The map."""
        self._put(ch.DRAWN_GRID, server_time, fox.grid(info, cells, server_time))

    def event(self, event: NumberedEvent) -> None:
        """A line of the log."""
        self._put(ch.DRAWN_LOG, event.server_time, fox.log(event.server_time, event.kind, event.text))

    def _due(self, channel: Channel, now: float, interval: float = INTERVAL) -> bool:
        due = self._next.get(channel.topic, 0.0)
        if due - 10.0 * interval < now < due - _TOLERANCE:  # further back it is the clock of another server
            return False
        self._next[channel.topic] = due + interval if due <= now < due + interval else now + interval
        return True

    def _put(self, channel: Channel, server_time: float, message: object) -> None:
        self._add(channel, server_time, self._encode(message))


_FROM_TICK = (ch.DRAWN_CANDIDATES, ch.PLOTS)


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
