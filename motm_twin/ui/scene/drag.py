"""Dragging, turning and throwing by mouse, and the marks of the selection: a ring, a name and a knob to turn it.

Moves are sent to the twin through Zenoh, at most 20 times a second; the newest place wins. A cube is different: it
follows the pointer over tops and floor on the page only, and the twin puts it down when it is released.
"""

import math
import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import viser
from viser.transforms import SO3

from motm_twin.bus.commands import Command
from motm_twin.bus.messages import TickMessage
from motm_twin.model.edits import MoveBody, MoveObject, ReleaseBody
from motm_twin.model.scene_shapes import outline
from motm_twin.ui import colours
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.scene.picking import Ray, Surroundings, furniture_poses

INTERVAL = 0.05  # [s] between two moves of one body
KEEP_ALIVE = 0.5  # [s] between repeated moves of a body that is held still
SETTLE = 0.25  # [s] a released body is drawn at its release until the twin has it there
THROW_WINDOW = 0.15  # [s] before the release, over which a throw is measured
THROW_FROM, THROW_UP_TO = 0.4, 2.5  # [m/s] slower is put down; faster is slowed to this
SELECTION = "/selection"
CORNERS = 48  # of the ring
ROOM = 0.07  # [m] between the selected thing and its ring
STEM = 0.16  # [m] from the ring to the knob
KNOB = 0.055  # [m] radius of the knob
FROZEN_SIGN = 0.2  # [m] height of the sign of a frozen body
SIGN: dict[str, Any] = {"font_screen_scale": 0.78, "anchor": "bottom-center"}  # of names over things
SIGN_GAP = 0.05  # [m] over the selected thing
Point = tuple[float, float]
Gesture = tuple[int | None, str]  # client, and what its pointer holds
DragHandle = viser.GlbHandle | viser.BoxHandle


@dataclass(frozen=True)
class _Grip:
    """Place of a body relative to the pointer that holds it, and the height of the pointer [m]."""

    x: float
    y: float
    height: float
    slack: float = 0.0  # [m] the body stays until the pointer has moved this far


@dataclass
class Held:
    """A body that a visitor holds: its desired place [m], and its heading [rad] while it is turned."""

    visitor: Visitor
    gesture: Gesture
    x: float
    y: float
    heading: float | None = None
    z: float = 0.0  # of a cube's lower face
    cube: bool = False
    changed: bool = True
    velocity: Point | None = None  # set at the release
    gone_at: float = 0.0
    trace: deque[tuple[float, float, float]] = field(default_factory=lambda: deque(maxlen=40))

    @property
    def free(self) -> bool:
        """True when it was released."""
        return self.velocity is not None

    @property
    def waits(self) -> bool:
        """True when there is something to send."""
        return self.free or (self.changed and not self.cube)


