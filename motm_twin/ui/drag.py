"""Dragging bodies over the floor by mouse; the twin is told through Zenoh, at most 20 times a second."""

import threading
import time
from dataclasses import dataclass

import numpy as np
import viser

from motm_twin.model.edits import MoveBody, ReleaseBody
from motm_twin.ui.hub import Hub, Visitor

INTERVAL = 0.05  # [s] between two moves of one body
KEEP_ALIVE = 0.5  # [s] a body that is held still is held again this often
Point = tuple[float, float]


@dataclass(frozen=True)
class _Grip:
    """Where a body was taken: its place relative to the grip, and the height of the grip [m]."""

    x: float
    y: float
    height: float


class Drag:
    """Which bodies are held by visitors of this page, and where to. One thread sends; the newest place wins."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self._lock = threading.Condition()
        self._held: dict[str, tuple[Visitor, Point]] = {}
        self._dirty: set[str] = set()
        self._released: list[str] = []
        self._grips: dict[tuple[int, str], _Grip] = {}
        self._stopping = False
        self._thread = threading.Thread(target=self._send, name="drag", daemon=True)
        self._thread.start()

    def target(self, name: str) -> Point | None:
        """Where a body is being dragged to now, or None."""
        with self._lock:
            held = self._held.get(name)
            return None if held is None else held[1]

    def attach(self, handle: viser.GlbHandle, name: str) -> None:
        """Make a drawn body draggable."""
        handle.on_drag("left")(self._hub.watching(lambda event, visitor: self._on_drag(name, event, visitor)))

    def leave(self, visitor: Visitor) -> None:
        """Let go of everything that a visitor holds."""
        with self._lock:
            names = [name for name, (holder, _) in self._held.items() if holder is visitor]
        for name in names:
            self._release(name)

    def stop(self) -> None:
        """End the sending thread."""
        with self._lock:
            self._stopping = True
            self._lock.notify()
        self._thread.join(1.0)

    def _on_drag(self, name: str, event: viser.SceneNodeDragEvent, visitor: Visitor) -> None:
        if not self._hub.drives(visitor):
            return
        grip = (event.client_id, name)
        if event.phase == "end":
            self._grips.pop(grip, None)
            self._release(name)
            return
        if event.phase == "start" or grip not in self._grips:
            body, held = event.target.position, event.start_position
            self._grips[grip] = _Grip(float(body[0] - held[0]), float(body[1] - held[1]), float(held[2]))
        offset = self._grips[grip]
        pointed = on_plane(np.asarray(event.client.camera.position), np.asarray(event.end_position), offset.height)
        if pointed is not None:
            self._move(name, visitor, (pointed[0] + offset.x, pointed[1] + offset.y))

    def _move(self, name: str, visitor: Visitor, place: Point) -> None:
        with self._lock:
            self._held[name] = (visitor, place)
            self._dirty.add(name)
            self._lock.notify()

    def _release(self, name: str) -> None:
        with self._lock:
            if name in self._held:
                self._released.append(name)
                self._lock.notify()

    def _send(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._stopping or self._dirty or self._released, KEEP_ALIVE)
                if self._stopping:
                    return
                names = self._dirty or set(self._held)
                moves = [(name, *self._held[name]) for name in sorted(names) if name in self._held]
                released, self._released = self._released, []
                self._dirty = set()
            for name, visitor, (x, y) in moves:
                self._hub.command(visitor, MoveBody(name=name, x=x, y=y))
            for name in released:
                with self._lock:
                    visitor, _ = self._held.pop(name)
                self._hub.command(visitor, ReleaseBody(name=name))
            time.sleep(INTERVAL)


def on_plane(eye: np.ndarray, through: np.ndarray, height: float) -> Point | None:
    """Where the ray from ``eye`` through a point meets the horizontal plane at ``height`` [m]; None when it misses."""
    direction = through - eye
    if abs(direction[2]) < 1e-6:
        return None
    along = (height - eye[2]) / direction[2]
    if not 0.0 < along < 1e3:
        return None
    return float(eye[0] + along * direction[0]), float(eye[1] + along * direction[1])
