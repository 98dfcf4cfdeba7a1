"""Cameras: one per visitor, with presets; moves are eased, never cut.

A hand at the camera always wins: in a fixed view it makes the camera free; in one that rides along, the ride pauses
while the hand turns the view, and goes on from the new angle.
"""

import math
import threading
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import viser

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.ui.framing import FIELD_OF_VIEW, View, from_above, overview

PRESETS = ("Overview", "Top", "Follow", "Gripper", "Free")
RIDES = {  # eye and look-at point [m] in a frame that is level, has its x axis ahead, and moves with base or hand
    "Follow": (np.array([-2.6, 0.9, 1.9]), np.array([0.5, 0.0, 0.35])),
    "Gripper": (np.array([-0.10, -0.42, 0.30]), np.array([0.04, 0.0, -0.12])),
}
EASE = 0.7  # [s] of a move from one view to another
SWING = 1.6  # [1/s] how fast a ride turns with the robot
REST = 0.5  # [s] after the hand's last move the ride goes on
ECHO = 0.03  # [m] a reported camera this near to a sent one was not moved by hand
PANEL = 334  # [px] that the docked panel takes from the picture; a page tells its size before it is docked
NARROW = 700  # [px] of a page on which the panel lies over the picture
_MEMORY = 90  # sent poses that echoes are compared with
_MADE = np.array([-5.0, 0.0, 0.0])  # [m] where a page's camera is before Viser puts it anywhere: three.js's (0, 0, 5)


@dataclass
class _Eye:
    """The camera of one visitor."""

    mode: str = "Overview"
    sent: deque[Array] = field(default_factory=lambda: deque(maxlen=_MEMORY))
    look_at: Array | None = None  # [m] what it was sent last
    arrived: bool = False  # where it was sent last; before, no hand has moved it
    target: View | None = None  # of a fixed view
    aspect: float = 0.0  # that the target is for
    seen: float = 0.0  # aspect of the picture at the last update
    page_width: int = 0  # [px] when it came
    ease_from: View | None = None
    ease_start: float = 0.0
    heading: float | None = None  # [rad] of the ride's frame
    offset: View | None = None  # in the ride's frame, when a hand chose it
    hand_at: float = -math.inf  # when a hand moved it last


