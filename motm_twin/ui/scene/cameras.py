"""Cameras: one per visitor, with presets; poses that show a scene; and visibility for a visitor.

Moves are eased, never cut. Manual control always wins: in a fixed view it makes the camera free; in a view
that rides along, the ride pauses while the view is turned, and continues from the new angle. The page reports when
mouse, finger or key may turn the view. A camera pose that it reports then, and that we did not send, is the visitor's.
"""

import itertools
import math
import threading
import time
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.geometry import Array
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.model.scene_shapes import outline
from motm_twin.ui.scene.picking import Ray, Surroundings

FIELD_OF_VIEW = math.radians(40.0)  # vertical
FROM_FAR = math.radians(9.0)  # of the plan view: narrow, so that upright lines appear as points
ASPECT = 1.18  # width / height of the picture beside the panel on a 1280 x 800 screen
SAME_ASPECT = 0.03  # share by which an aspect ratio may differ and keep the same pose
_EDGE = 0.93  # share of the picture that is used
BELOW = 0.12  # share of the picture's height that timeline and legend take
_FROM = np.array([-0.40, -0.72, 0.60])  # direction of the overview from the scene
_ABOVE = np.array([0.0, -0.002, 1.0])
_ROBOT = 0.45  # [m] kept free round the start
_TALL = 1.0  # [m] height kept in the picture over every point
View = tuple[Array, Array]  # position and look-at point [m]
PRESETS = ("Overview", "Top", "Follow", "Gripper", "Free")
RIDES = {  # eye and look-at point [m] in a level frame, x axis ahead, that moves with base or hand
    "Follow": (np.array([-2.6, 0.9, 1.9]), np.array([0.5, 0.0, 0.35])),
    "Gripper": (np.array([-0.10, -0.42, 0.30]), np.array([0.04, 0.0, -0.12])),
}
EASE = 0.7  # [s] of a move from one view to another
SWING = 1.6  # [1/s] how fast a ride turns with the robot
FRAMED = 1.2  # [m] from the hand to its target: within this the camera of the hand shows both
UNFRAMED = 0.25  # [m] between hand and target that fits without moving the camera back
REST = 0.5  # [s] after the visitor's last move the ride goes on
ECHO = 0.03  # [m] a reported camera this near to a sent one is its echo, not moved by hand
TURNED = 5.0  # [s] after mouse, finger or key: within this a reported pose may be theirs
PANEL = 334  # [px] width of the docked panel (overlay.js); used until a page reports its aspect ratio
NARROW = 700  # [px] largest width of a page whose panel lies over the picture (overlay.js)
ASPECTS = 0.1, 10.0  # width / height of a picture, at least and at most
_SIGHT_EDGE = 0.9  # share of the picture in which a body counts as seen
_PARTS = (0.35, 0.9)  # heights, as shares of the body's, that must both be in sight
_OWN = 0.3  # [m] a hit may lie before the point by this much: the body itself or its edge
NUDGE = 1e-2  # [m] shift that makes Viser take a position for a new one
_MEMORY = 90  # number of sent poses that echoes are compared with


def overview(scene: Scene, aspect: float = ASPECT, *, below: float = BELOW) -> View:
    """Position and look-at point [m] that show the whole of a scene from its front left.

    ``below``: share of the picture's height that stays free at its lower edge.
    """
    return _fitted(extent(scene), _FROM, aspect, below)


def from_above(scene: Scene, aspect: float = ASPECT) -> View:
    """Position and look-at point [m] for a plan view from far, with `FROM_FAR`; x to the right."""
    return _fitted(extent(scene), _ABOVE, aspect, BELOW, FROM_FAR)


def extent(scene: Scene) -> Array:
    """Points [m] that must be in the picture, shape (n, 3): furniture, start, ends of drives, ways of agents."""
    points: list[tuple[float, float, float]] = []
    for solid in scene.solids:
        if solid.style != "wall":
            x, y, u, v = outline(solid.shape).bounds
            points += itertools.product((x, u), (y, v), (0.0, solid.z_max))
    sent = [task.point for task in scene.tasks if isinstance(task, DriveTo)]
    for x, y in (scene.start[:2], *sent):
        points += itertools.product((x - _ROBOT, x + _ROBOT), (y - _ROBOT, y + _ROBOT), (0.0, _TALL))
    for agent in scene.agents:
        points += [(*place, z) for place in (agent.start[:2], *agent.waypoints) for z in (0.0, _TALL)]
    return np.array(points)


