"""Dragging bodies over the floor by mouse; the twin is told through Zenoh, at most 20 times a second."""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import viser

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Answer
from motm_twin.model.edits import MoveBody, ReleaseBody

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

    def __init__(self, client: TwinClient, report: Callable[[str], None]) -> None:
        self._client, self._report = client, report
        self._lock = threading.Condition()
        self._held: dict[str, Point] = {}
        self._dirty: dict[str, Point] = {}
        self._released: list[str] = []
        self._grips: dict[tuple[int, str], _Grip] = {}
        self._stopping = False
        self._thread = threading.Thread(target=self._send, name="drag", daemon=True)
        self._thread.start()

    def target(self, name: str) -> Point | None:
        """Where a body is being dragged to now, or None."""
        with self._lock:
            return self._held.get(name)

    def attach(self, handle: viser.GlbHandle, name: str) -> None:
        """Make a drawn body draggable."""

        async def on_drag(event: viser.SceneNodeDragEvent) -> None:
            self._on_drag(name, event)

        handle.on_drag("left")(on_drag)

    def stop(self) -> None:
        """End the sending thread."""
        with self._lock:
            self._stopping = True
            self._lock.notify()
        self._thread.join(1.0)

    def _on_drag(self, name: str, event: viser.SceneNodeDragEvent) -> None:
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
            self._move(name, (pointed[0] + offset.x, pointed[1] + offset.y))

    def _move(self, name: str, place: Point) -> None:
        with self._lock:
            self._held[name] = self._dirty[name] = place
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
                moves = dict(self._dirty) or dict(self._held)
                released, self._released = self._released, []
                self._dirty = {}
            for name, (x, y) in moves.items():
                self._note(self._client.command(MoveBody(name=name, x=x, y=y)))
            for name in released:
                self._note(self._client.command(ReleaseBody(name=name)))
                with self._lock:
                    self._held.pop(name, None)
            time.sleep(INTERVAL)

    def _note(self, answer: Answer) -> None:
        if not answer.ok:
            self._report(answer.reason)


def on_plane(eye: np.ndarray, through: np.ndarray, height: float) -> Point | None:
    """Where the ray from ``eye`` through a point meets the horizontal plane at ``height`` [m]; None when it misses."""
    direction = through - eye
    if abs(direction[2]) < 1e-6:
        return None
    along = (height - eye[2]) / direction[2]
    if not 0.0 < along < 1e3:
        return None
    return float(eye[0] + along * direction[0]), float(eye[1] + along * direction[1])
