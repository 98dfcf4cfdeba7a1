"""Cubes, Temis and persons with their trails, added obstacles, and the tracks of the robot's tracker.

The arrow of a track ends at its position in one second. The ellipses show where it may be in 1 s and 2 s: they
grow with the uncertainty. A bold ring marks the track that the robot waits for, makes way for, or passes.
"""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple
from urllib.parse import quote

import numpy as np
import viser
from numpy.typing import NDArray
from viser.transforms import SO3

from motm_twin.bus.messages import BodyMessage, TickMessage, TrackMessage
from motm_twin.model.assets import glb_bytes
from motm_twin.model.reason import Kind
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.scene.drag import SIGN, Drag, ring
from motm_twin.ui.scene.furniture import glb, loose_box_mesh, loose_cylinder_mesh
from motm_twin.ui.scene.light import FLOOR, LYING, NO_SHADOW, box_shadow_glb, round_shadow_glb
from motm_twin.ui.scene.robot_view import COLOURED, add_lines

ROOT = "/bodies"
TRAIL_LENGTH = 48  # points
TRAIL_GAP = 0.06  # [m] between two points
FASTEST = 3.0  # [m/s] a faster body was moved by hand: bodies drive and fly slower
TRAIL_PAUSE = 1.0  # [s] longest motion assumed between two drawings; a larger jump begins a new trail
MESHES = {"temi": 0.97, "person": 1.75}  # [m] height of the mesh
FROZEN = "frozen"


@dataclass
class _Drawn:
    handle: viser.GlbHandle | viser.BoxHandle
    shape: tuple
    shadow: viser.GlbHandle | None = None
    sign: viser.LabelHandle | None = None  # says that it is frozen
    trail: deque = field(default_factory=lambda: deque(maxlen=TRAIL_LENGTH))
    place: tuple = ()
    time: float = 0.0  # [s] simulated, of the period it was drawn in