def _fitted(points: Array, direction: Array, aspect: float, below: float, fov: float = FIELD_OF_VIEW) -> View:
    """The nearest eye in a direction with all points centred within the picture, and its look-at point."""
    aspect = ASPECT if abs(aspect / ASPECT - 1.0) <= SAME_ASPECT else aspect
    forward = -direction / np.linalg.norm(direction)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    up = np.cross(right, forward)
    deep, tangent = points @ forward, math.tan(fov / 2)
    wide, lower, upper = _EDGE * tangent * aspect, (_EDGE - 2.0 * below) * tangent, _EDGE * tangent
    edges = (points @ right, wide, wide), (points @ up, lower, upper)  # per axis: points, slopes of both edges
    axes = [(low, high, np.max(-at - low * deep), np.max(at - high * deep)) for at, low, high in edges]
    back = min(-(before + behind) / (low + high) for low, high, before, behind in axes)  # both axes hold all points
    x, y = (0.5 * (behind - before + (high - low) * back) for low, high, before, behind in axes)  # centred
    position = x * right + y * up + back * forward
    along = (0.2 - position[2]) / forward[2]
    return position, position + along * forward


@dataclass
class _Eye:
    """The camera of one visitor."""

    mode: str = "Overview"
    sent: deque[Array] = field(default_factory=lambda: deque(maxlen=_MEMORY))
    look_at: Array | None = None  # [m] sent last
    target: View | None = None  # of a fixed view
    aspect: float = 0.0  # aspect of the picture that the target was computed for
    seen: float = 0.0  # aspect of the picture at the last update
    reported: float = 0.0  # aspect of the picture beside the panel, reported by the page; 0: not yet
    drawn: bool = False  # the page has drawn the scene since the last view was sent
    ease_from: View | None = None
    ease_start: float = -math.inf
    ease_fov: float = FIELD_OF_VIEW  # at the start of the move
    aside: Array = field(default_factory=lambda: np.zeros(3))  # [m] from the hand to the middle of the framed part
    heading: float | None = None  # [rad] of the ride's frame
    offset: View | None = None  # in the ride's frame, when the visitor has chosen it
    turned_at: float = -math.inf  # last time when mouse, finger or key may have turned it
    hand_at: float = -math.inf  # last time when they moved it