class Drag:
    """Bodies dragged by visitors of this page, sent to the twin from its own thread."""

    def __init__(self, hub: Hub) -> None:
        self._hub = hub
        self.surroundings: Surroundings | None = None  # tops and floors where a cube can be put
        self._lock = threading.Condition()
        self._held: dict[str, Held] = {}
        self._grips: dict[Gesture, _Grip | None] = {}  # None: the gesture was refused
        self._stopping = False
        self._thread = threading.Thread(target=self._send, name="drag", daemon=True)
        self._thread.start()

    def held(self, name: str) -> Held | None:
        """The hold on a body that is held or was just released; None when it is drawn where the twin has it."""
        with self._lock:
            return self._held.get(name)

    def attach(self, handle: DragHandle, name: str, *, where: Callable[[], Point], slack: float = 0.0) -> None:
        """Make a drawn body or piece draggable; ``where`` returns its place [m].

        ``slack``: distance [m] that the pointer must move before the thing does.
        """
        act = self._hub.watching(lambda event, visitor: self._on_drag(name, where, slack, event, visitor))
        handle.on_drag("left")(act)

    def attach_cube(self, handle: DragHandle, name: str) -> None:
        """Make a drawn cube draggable."""
        handle.on_drag("left")(self._hub.watching(lambda event, visitor: self._on_cube(name, event, visitor)))

    def turn(self, name: str, visitor: Visitor, gesture: Gesture, place: Point, heading: float) -> None:
        """Turn something on the spot to a heading [rad]."""
        with self._lock:
            held = self._hold(name, Held(visitor, gesture, *place))
            held.heading, held.changed = heading, True
            self._lock.notify()

    def leave(self, visitor: Visitor) -> None:
        """Release everything that a visitor holds."""
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

    def allowed(self, name: str, event: viser.SceneNodeDragEvent, visitor: Visitor) -> bool:
        """True when this gesture may go on; otherwise the visitor is told the reason once."""
        key = (event.client_id, name)
        if event.phase == "start":
            self._grips.pop(key, None)
            if reason := self._hub.refusal(visitor):
                self._grips[key] = None
                self._hub.tell(visitor, reason)
        refused = key in self._grips and self._grips[key] is None
        if event.phase == "end":
            self._grips.pop(key, None)
        return not refused

    def _hold(self, name: str, new: Held) -> Held:
        """The hold on something, a new one when nobody has it; called with the lock held."""
        held = self._held.get(name)
        if held is None or held.free:
            held = self._held[name] = new
        return held

    def _on_drag(
        self, name: str, where: Callable[[], Point], slack: float, event: viser.SceneNodeDragEvent, visitor: Visitor
    ) -> None:
        key = (event.client_id, name)
        grip = self._grips.get(key)
        if not self.allowed(name, event, visitor):
            return
        if grip is None or event.phase == "start":
            if event.phase == "end":
                self.release(name)
                return
            (x, y), taken = where(), event.start_position
            grip = self._grips[key] = _Grip(x - float(taken[0]), y - float(taken[1]), float(taken[2]), slack)
        pointed = on_plane(np.asarray(event.client.camera.position), np.asarray(event.end_position), grip.height)
        if pointed is not None:
            place = (pointed[0] + grip.x, pointed[1] + grip.y)
            if grip.slack and math.dist(place, where()) < grip.slack:
                return
            if grip.slack:
                self._grips[key] = replace(grip, slack=0.0)
            if self._hub.view.placing == name:
                self._hub.view.placing = ""  # it is being placed by hand
            self._move(name, visitor, key, place)
        if event.phase == "end":
            self.release(name)

    def _on_cube(self, name: str, event: viser.SceneNodeDragEvent, visitor: Visitor) -> None:
        if self.surroundings is None or not self.allowed(name, event, visitor):
            return
        put = self.surroundings.surface(Ray.through(event.client.camera.position, event.end_position))
        with self._lock:
            if put is not None:
                held = self._hold(name, Held(visitor, (event.client_id, name), 0.0, 0.0, cube=True))
                held.x, held.y, held.z = (float(value) for value in put)
            if event.phase == "end" and name in self._held:
                self._held[name].velocity = (0.0, 0.0)
                self._lock.notify()

    def _move(self, name: str, visitor: Visitor, gesture: Gesture, place: Point) -> None:
        with self._lock:
            held = self._hold(name, Held(visitor, gesture, *place))
            (held.x, held.y), held.changed = place, True
            held.trace.append((time.monotonic(), *place))
            self._lock.notify()

    def release(self, name: str) -> None:
        """Let go of something that is held, with the speed of the pointer."""
        with self._lock:
            held = self._held.get(name)
            if held is not None and not held.free:
                held.velocity = throw(list(held.trace), time.monotonic())
                self._lock.notify()

    def _send(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._stopping or any(h.waits for h in self._held.values()), KEEP_ALIVE)
                if self._stopping:
                    return
                orders = self._orders(time.monotonic())
            for name, visitor, command in orders:
                if not self._hub.command(visitor, command).ok:
                    with self._lock:  # refused: the body stays where the twin has it
                        held = self._held.pop(name, None)
                        if held is not None:
                            self._grips[held.gesture] = None
            with self._lock:  # a release does not wait
                self._lock.wait_for(
                    lambda: self._stopping or any(h.free and not h.gone_at for h in self._held.values()), INTERVAL
                )

    def _orders(self, now: float) -> list[tuple[str, Visitor, Command]]:
        """The commands that are due; called with the lock held."""
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


def throw(trace: list[tuple[float, float, float]], now: float) -> Point:
    """Velocity [m/s] at the release, from (time, x, y) of the last moves; (0, 0) when it was still or slow."""
    if len(trace) < 2 or now - trace[-1][0] > THROW_WINDOW:
        return 0.0, 0.0
    end = trace[-1]
    earlier = [entry for entry in trace if end[0] - entry[0] >= THROW_WINDOW]
    start = earlier[-1] if earlier else trace[0]  # longer ago on a slow page
    seconds = max(end[0] - start[0], INTERVAL)
    vx, vy = (end[1] - start[1]) / seconds, (end[2] - start[2]) / seconds
    speed = math.hypot(vx, vy)
    part = 0.0 if speed < THROW_FROM else min(1.0, THROW_UP_TO / speed)
    return vx * part, vy * part


def on_plane(eye: np.ndarray, through: np.ndarray, height: float) -> Point | None:
    """Meeting point of the ray from ``eye`` through a point with the plane at ``height`` [m]; None when it misses."""
    direction = through - eye
    if abs(direction[2]) < 1e-6:
        return None
    along = (height - eye[2]) / direction[2]
    if not 0.0 < along < 1e3:
        return None
    return float(eye[0] + along * direction[0]), float(eye[1] + along * direction[1])


@dataclass(frozen=True)
class Spot:
    """Place of something that can be selected: floor point or lower face [m]."""

    x: float
    y: float
    z: float
    heading: float  # [rad]
    radius: float  # [m]
    turns: bool  # it can be turned by hand
    height: float  # [m]