class BodyView:
    """One node per body, made when it first appears and removed when it is gone."""

    def __init__(self, server: viser.ViserServer, drag: Drag) -> None:
        self._server, self._drag = server, drag
        self._bodies: dict[str, _Drawn] = {}
        self._colours: dict[str, colours.Rgb] = {}
        self._trails = add_lines(server.scene, f"{ROOT}/trails", COLOURED, 0.02)
        self.on = True  # False hides Temis, persons and their trails, and the held cube

    def show(self, scene: Scene) -> None:
        """Forget the bodies of the last scene."""
        for name in list(self._bodies):
            self._remove(name)
        self._colours = {item.name: colours.of_cube(item.colour) for item in scene.objects}

    def update(self, tick: TickMessage) -> None:
        """Draw the bodies of a tick; a body that a visitor drags is drawn under the pointer."""
        bodies = {f"object/{_part(item.name)}": item for item in tick.objects}
        bodies |= {f"body/{_part(body.name)}": body for body in (*tick.agents, *tick.obstacles)}
        for name, body in bodies.items():
            held, cube = self._drag.held(body.name), name.startswith("object/")
            x, y, z = (*body.position[:2], body.position[2] if cube else 0.0)
            yaw = body.yaw
            if held is not None:
                x, y, z = held.x, held.y, held.z + body.size[0] / 2 if cube else 0.0
                yaw = yaw if held.heading is None else held.heading
            self._place(name, body, (x, y, z, yaw), tick.time)
        for name in set(self._bodies) - set(bodies):
            self._remove(name)

    def update_trails(self) -> None:
        """Redraw the trails behind Temis and persons."""
        pieces, tones = [], []
        for body in self._bodies.values():
            if len(body.trail) > 1:
                points = np.array([(x, y, 0.012) for x, y in body.trail])
                pieces.append(np.stack([points[:-1], points[1:]], axis=1))
                fade = np.linspace(0.0, 0.9, len(points) - 1)[:, None]
                tone = colours.linear(np.array(colours.PEOPLE) * fade + FLOOR * (1.0 - fade))
                tones.append(np.repeat(tone[:, None, :], 2, axis=1))
        self._trails.visible = bool(pieces) and self.on
        if pieces:
            self._trails.points = np.concatenate(pieces).astype(np.float32)
            self._trails.colors = np.concatenate(tones).astype(np.uint8)

    def _place(self, name: str, body: BodyMessage, place: tuple, time: float) -> None:
        """Draw one body at ``place``: x, y, z [m] and heading [rad]."""
        shape = (body.kind, tuple(body.size))
        if name in self._bodies and self._bodies[name].shape != shape:
            self._remove(name)
        if name not in self._bodies:
            self._bodies[name] = self._add(name, body, shape)
        drawn, mover = self._bodies[name], body.kind in MESHES
        if place != drawn.place:
            drawn.place, (x, y, z, yaw) = place, place
            drawn.handle.position, drawn.handle.wxyz = (x, y, z), SO3.from_z_radians(yaw).wxyz
            if drawn.shadow is not None:
                drawn.shadow.position = (x, y, LYING)
                if body.kind == "box":
                    drawn.shadow.wxyz = drawn.handle.wxyz
            if mover:
                _lengthen(drawn.trail, (x, y), time - drawn.time)
        drawn.time = time
        drawn.handle.visible = self.on or not (mover or body.state == "held")
        if drawn.shadow is not None:
            drawn.shadow.visible = drawn.handle.visible
        self._mark_frozen(name, drawn, body)

    def _mark_frozen(self, name: str, drawn: _Drawn, body: BodyMessage) -> None:
        frozen = body.state == FROZEN
        if drawn.sign is not None and not frozen:
            drawn.sign.remove()
            drawn.sign = None
        elif drawn.sign is None and frozen:
            place = (0.0, 0.0, body.size[2] + 0.08)
            drawn.sign = self._server.scene.add_label(
                f"{ROOT}/{name}/sign", "\N{SNOWFLAKE} frozen", position=place, depth_test=False, **SIGN
            )

    def _add(self, name: str, body: BodyMessage, shape: tuple) -> _Drawn:
        if name.startswith("object/"):
            colour, sides = self._colours.get(body.name, colours.NAMED["red"]), (body.size[0],) * 3
            box = self._server.scene.add_box(f"{ROOT}/{name}", color=colour, dimensions=sides, **NO_SHADOW)
            self._drag.attach_cube(box, body.name)
            return _Drawn(box, shape)
        add, scale = self._server.scene.add_glb, 1.0
        length, width, height = body.size[0], body.size[1], body.size[2] or 1.0
        if body.kind in MESHES:
            mesh, scale = glb_bytes(body.kind), height / MESHES[body.kind]
        elif body.kind == "cylinder":
            mesh = glb(loose_cylinder_mesh(length, height))
        else:
            mesh = glb(loose_box_mesh((length, width, height)))
        handle = add(f"{ROOT}/{name}", mesh, scale=scale, **NO_SHADOW)
        dark = box_shadow_glb(length, width, height) if body.kind == "box" else round_shadow_glb(length / 2, height)
        self._drag.attach(handle, body.name, where=lambda: (float(handle.position[0]), float(handle.position[1])))
        return _Drawn(handle, shape, add(f"{ROOT}/shadow/{name}", dark, **NO_SHADOW))

    def _remove(self, name: str) -> None:
        drawn = self._bodies.pop(name)
        for handle in (drawn.sign, drawn.handle, drawn.shadow):
            if handle is not None:
                handle.remove()


def _part(name: str) -> str:
    """A name as one part of a node's path, which overlay.js reads; quoted, so that a "/" makes no child node."""
    return quote(name, safe="")


def _lengthen(trail: deque, place: tuple[float, float], seconds: float) -> None:
    """Add a point; begin a new trail when the body was put there by hand, or time went back."""
    reach = TRAIL_GAP + FASTEST * min(seconds, TRAIL_PAUSE)
    if trail and (seconds <= 0.0 or math.dist(trail[-1], place) > reach):
        trail.clear()
    if not trail or math.dist(trail[-1], place) > TRAIL_GAP:
        trail.append(place)


TRACKS = "/tracks"
MOST = 12  # tracks drawn
SHADES = {1.0: 0.8, 2.0: 0.45}  # [s] ahead: share of the colour that the ellipse has
HEAD = 0.07  # [m] half the width of an arrow's head
STANDS = 0.1  # [m/s] a slower track has neither arrow nor ellipses; a slower robot counts as waiting
HEIGHT, OVER, BESIDE = 0.02, 0.15, 0.1  # [m] height of lines and of numbers; gap between a track and its ring
SOON = 4.0  # [s] a later encounter may still turn out otherwise
_CIRCLE = ring(1.0)


class Met(NamedTuple):
    """A track that the robot meets, and a phrase about it with a placeholder for its name."""

    track: TrackMessage
    words: str