class Cameras:
    """The camera of every visitor."""

    def __init__(self, server: viser.ViserServer) -> None:
        self._server, self._lock = server, threading.Lock()
        self._eyes: dict[int, _Eye] = {}
        self._scene: Scene | None = None
        self._base, self._hand, self._target = np.zeros(3), np.eye(4), None
        server.initial_camera.fov = FIELD_OF_VIEW
        server.on_client_connect(self._enter)
        server.on_client_disconnect(self._leave)

    def show(self, scene: Scene) -> None:
        """Take another scene: new visitors start in its overview, fixed views move to it."""
        with self._lock:
            self._scene, (position, look_at) = scene, overview(scene)
            for eye in self._eyes.values():
                eye.target = None
                eye.sent.append(position)  # a page that is just opening may begin there
                eye.look_at = look_at
        self._server.initial_camera.position, self._server.initial_camera.look_at = position, look_at

    def choose(self, client: viser.ClientHandle, preset: str) -> None:
        """Move one visitor's camera to a preset, or let it ride along."""
        with self._lock:
            eye = self._eyes.get(client.client_id)
            if eye is None or preset not in PRESETS:
                return
            eye.mode, eye.target, eye.offset, eye.heading = preset, None, None, None
            eye.hand_at = eye.turned_at = -math.inf
            eye.ease_from = (np.array(client.camera.position), np.array(client.camera.look_at))
            eye.ease_start, eye.ease_fov = time.monotonic(), client.camera.fov

    def turned(self, client: viser.ClientHandle) -> None:
        """Take the page's report that mouse, finger or key may turn this visitor's view now."""
        with self._lock:
            if eye := self._eyes.get(client.client_id):
                eye.turned_at = time.monotonic()

    def tell_aspect(self, client: viser.ClientHandle, aspect: float) -> None:
        """Take the width / height of a page's picture, once its panel is docked."""
        with self._lock:
            if eye := self._eyes.get(client.client_id):
                eye.reported = max(ASPECTS[0], min(ASPECTS[1], float(aspect)))  # in this order nan becomes the maximum

    def drawn(self, client: viser.ClientHandle) -> None:
        """Send a fixed view once more to a page that has drawn the scene: an earlier one may have been lost."""
        with self._lock:
            if eye := self._eyes.get(client.client_id):
                eye.target, eye.drawn = None, True

    def mode(self, client: viser.ClientHandle) -> str:
        """Preset that a visitor has now."""
        with self._lock:
            return self._eyes.get(client.client_id, _Eye("Free")).mode

    def update(self, pose: Array, hand: Array, dt: float, *, ride: bool = True, target: Array | None = None) -> None:
        """Advance moves and rides; base pose, transform of the hand (4, 4), and time [s] since the last call.

        ``ride``: cameras that ride along move now, with a new tick; ``target``: point [m] for the hand to reach.
        """
        now = time.monotonic()
        clients = self._server.get_clients()
        views: dict[int, tuple[View, float, bool]] = {}
        with self._lock:
            self._base, self._hand, self._target = pose, hand, target
            for number, eye in self._eyes.items():
                if number not in clients:
                    continue
                view = self._view(eye, clients[number], now, dt)
                if view is not None and (ride or eye.mode not in RIDES or eye.ease_from is not None):
                    views[number] = view, self._fov(eye, clients[number], now), eye.drawn
                    eye.sent.append(view[0])
                    eye.look_at, eye.drawn = view[1], False
        for number, ((position, look_at), fov, again) in views.items():
            client = clients[number]
            with client.atomic():
                if again:  # Viser sends no equal value twice, and only the last one of its queue
                    client.camera.position = position + NUDGE
                client.camera.position = position  # moves the look-at point too, so this comes first
                client.camera.look_at = look_at
                client.camera.fov = fov

    def _fov(self, eye: _Eye, client: viser.ClientHandle, now: float) -> float:
        """Field of view [rad]; interpolated during a move, so that the middle of the picture keeps its size."""
        if eye.mode == "Free":
            return client.camera.fov
        goal = FROM_FAR if eye.mode == "Top" else FIELD_OF_VIEW
        return goal if eye.ease_from is None else _between(eye.ease_fov, goal, _eased(eye, now))

    def _view(self, eye: _Eye, client: viser.ClientHandle, now: float, dt: float) -> View | None:
        """The pose to send, or None when there is nothing new."""
        before, eye.seen = eye.seen, _aspect(eye, client)
        if eye.mode in RIDES:
            goal = self._ride(eye, client, now, dt)
        elif eye.mode == "Free":
            goal = _widened(client, before, eye.seen)
        else:
            goal = self._fixed(eye)
        if goal is None or eye.ease_from is None:
            return goal
        part, start, fov = _eased(eye, now), eye.ease_from, self._fov(eye, client, now)
        if part >= 1.0:
            eye.ease_from = None
            if eye.mode not in RIDES:
                eye.target = goal
        look_at = start[1] + (goal[1] - start[1]) * part
        ends = ((start, eye.ease_fov), (goal, FROM_FAR if eye.mode == "Top" else FIELD_OF_VIEW))
        near = [(view[0] - view[1]) * math.tan(end / 2) for view, end in ends]  # distances that show the same size
        return look_at + (near[0] + (near[1] - near[0]) * part) / math.tan(fov / 2), look_at

    def _fixed(self, eye: _Eye) -> View | None:
        if self._scene is None:
            return None
        if eye.ease_from is None and eye.target is not None and abs(eye.seen - eye.aspect) < 1e-3:
            return None
        eye.aspect = eye.seen
        view = (overview if eye.mode == "Overview" else from_above)(self._scene, eye.seen)
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
            camera = client.camera
            eye.offset = R.T @ (np.asarray(camera.position) - place), R.T @ (np.asarray(camera.look_at) - place)
            return None
        position, look_at = eye.offset or RIDES[eye.mode]
        if eye.mode != "Gripper":
            return place + R @ position, place + R @ look_at
        way = np.zeros(3) if self._target is None else self._target - place
        aim = 0.5 * way if np.linalg.norm(way) < FRAMED else np.zeros(3)
        eye.aside = eye.aside + (aim - eye.aside) * min(1.0, SWING * dt)
        span = 2.0 * float(np.linalg.norm(eye.aside))  # [m] between hand and target, which must both be visible
        return place + eye.aside + (1.0 + span / UNFRAMED) * (R @ position), place + eye.aside + R @ look_at

    def _frame(self, mode: str) -> tuple[Array, float]:
        """Origin [m] and heading [rad] of the frame that a ride is fixed to: base or hand."""
        if mode == "Follow":
            return np.array([self._base[0], self._base[1], 0.0]), float(self._base[2])
        hand = self._hand[:3, 3]
        return hand, math.atan2(hand[1] - self._base[1], hand[0] - self._base[0])

    def _moved(self, number: int, camera: viser.CameraHandle) -> None:
        """Take the page's report of its camera: moved by hand, or an echo of a sent pose."""
        position = np.asarray(camera.position)
        with self._lock:
            eye = self._eyes.get(number)
            if eye is None or eye.mode == "Free" or not eye.sent:
                return
            now, step = time.monotonic(), _step(np.array(eye.sent), position)
            for _ in range(step or 0):
                eye.sent.popleft()  # a page does not go back to an earlier pose
            arrived = step is not None and len(eye.sent) == 1
            there = arrived and (eye.look_at is None or bool(np.linalg.norm(eye.look_at - camera.look_at) < ECHO))
            if there or (step is not None and not arrived) or now - eye.turned_at > TURNED:
                if not there and eye.mode not in RIDES and eye.ease_from is None:
                    # A page that is opening puts its camera back after it was sent a pose; and Viser does not send a
                    # pose that the page has just reported, though it has sent another since: send both again.
                    eye.target = None
                return
            eye.ease_from = None
            if eye.mode in RIDES:
                eye.hand_at = now
            else:
                eye.mode = "Free"

    async def _enter(self, client: viser.ClientHandle) -> None:
        number, eye = client.client_id, _Eye()
        eye.sent.append(np.array(client.camera.position))  # the page reports it again when its size changes
        with self._lock:
            if self._scene is not None:  # a page may report its camera before it moves to the overview
                position, eye.look_at = overview(self._scene)
                eye.sent.append(position)
            self._eyes[number] = eye

        async def moved(camera: viser.CameraHandle) -> None:
            self._moved(number, camera)

        client.camera.on_update(moved)

    async def _leave(self, client: viser.ClientHandle) -> None:
        with self._lock:
            self._eyes.pop(client.client_id, None)