class SelectionView:
    """One ring, one name and one knob to turn by, for everybody."""

    def __init__(self, server: viser.ViserServer, hub: Hub, drag: Drag) -> None:
        add, hidden = server.scene, {"thickness": 0.022, "visible": False}
        self._drag = drag
        self._ring = add.add_line_segments(f"{SELECTION}/ring", ring(1.0), colours.SELECTED, **hidden)
        self._stem = add.add_line_segments(f"{SELECTION}/stem", _stem(1.0), colours.SELECTED, **hidden)
        self._knob = add.add_icosphere(
            f"{SELECTION}/knob", KNOB, colours.SELECTED, visible=False, cast_shadow=False, receive_shadow=False
        )
        self._sign = add.add_label(f"{SELECTION}/name", "", depth_test=False, visible=False, **SIGN)
        self._knob.on_drag("left")(hub.watching(self._turn))
        self._radius, self._name, self._place = 0.0, "", (0.0, 0.0)
        self._turned: dict[int | None, tuple[str, Point]] = {}  # by client: what its knob turns, and where that is

    def update(self, name: str, tick: TickMessage, surroundings: Surroundings, *, live: bool) -> None:
        """Mark the thing of this name; hide the marks when there is none. ``live``: show the knob that turns it."""
        spot = spot_of(name, tick, surroundings) if name else None
        self._name = name
        turns = spot is not None and spot.turns and live
        self._ring.visible = spot is not None
        self._sign.visible = spot is not None and all(box.name != name for box in surroundings.now.bins)
        self._stem.visible = self._knob.visible = turns
        if spot is None:
            return
        held = self._drag.held(name)
        x, y, z = (spot.x, spot.y, spot.z) if held is None else (held.x, held.y, held.z)
        heading = spot.heading if held is None or held.heading is None else held.heading
        self._place = (x, y)
        if spot.radius != self._radius:
            self._radius = spot.radius
            self._ring.points, self._stem.points = ring(spot.radius), _stem(spot.radius)
        self._ring.position = self._stem.position = (x, y, z + 0.016)
        self._sign.text, self._sign.position = name, (x, y, z + spot.height + SIGN_GAP)
        if turns:
            reach = spot.radius + STEM
            self._stem.wxyz = SO3.from_z_radians(heading).wxyz
            self._knob.position = (x + reach * math.cos(heading), y + reach * math.sin(heading), KNOB)

    def _turn(self, event: viser.SceneNodeDragEvent, visitor: Visitor) -> None:
        """Turn the body that was selected at the start of the gesture to face the dragged knob."""
        client, allowed = event.client_id, self._drag.allowed(SELECTION, event, visitor)
        if event.phase == "start":
            self._turned.pop(client, None)
        name, (x, y) = self._turned.setdefault(client, (self._name, self._place))
        if event.phase == "end":
            self._turned.pop(client, None)
        if not name or not allowed:
            return
        pointed = on_plane(np.asarray(event.client.camera.position), np.asarray(event.end_position), KNOB)
        if pointed is not None:
            self._drag.turn(name, visitor, (client, SELECTION), (x, y), math.atan2(pointed[1] - y, pointed[0] - x))
        if event.phase == "end":
            self._drag.release(name)


def spot_of(name: str, tick: TickMessage, surroundings: Surroundings) -> Spot | None:
    """Place of the thing of this name; None when there is none."""
    for item in tick.objects:
        if item.name == name:
            x, y, z = item.position
            side = item.size[0]
            return Spot(x, y, z - side / 2, item.yaw, 0.72 * side + 0.03, False, side)
    for body in (*tick.agents, *tick.obstacles):
        if body.name == name:
            half = math.hypot(body.size[0], body.size[1]) / 2 if body.kind == "box" else body.size[0] / 2
            height = body.size[2] + (FROZEN_SIGN if body.state == "frozen" else 0.0)
            return Spot(body.position[0], body.position[1], 0.0, body.yaw, half + ROOM, True, height)
    for box in surroundings.now.bins:
        if box.name == name:
            return Spot(*box.centre, box.rim_z, box.yaw, 0.71 * box.side + 0.02, False, 0.0)
    piece = surroundings.pieces.get(name)
    if piece is None or name in tick.removed:
        return None
    x, y, heading = furniture_poses(tick).get(name, (*piece.centre, 0.0))
    solids = [solid for solid in surroundings.now.solids if solid.name in piece.solids]
    bounds = np.array([outline(solid.shape).bounds for solid in solids])
    reach = np.concatenate([bounds[:, :2], bounds[:, 2:]]) - (x, y)
    radius, height = round(float(np.linalg.norm(reach, axis=1).max()) + ROOM, 2), max(solid.z_max for solid in solids)
    return Spot(x, y, 0.0, heading, radius, True, height)


def _stem(radius: float) -> np.ndarray:
    return np.array([[(radius, 0.0, 0.0), (radius + STEM, 0.0, 0.0)]], dtype=np.float32)


def ring(radius: float) -> np.ndarray:
    """A circle about the origin, shape (n, 2, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros_like(turn)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