class TrackView:
    """One node for all lines, one for the bold ring, and a label per track."""

    def __init__(self, server: viser.ViserServer) -> None:
        scene, look = server.scene, {"font_screen_scale": 0.75, "anchor": "center-center", "depth_test": True}
        self._lines = add_lines(scene, f"{TRACKS}/lines", COLOURED, 0.014)
        self._ring = add_lines(scene, f"{TRACKS}/met", colours.PEOPLE, 0.045, _CIRCLE)
        self._labels = [scene.add_label(f"{TRACKS}/number{k}", "", visible=False, **look) for k in range(MOST)]
        self.on = True

    def update(self, tick: TickMessage) -> None:
        """Draw the tracks of a tick."""
        tracks = tick.tracks[:MOST] if self.on else []
        drawn = [lines_of(track) for track in tracks if math.hypot(*track.velocity) >= STANDS]
        self._lines.visible = bool(drawn)
        if drawn:
            self._lines.points = np.concatenate([points for points, _ in drawn]).astype(np.float32)
            self._lines.colors = np.concatenate([tones for _, tones in drawn]).astype(np.uint8)
        found = met(tick) if self.on else None
        self._ring.visible = found is not None
        if found is not None:
            self._ring.position = (found.track.position[0], found.track.position[1], HEIGHT)
            self._ring.points = ring(round(found.track.radius + BESIDE, 2))
        for label, track in zip(self._labels, [*tracks, *[None] * MOST], strict=False):
            label.visible = track is not None
            if track is not None:
                label.text, label.position = f"{track.track}", _beside(track)


def _beside(track: TrackMessage) -> tuple[float, float, float]:
    """Place [m] of a number: at the tip of the arrow, and always outside of the body."""
    (x, y), (vx, vy), speed = track.position, track.velocity, math.hypot(*track.velocity)
    u, v = (vx / speed, vy / speed) if speed >= STANDS else (0.0, -1.0)
    away = max(speed, track.radius + 2.0 * BESIDE)
    return x + away * u, y + away * v, OVER


def met(tick: TickMessage) -> Met | None:
    """The track that the robot waits for, makes way for or passes, in this order; None without one."""
    if tick.done:
        return None
    plan, tracks = tick.plan, {track.track: track for track in tick.tracks}
    stands = abs(tick.robot.twist[0]) < STANDS
    if tick.why is not None and tick.why.about(Kind.MEETS_MOVER):
        nearest = _nearest(tick)
        return nearest and Met(nearest, "waiting for {}" if stands else "braking for {}")
    soon = [other for other in plan.encounters if other.time < SOON and other.track in tracks]
    if plan.why is not None and plan.why.kind == Kind.MAKES_WAY:
        evaded = next((tracks[other.track] for other in soon if other.yields == "robot"), None) or _nearest(tick)
        return evaded and Met(evaded, "making way for {}")
    for other in sorted(soon, key=lambda other: other.yields != "robot"):
        if other.passes:
            return Met(tracks[other.track], f"passing {other.passes}{' of' * (other.passes == 'in front')} {{}}")
        if other.yields:
            words = "{} gives way" if other.yields == "other" else "waiting for {}" if stands else "giving way to {}"
            return Met(tracks[other.track], words)
    return None


def _nearest(tick: TickMessage) -> TrackMessage | None:
    """The nearest track that moves."""
    here = tick.robot.true_pose[:2]
    moving = [track for track in tick.tracks if math.hypot(*track.velocity) >= STANDS]
    return min(moving, key=lambda track: math.dist(track.position, here) - track.radius, default=None)


def lines_of(track: TrackMessage) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Arrow and ellipses of a track: segments (n, 2, 3) [m], and their colours."""
    place, velocity = np.array([*track.position, HEIGHT]), np.array([*track.velocity, 0.0])
    pieces, shares = [_arrow(place, velocity)], [1.0]
    for time, x, y, along, across, way in track.expected:
        if time in SHADES:
            c, s = math.cos(way), math.sin(way)
            turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
            pieces.append(_CIRCLE * (along, across, 0.0) @ turn + (x, y, HEIGHT))
            shares.append(SHADES[time])
    tones = [np.tile(_tone(share), (len(piece), 2, 1)) for share, piece in zip(shares, pieces, strict=True)]
    return np.concatenate(pieces), np.concatenate(tones)


def _arrow(place: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
    """Arrow from a place to the place after one second, with a head, shape (3, 2, 3)."""
    tip, ahead = place + velocity, velocity / max(float(np.linalg.norm(velocity)), 1e-9)
    across = np.array([-ahead[1], ahead[0], 0.0])
    ends = [tip - HEAD * (2.0 * ahead + side * across) for side in (1.0, -1.0)]
    return np.array([(place, tip), *((end, tip) for end in ends)])


def _tone(share: float) -> NDArray[np.float64]:
    """Colour of people, blended by this share with the floor's colour; linear light, 0 to 255."""
    return colours.linear(np.array(colours.PEOPLE) * share + FLOOR * (1.0 - share))
