"""Sorts what arrives from one twin into a recording: our messages as they came, and what is drawn of them.

Knows no transport and no clock; `recorder` feeds it.
"""

import hashlib
from collections.abc import Callable

import msgspec

from motm_twin.bus.keys import Keys
from motm_twin.bus.messages import (
    GridInfo,
    NumberedEvent,
    RobotStateMessage,
    ScanMessage,
    SessionInfo,
    StatusMessage,
    TickMessage,
)
from motm_twin.model.scene import Scene
from motm_twin.record import channels as ch
from motm_twin.record.channels import Channel, RecordedGrid, RecordedScene, RecordedSession
from motm_twin.record.drawer import Drawer
from motm_twin.sessions.session import Session

STATUS_INTERVAL = 1.0  # [s] between two recorded status messages that say the same

Add = Callable[[Channel, float, bytes], None]


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
        self._tick = msgspec.json.Decoder(TickMessage).decode
        self._robot_message = msgspec.json.Decoder(RobotStateMessage).decode
        self._take: dict[str, Callable[[bytes, bytes | None], None]] = {
            keys.tick: self._on_tick,
            keys.grid: self._on_grid,
            keys.scene: self._on_scene,
            keys.status: self._on_status,
            keys.robot: self._on_robot,
            keys.scan: self._on_scan,
            keys.event: self._on_event,
            keys.metrics: self._on_metrics,
            keys.observations: self._on_observations,
        }
        self._grid_key, self._of_a_run = keys.grid, (keys.tick, keys.grid, keys.robot, keys.observations)
        self._told_run: int | None = None  # of the newest status
        self.wants_session = False
        self.lost = 0  # periods that did not arrive
        self.plant = ""
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
        info = msgspec.json.decode(attachment or b"null", type=SessionInfo)
        session = msgspec.json.decode(payload, type=Session)
        recorded = RecordedSession(run=info.run, began=info.began, session=session)
        self._add(ch.SESSION, self.now, self._encode(recorded))

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
        info = msgspec.json.decode(attachment or b"null", type=GridInfo)
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
        status = msgspec.json.decode(payload, type=StatusMessage)
        self._told_run = status.run
        self.plant, self.now = status.plant, max(self.now, status.server_time)
        said = (status.run, status.state, status.text, status.speed, status.driver, status.plant_text, status.method)
        if said != self._said or abs(status.server_time - self._said_at) >= STATUS_INTERVAL:
            self._said, self._said_at = said, status.server_time
            self._add(ch.STATUS, status.server_time, payload)

    def _on_robot(self, payload: bytes, _: bytes | None) -> None:
        robot = self._robot_message(payload)
        self._add(ch.ROBOT, robot.server_time, payload)
        self._drawer.robot(robot)

    def _on_scan(self, payload: bytes, _: bytes | None) -> None:
        scan = msgspec.json.decode(payload, type=ScanMessage)
        self._add(ch.SCAN, scan.server_time, payload)
        self._drawer.scan(scan)

    def _on_event(self, payload: bytes, _: bytes | None) -> None:
        event = msgspec.json.decode(payload, type=NumberedEvent)
        self._add(ch.EVENT, event.server_time, payload)
        self._drawer.event(event)

    def _on_observations(self, payload: bytes, _: bytes | None) -> None:
        self._add(ch.OBSERVATIONS, msgspec.json.decode(payload, type=_Stamped).server_time, payload)

    def _on_metrics(self, payload: bytes, _: bytes | None) -> None:
        self._add(ch.METRICS, msgspec.json.decode(payload, type=_Stamped).server_time, payload)