class Cameras:
    """The camera of every visitor."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server = server
        self._lock = threading.Lock()
        self._eyes: dict[int, _Eye] = {}
        self._scene: Scene | None = None
        self._base, self._hand = np.zeros(3), np.eye(4)
        self._beginnings = (_MADE, np.array(server.initial_camera.position))  # a slow page tells them late
        server.initial_camera.fov = FIELD_OF_VIEW
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)

    def show(self, scene: Scene) -> None:
        """Another scene: new visitors start in its overview, fixed views move to it."""
        with self._lock:
            self._scene, (position, look_at) = scene, overview(scene)
            for eye in self._eyes.values():
                eye.target = None
                eye.sent.append(position)  # a page that is only just coming may begin there
                eye.look_at = look_at
        self._server.initial_camera.position, self._server.initial_camera.look_at = position, look_at

    def choose(self, client: viser.ClientHandle, preset: str) -> None:
        """Move one visitor's camera to a preset, or let it ride along."""
        with self._lock:
            eye = self._eyes.get(client.client_id)
            if eye is None or preset not in PRESETS:
                return
            eye.mode, eye.target, eye.offset, eye.heading = preset, None, None, None
            eye.hand_at, eye.arrived = -math.inf, True
            _ease(eye, client)

    def mode(self, client: viser.ClientHandle) -> str:
        """Which preset a visitor has now."""
        with self._lock:
            eye = self._eyes.get(client.client_id)
            return "Free" if eye is None else eye.mode

    def update(self, pose: Array, hand: Array, dt: float) -> None:
        """Advance moves and rides; base pose, transform of the hand (4, 4), and time [s] since the last call."""
        now = time.monotonic()
        clients = self._server.get_clients()
        wanted: dict[int, View] = {}
        with self._lock:
            self._base, self._hand = pose, hand
            for number, eye in self._eyes.items():
                if number in clients and (view := self._view(eye, clients[number], now, dt)) is not None:
                    wanted[number] = view
                    eye.sent.append(view[0])
                    eye.look_at = view[1]
        for number, (position, look_at) in wanted.items():
            client = clients[number]
            with client.atomic():
                client.camera.position = position  # takes the look-at point along, so this comes first
                client.camera.look_at = look_at

    def _view(self, eye: _Eye, client: viser.ClientHandle, now: float, dt: float) -> View | None:
        """The pose to send, or None when there is nothing new."""
        before, eye.seen = eye.seen, _aspect(eye, client)
        if eye.mode in RIDES:
            goal = self._ride(eye, client, now, dt)
        elif eye.mode == "Free":
            goal = _widened(client, before, eye.seen)
        else:
            goal = self._fixed(eye, client)
        if goal is None or eye.ease_from is None:
            return goal
        part = min(1.0, (now - eye.ease_start) / EASE)
        smooth = part * part * (3.0 - 2.0 * part)
        start = eye.ease_from
        if part >= 1.0:
            eye.ease_from = None
            if eye.mode not in RIDES:
                eye.target = goal
        return start[0] + (goal[0] - start[0]) * smooth, start[1] + (goal[1] - start[1]) * smooth

    def _fixed(self, eye: _Eye, client: viser.ClientHandle) -> View | None:
        if self._scene is None:
            return None
        aspect = eye.seen
        if eye.ease_from is None and eye.target is not None and abs(aspect - eye.aspect) < 1e-3:
            return None
        eye.aspect = aspect
        view = overview(self._scene, aspect) if eye.mode == "Overview" else from_above(self._scene, aspect)
        if eye.ease_from is None:
            eye.target = view
        return view

    def _ride(self, eye: _Eye, client: viser.ClientHandle, now: float, dt: float) -> View | None:
        place, heading = self._frame(eye.mode)
        if eye.heading is None:
            eye.heading = heading
        eye.heading += math.remainder(heading - eye.heading, 2.0 * math.pi) * min(1.0, SWING * dt)
        c, s = math.cos(eye.heading), math.sin(eye.heading)
        R = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        if now - eye.hand_at < REST:
            eye.offset = (
                R.T @ (np.asarray(client.camera.position) - place), R.T @ (np.asarray(client.camera.look_at) - place)
            )  # fmt: skip
            return None
        position, look_at = eye.offset or RIDES[eye.mode]
        return place + R @ position, place + R @ look_at

    def _frame(self, mode: str) -> tuple[Array, float]:
        """Origin [m] and heading [rad] of what a ride is fixed to."""
        if mode == "Follow":
            return np.array([self._base[0], self._base[1], 0.0]), float(self._base[2])
        hand = self._hand[:3, 3]
        return hand, math.atan2(hand[1] - self._base[1], hand[0] - self._base[0])

    def _moved(self, number: int, camera: viser.CameraHandle) -> None:
        """The page tells where its camera is: moved by hand, or as it was sent."""
        position = np.asarray(camera.position)
        with self._lock:
            eye = self._eyes.get(number)
            if eye is None or eye.mode == "Free" or not eye.sent:
                return
            sent = np.array(eye.sent)
            there = bool(np.linalg.norm(sent[-1] - position) < ECHO) and (
                eye.look_at is None or bool(np.linalg.norm(eye.look_at - camera.look_at) < ECHO)
            )
            own = np.vstack([sent, self._beginnings])
            if not eye.arrived or np.linalg.norm(own - position, axis=1).min() < ECHO or _on_the_way(sent, position):
                eye.arrived |= there
                if not there and eye.mode not in RIDES and eye.ease_from is None:
                    # A page that begins puts its camera back after what it was sent; and Viser does not send what it
                    # has just been told, though it has sent something else since: send both again.
                    eye.target = None
                return
            eye.ease_from = None
            if eye.mode in RIDES:
                eye.hand_at = time.monotonic()
            else:
                eye.mode = "Free"

    async def _enter(self, client: viser.ClientHandle) -> None:
        number = client.client_id
        eye = _Eye(page_width=client.camera.image_width)
        eye.sent.append(np.array(client.camera.position))  # the page tells it again when its size changes
        with self._lock:
            if self._scene is not None:  # it may have told where it was before it began where it should
                position, eye.look_at = overview(self._scene)
                eye.sent.append(position)
            self._eyes[number] = eye

        async def moved(camera: viser.CameraHandle) -> None:
            self._moved(number, camera)

        client.camera.on_update(moved)

    async def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._eyes.pop(client.client_id, None)


def _aspect(eye: _Eye, client: viser.ClientHandle) -> float:
    """Width / height of the picture beside the panel."""
    width, height = client.camera.image_width, client.camera.image_height
    if width == eye.page_width and width > NARROW:
        width -= PANEL
    return width / max(height, 1)


def _widened(client: viser.ClientHandle, before: float, now: float) -> View | None:
    """A free camera that keeps what lies left and right in the picture when panels make that narrower, or wider."""
    if before <= 0.0 or now <= 0.0 or abs(now - before) < 1e-3:
        return None
    look_at = np.asarray(client.camera.look_at)
    return look_at + (np.asarray(client.camera.position) - look_at) * before / now, look_at


def _ease(eye: _Eye, client: viser.ClientHandle) -> None:
    eye.ease_from = (np.array(client.camera.position), np.array(client.camera.look_at))
    eye.ease_start = time.monotonic()


def _on_the_way(sent: Array, position: Array) -> bool:
    """Whether a point lies between two poses that were sent one after the other."""
    start, step = sent[:-1], np.diff(sent, axis=0)
    square = np.maximum((step**2).sum(axis=1), 1e-12)
    part = np.clip(((position - start) * step).sum(axis=1) / square, 0.0, 1.0)
    nearest = np.linalg.norm(start + part[:, None] * step - position, axis=1)
    return bool(len(nearest) and nearest.min() < ECHO)
