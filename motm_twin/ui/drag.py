"""Dragging, turning and throwing by mouse; the twin is told through Zenoh, at most 20 times a second.

A cube is different: it follows the pointer over tops and floor on the page, and is put down when it is let go.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
import viser

from motm_twin.bus.commands import Command
from motm_twin.model.edits import MoveBody, MoveObject, ReleaseBody
from motm_twin.ui.aim import Ray
from motm_twin.ui.hub import Hub, Visitor

INTERVAL = 0.05  # [s] between two moves of one body
KEEP_ALIVE = 0.5  # [s] a body that is held still is held again this often
SETTLE = 0.25  # [s] a body is drawn where it was let go, until the twin has it there
THROW_WINDOW = 0.15  # [s] before the release that a throw is measured over
THROW_FROM, THROW_UP_TO = 0.4, 2.5  # [m/s] slower is put down; faster is slowed to this
LOOKING_BACK = "looking back: return to live or branch from here"
Point = tuple[float, float]
DragHandle = viser.GlbHandle | viser.BoxHandle


@dataclass(frozen=True)
class _Grip:
    """Where a body was taken: its place relative to the grip, and the height of the grip [m]."""

    x: float
    y: float
    height: float
    slack: float = 0.0  # [m] it stays where it was until the hand has moved this far


@dataclass
class Held:
    """Something that a visitor holds: where it is wanted [m], and its heading [rad] when that is turned."""

    visitor: Visitor
    x: float
    y: float
    heading: float | None = None
    z: float = 0.0  # of a cube's lower face
    cube: bool = False
    changed: bool = True
    velocity: Point | None = None  # set when it is let go
    gone_at: float = 0.0
    trace: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=40))

    def move(self, x: float, y: float, now: float) -> None:
        """Want it there."""
        self.x, self.y, self.changed = x, y, True
        self.trace.append((now, x, y))

    @property
    def free(self) -> bool:
        """Whether it was let go."""
        return self.velocity is not None


class Drag:
    """What visitors of this page hold, and where to. One thread sends; the newest place wins."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self.live = True  # whether what is shown is now
        self.surface: Callable[[Ray], np.ndarray | None] = lambda _: None  # where a cube can be put
        self._lock = threading.Condition()
        self._held: dict[str, Held] = {}
        self._grips: dict[tuple[int, str], _Grip | None] = {}
        self._stopping = False
        self._thread = threading.Thread(target=self._send, name="drag", daemon=True)
        self._thread.start()

    def held(self, name: str) -> Held | None:
        """Where something is being held now, or was just let go; None: where the twin has it."""
        with self._lock:
            return self._held.get(name)

    def attach(self, handle: DragHandle, name: str, *, where: Callable[[], Point], slack: float = 0.0) -> None:
        """Make a drawn body or piece draggable; ``where`` tells its place [m].

        ``slack``: how far [m] the hand must move before the thing does.
        """
        act = self._hub.watching(lambda event, visitor: self._on_drag(name, where, slack, event, visitor))
        handle.on_drag("left")(act)

    def attach_cube(self, handle: DragHandle, name: str) -> None:
        """Make a drawn cube draggable."""
        handle.on_drag("left")(self._hub.watching(lambda event, visitor: self._on_cube(name, event, visitor)))

    def turn(self, name: str, visitor: Visitor, place: Point, heading: float, *, last: bool) -> None:
        """Turn something on the spot to a heading [rad]; ``last``: and let it go."""
        with self._lock:
            held = self._held.get(name)
            if held is None or held.free:
                held = self._held[name] = Held(visitor, *place)
            held.heading, held.changed = heading, True
            if last:
                held.velocity = (0.0, 0.0)
            self._lock.notify()

    def refusal(self, visitor: Visitor) -> str:
        """Why this visitor may not move anything now; empty when he may."""
        if not self._hub.drives(visitor):
            status = self._hub.client.status()
            return f"{status.driver_name if status else 'somebody else'} is driving"
        return "" if self.live else LOOKING_BACK

    def tell(self, visitor: Visitor, text: str) -> None:
        """A note to a visitor."""
        self._hub.tell(visitor, text)

    def leave(self, visitor: Visitor) -> None:
        """Let go of everything that a visitor holds."""
        with self._lock:
            for held in self._held.values():
                if held.visitor is visitor and not held.free:
                    held.velocity = (0.0, 0.0)
            self._lock.notify()

    def stop(self) -> None:
        """End the sending thread."""
        with self._lock:
            self._stopping = True
            self._lock.notify()
        self._thread.join(1.0)

    def _started(self, name: str, event: viser.SceneNodeDragEvent, visitor: Visitor) -> bool:
        """Whether this gesture may go on; said once when not."""
        key = (event.client_id, name)
        if event.phase == "start":
            self._grips.pop(key, None)
            reason = self.refusal(visitor)
            if reason:
                self._grips[key] = None
                self._hub.tell(visitor, reason)
        refused = key in self._grips and self._grips[key] is None
        if event.phase == "end":
            self._grips.pop(key, None)
        return not refused

    def _on_drag(
        self, name: str, where: Callable[[], Point], slack: float, event: viser.SceneNodeDragEvent, visitor: Visitor
    ) -> None:
        key = (event.client_id, name)
        offset = self._grips.get(key)
        if not self._started(name, event, visitor):
            return
        if offset is None or event.phase == "start":
            if event.phase == "end":
                self._release(name)
                return
            (x, y), taken = where(), event.start_position
            offset = self._grips[key] = _Grip(x - float(taken[0]), y - float(taken[1]), float(taken[2]), slack)
        eye = np.asarray(event.client.camera.position)
        pointed = on_plane(eye, np.asarray(event.end_position), offset.height)
        if pointed is not None:
            place = (pointed[0] + offset.x, pointed[1] + offset.y)
            if offset.slack and math.dist(place, where()) < offset.slack:
                return
            if offset.slack:
                self._grips[key] = replace(offset, slack=0.0)
            if self._hub.view.placing == name:
                self._hub.view.placing = ""  # it is being put by hand
            self._move(name, visitor, place)
        if event.phase == "end":
            self._release(name)

    def _on_cube(self, name: str, event: viser.SceneNodeDragEvent, visitor: Visitor) -> None:
        if not self._started(name, event, visitor):
            return
        put = self.surface(Ray.through(event.client.camera.position, event.end_position))
        with self._lock:
            if put is not None:
                held = self._held.get(name)
                if held is None or held.free:
                    held = self._held[name] = Held(visitor, 0.0, 0.0, cube=True)
                held.x, held.y, held.z = (float(value) for value in put)
            if event.phase == "end" and name in self._held:
                self._held[name].velocity = (0.0, 0.0)
                self._lock.notify()

    def _move(self, name: str, visitor: Visitor, place: Point) -> None:
        with self._lock:
            held = self._held.get(name)
            if held is None or held.free:
                held = self._held[name] = Held(visitor, *place)
            held.move(*place, time.monotonic())
            self._lock.notify()

    def _release(self, name: str) -> None:
        with self._lock:
            held = self._held.get(name)
            if held is not None and not held.free:
                held.velocity = throw(list(held.trace), time.monotonic())
                self._lock.notify()

    def _send(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._stopping or any(map(_waiting, self._held.values())), KEEP_ALIVE)
                if self._stopping:
                    return
                orders = self._orders(time.monotonic())
            for name, visitor, command in orders:
                if not self._hub.command(visitor, command).ok:
                    with self._lock:  # refused: it stays where the twin has it
                        self._held.pop(name, None)
                        for key in [key for key in self._grips if key[1] == name]:
                            self._grips[key] = None
            with self._lock:  # a release does not wait
                self._lock.wait_for(lambda: self._stopping or any(map(_let_go, self._held.values())), INTERVAL)

    def _orders(self, now: float) -> list[tuple[str, Visitor, Command]]:
        """What is to be sent now; called with the lock held."""
        orders: list[tuple[str, Visitor, Command]] = []
        still = not any(held.changed for held in self._held.values())
        for name, held in sorted(self._held.items()):
            if held.gone_at:
                if now - held.gone_at > SETTLE:
                    del self._held[name]
                continue
            if held.cube:
                if held.free:
                    orders.append((name, held.visitor, MoveObject(name=name, x=held.x, y=held.y)))
            elif held.changed or still:
                orders.append((name, held.visitor, MoveBody(name=name, x=held.x, y=held.y, heading=held.heading)))
            held.changed = False
            if held.velocity is not None:
                if not held.cube:
                    orders.append((name, held.visitor, ReleaseBody(name=name, velocity=held.velocity)))
                held.gone_at = now if held.velocity == (0.0, 0.0) else now - SETTLE
        return orders