def _eased(eye: _Eye, now: float) -> float:
    """Share of a move that is done, from 0 to 1, with a smooth start and end."""
    part = min(1.0, (now - eye.ease_start) / EASE)
    return part * part * (3.0 - 2.0 * part)


def _between(start: float, goal: float, part: float) -> float:
    """Field of view [rad] at a share of a move; the camera distance that keeps sizes the same changes linearly."""
    return 2.0 * math.atan(1.0 / (1.0 / math.tan(start / 2) * (1.0 - part) + part / math.tan(goal / 2)))


def _aspect(eye: _Eye, client: viser.ClientHandle) -> float:
    """Width / height of the picture beside the panel."""
    width, height = client.camera.image_width, client.camera.image_height
    return eye.reported or (width - PANEL * (width > NARROW)) / max(height, 1)


def _widened(client: viser.ClientHandle, before: float, now: float) -> View | None:
    """A free camera adjusted so that panels do not crop the picture at the sides."""
    if before <= 0.0 or now <= 0.0 or abs(now - before) < 1e-3:
        return None
    look_at = np.asarray(client.camera.look_at)
    return look_at + (np.asarray(client.camera.position) - look_at) * before / now, look_at


def _step(sent: Array, position: Array) -> int | None:
    """Index of the sent position that a page is at, or has just left for the next; None without one.

    ``sent``: shape (n, 3). The last position is preferred, then the earliest.
    """
    step = np.diff(sent, axis=0, append=sent[-1:])
    square = np.maximum((step**2).sum(axis=1), 1e-12)
    part = np.clip(((position - sent) * step).sum(axis=1) / square, 0.0, 1.0)
    found = np.flatnonzero(np.linalg.norm(sent + part[:, None] * step - position, axis=1) < ECHO)
    last = len(sent) - 1
    return None if not len(found) else last if found[-1] == last else int(found[0])


class Visibility:
    """Visibility of bodies on the floor in one visitor's view."""

    def __init__(self, camera: viser.CameraHandle, surroundings: Surroundings, tick: TickMessage) -> None:
        self._eye, look_at = np.asarray(camera.position, float), np.asarray(camera.look_at, float)
        self._forward = (look_at - self._eye) / np.linalg.norm(look_at - self._eye)
        self._half = math.tan(camera.fov / 2)
        self._aspect = camera.image_width / max(camera.image_height, 1)
        self._surroundings, self._tick = surroundings, tick

    def sees(self, place: tuple[float, float], height: float) -> bool:
        """True when a body of this height [m] on the floor is in the picture and not occluded."""
        return all(self._sees(np.array([*place, part * height])) for part in _PARTS)

    def middle(self) -> tuple[float, float] | None:
        """The floor point [m] in the middle of the picture; None when the sky is there."""
        if self._forward[2] > -1e-6:
            return None
        point = self._eye - self._forward * self._eye[2] / self._forward[2]
        return float(point[0]), float(point[1])

    def _sees(self, point: Array) -> bool:
        right = np.cross(self._forward, [0.0, 0.0, 1.0])
        right /= max(float(np.linalg.norm(right)), 1e-9)
        ray = point - self._eye
        edge = _SIGHT_EDGE * self._half * float(ray @ self._forward)
        across, high = float(ray @ right), float(ray @ np.cross(right, self._forward))
        if not (edge > 0.0 and abs(high) < edge and abs(across) < edge * self._aspect):
            return False
        hit = self._surroundings.solid(Ray.through(self._eye, point), self._tick)
        return hit is None or hit.distance >= float(np.linalg.norm(ray)) - _OWN
