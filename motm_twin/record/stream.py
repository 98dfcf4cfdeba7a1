"""Sorts what arrives from one twin into a recording: our messages as they came, and drawings for Foxglove at 10 Hz.

Knows no transport and no clock; `recorder` feeds it.
"""

import hashlib
import math
from collections.abc import Callable
from typing import Any

import msgspec

from motm_twin.bus import messages
from motm_twin.bus.keys import Keys
from motm_twin.model.scene import Scene
from motm_twin.record import channels as ch
from motm_twin.record import foxglove as fox
from motm_twin.record.channels import Channel, PlotsMessage, RecordedGrid, RecordedScene, RecordedSession
from motm_twin.record.foxglove import furniture, robot_model
from motm_twin.sessions.session import Session

INTERVAL = 0.1  # [s] between two messages of a drawn topic
SLOW = 0.25  # [s] for candidates
_TOLERANCE = 0.01  # [s] tolerance for a message that comes early
Add = Callable[[Channel, float, bytes], None]
Take = Callable[[bytes, bytes | None], None]  # payload, attachment
_DIGITS = 5


class Drawer:
    """Adds drawn messages to a recording, through ``add`` (channel, server time, JSON)."""

    def __init__(self, add: Add) -> None:
        self._add, self._encode = add, msgspec.json.Encoder().encode
        self._next: dict[str, float] = {}
        self._robot_shown, self._frames_known = False, False
        self._placement: messages.PlacementMessage | None = None

    def tick(self, tick: messages.TickMessage) -> None:
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

    def robot(self, robot: messages.RobotStateMessage) -> None:
        """The frames of the robot, and once its shape."""
        self._frames_known = True
        if not self._robot_shown:
            self._robot_shown = True
            self._put(ch.DRAWN_ROBOT, robot.server_time, robot_model(robot.server_time))
        if self._due(ch.DRAWN_FRAMES, robot.server_time, INTERVAL / 2):
            self._put(ch.DRAWN_FRAMES, robot.server_time, fox.transforms(robot))

    def scan(self, scan: messages.ScanMessage) -> None:
        """A sweep."""
        if self._due(ch.DRAWN_SCAN, scan.server_time):
            self._put(ch.DRAWN_SCAN, scan.server_time, fox.scan(scan))

    def scene(self, scene: Scene, server_time: float) -> None:
        """The furniture."""
        self._put(ch.DRAWN_FURNITURE, server_time, furniture(scene, server_time))

    def grid(self, info: messages.GridInfo, cells: bytes, server_time: float) -> None:
        """The map."""
        self._put(ch.DRAWN_GRID, server_time, fox.grid(info, cells, server_time))

    def event(self, event: messages.NumberedEvent) -> None:
        """A line of the log."""
        self._put(ch.DRAWN_LOG, event.server_time, fox.log(event.server_time, event.kind, event.text))

    def _due(self, channel: Channel, now: float, interval: float = INTERVAL) -> bool:
        due = self._next.get(channel.topic, 0.0)
        if due - 10.0 * interval < now < due - _TOLERANCE:  # farther back: the clock of another server
            return False
        self._next[channel.topic] = due + interval if due <= now < due + interval else now + interval
        return True

    def _put(self, channel: Channel, server_time: float, message: object) -> None:
        self._add(channel, server_time, self._encode(message))


_FROM_TICK = (ch.DRAWN_CANDIDATES, ch.PLOTS)


def plots(tick: messages.TickMessage) -> PlotsMessage:
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


STATUS_INTERVAL = 1.0  # [s] between two recorded status messages that say the same


class _TickPart(msgspec.Struct, frozen=True):
    """The part that is needed of every tick."""

    run: int
    server_time: float
    index: int
    began: float = 0.0
    preview: bool = False


class _Stamped(msgspec.Struct, frozen=True):
    server_time: float


class _OfRun(msgspec.Struct, frozen=True):
    run: int