def _waiting(held: Held) -> bool:
    return bool(held.gone_at) or held.free or (held.changed and not held.cube)


def _let_go(held: Held) -> bool:
    return held.free and not held.gone_at


def throw(trace: list[tuple[float, float, float]], now: float) -> Point:
    """Velocity [m/s] at the release, from (time, x, y) of the last moves; (0, 0) when it was held still or slow."""
    if len(trace) < 2 or now - trace[-1][0] > THROW_WINDOW:
        return 0.0, 0.0
    end = trace[-1]
    earlier = [entry for entry in trace if end[0] - entry[0] >= THROW_WINDOW]
    start = earlier[-1] if earlier else trace[0]  # on a slow page this is longer ago
    seconds = max(end[0] - start[0], INTERVAL)
    vx, vy = (end[1] - start[1]) / seconds, (end[2] - start[2]) / seconds
    speed = float(np.hypot(vx, vy))
    if speed < THROW_FROM:
        return 0.0, 0.0
    part = min(1.0, THROW_UP_TO / speed)
    return vx * part, vy * part


def on_plane(eye: np.ndarray, through: np.ndarray, height: float) -> Point | None:
    """Where the ray from ``eye`` through a point meets the horizontal plane at ``height`` [m]; None when it misses."""
    direction = through - eye
    if abs(direction[2]) < 1e-6:
        return None
    along = (height - eye[2]) / direction[2]
    if not 0.0 < along < 1e3:
        return None
    return float(eye[0] + along * direction[0]), float(eye[1] + along * direction[1])