class Stream:
    """Sorts payloads into ``add`` (channel, server time, JSON). ``wants_session``: the session should be asked for."""

    def __init__(self, keys: Keys, add: Add) -> None:
        self._write, self._drawer = add, Drawer(self._add)
        self._encode = msgspec.json.Encoder().encode
        self._part = msgspec.json.Decoder(_TickPart).decode
        self._tick = msgspec.json.Decoder(messages.TickMessage).decode
        self._take: dict[str, Take] = {
            keys.tick: self._on_tick,
            keys.grid: self._on_grid,
            keys.scene: self._on_scene,
            keys.status: self._on_status,
            keys.robot: self._kept(ch.ROBOT, messages.RobotStateMessage, self._drawer.robot),
            keys.scan: self._kept(ch.SCAN, messages.ScanMessage, self._drawer.scan),
            keys.event: self._kept(ch.EVENT, messages.NumberedEvent, self._drawer.event),
            keys.metrics: self._kept(ch.METRICS, _Stamped),
            keys.observations: self._kept(ch.OBSERVATIONS, _Stamped),
        }
        self._grid_key, self._of_a_run = keys.grid, (keys.tick, keys.grid, keys.robot, keys.observations)
        self._told_run: int | None = None  # of the newest status
        self.wants_session = False
        self.lost = 0  # periods that did not arrive
        self.now = 0.0  # [s] newest server time
        self._earliest = 0.0  # [s] no message is logged before: what is taken may be older than the recording
        self.run: tuple[float, int] | None = None  # began, number: of the newest tick
        self.index = -1
        self._grid = b""
        self._said: tuple = ()
        self._said_at = 0.0

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys that it takes."""
        return tuple(self._take)

    def take(self, key: str, payload: bytes, attachment: bytes | None, *, asked: bool = False) -> None:
        """Sort one payload in. Raises msgspec.MsgspecError for one that is not of its key.

        A last value that was ``asked`` for may be hours old, of a twin whose time stands. It is logged when it was
        heard, or the recording would begin where nothing was recorded.
        """
        self._earliest = self.now if asked else 0.0
        self._take[key](payload, attachment)

    def is_past(self, key: str, payload: bytes, attachment: bytes | None) -> bool:
        """True when a last value is of a run before the one that the status tells. Raises msgspec.MsgspecError.

        Until a robot in another program has begun its run, its twin still has the last period of the run before. That
        is hours old at times, and may be of another scene: no part of what is recorded.
        """
        if self._told_run is None or key not in self._of_a_run:
            return False
        about = attachment if key == self._grid_key else payload
        return msgspec.json.decode(about or b"null", type=_OfRun).run < self._told_run

    def session(self, payload: bytes, attachment: bytes | None) -> None:
        """Take the session of the run that its attachment names. Raises msgspec.MsgspecError."""
        info = msgspec.json.decode(attachment or b"null", type=messages.SessionInfo)
        session = msgspec.json.decode(payload, type=Session)
        recorded = RecordedSession(run=info.run, began=info.began, session=session)
        self._add(ch.SESSION, self.now, self._encode(recorded))

    def _kept(self, channel: Channel, kind: Any, draw: Callable[[Any], None] = lambda message: None) -> Take:
        """Messages of this kind are recorded as they come, and drawn."""
        decode = msgspec.json.Decoder(kind).decode

        def take(payload: bytes, _: bytes | None) -> None:
            message = decode(payload)
            self._add(channel, message.server_time, payload)
            draw(message)

        return take

    def _add(self, channel: Channel, log_time: float, data: bytes) -> None:
        self._write(channel, max(log_time, self._earliest), data)

    def _on_tick(self, payload: bytes, _: bytes | None) -> None:
        part = self._part(payload)
        self.now = max(part.server_time, self._earliest)
        if not part.preview:
            self._follow(part)
        self._add(ch.TICK, part.server_time, payload)
        if not part.preview and self._drawer.wants_tick(part.server_time):
            self._drawer.tick(self._tick(payload))

    def _follow(self, part: _TickPart) -> None:
        """Notice another run, and periods that are missing."""
        run = (part.began, part.run)
        if run != self.run:
            self.wants_session = True
        elif part.index > self.index + 1:
            self.lost += part.index - self.index - 1
            self.wants_session = True
        self.run, self.index = run, part.index

    def _on_grid(self, payload: bytes, attachment: bytes | None) -> None:
        info = msgspec.json.decode(attachment or b"null", type=messages.GridInfo)
        same = hashlib.sha256(payload + f"{info.run} {info.origin} {info.width}".encode()).digest()
        if same == self._grid:
            return  # sent again for late joiners
        self._grid = same
        self._add(ch.GRID, self.now, self._encode(RecordedGrid(info=info, cells=payload)))
        self._drawer.grid(info, payload, self.now)

    def _on_scene(self, payload: bytes, _: bytes | None) -> None:
        scene = msgspec.json.decode(payload, type=Scene)
        self._add(ch.SCENE, self.now, self._encode(RecordedScene(scene=scene)))
        self._drawer.scene(scene, self.now)

    def _on_status(self, payload: bytes, _: bytes | None) -> None:
        status = msgspec.json.decode(payload, type=messages.StatusMessage)
        self._told_run = status.run
        self.now = max(self.now, status.server_time)
        said = (status.run, status.state, status.text, status.speed, status.driver, status.plant_text, status.method)
        if said != self._said or abs(status.server_time - self._said_at) >= STATUS_INTERVAL:
            self._said, self._said_at = said, status.server_time
            self._add(ch.STATUS, status.server_time, payload)
