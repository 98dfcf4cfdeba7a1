"""Cubes, Temis and persons with their trails, and obstacles that somebody added."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import viser
from viser.transforms import SO3

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.assets import glb_bytes
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.scene.drag import SIGN, Drag
from motm_twin.ui.scene.furniture import glb, loose_box_mesh, loose_cylinder_mesh
from motm_twin.ui.scene.light import FLOOR, LYING, NO_SHADOW, box_shadow_glb, round_shadow_glb
from motm_twin.ui.scene.robot_view import COLOURED, add_lines

ROOT = "/bodies"
TRAIL_LENGTH = 48  # points
TRAIL_GAP = 0.06  # [m] between two of them
FASTEST = 3.0  # [m/s] a faster body was moved by hand: none drives or is thrown this fast
TRAIL_PAUSE = 1.0  # [s] longer than this, nobody knows how it came there
MESHES = {"temi": 0.97, "person": 1.75}  # [m] height of the mesh
FROZEN = "frozen"


@dataclass
class _Drawn:
    handle: viser.GlbHandle | viser.BoxHandle
    shape: tuple
    shadow: viser.GlbHandle | None = None
    sign: viser.LabelHandle | None = None  # that it is frozen
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
        self.on = True  # Temis, persons and their trails, and what the robot holds

    def show(self, scene: Scene) -> None:
        """Forget the bodies of the last scene."""
        for name in list(self._bodies):
            self._remove(name)
        self._colours = {item.name: colours.NAMED.get(item.colour, colours.NAMED["red"]) for item in scene.objects}

    def update(self, tick: TickMessage) -> None:
        """Draw the bodies of a tick; one that is held here is drawn under the pointer."""
        drawn = {f"object/{item.name}": item for item in tick.objects}
        drawn |= {f"body/{body.name}": body for body in (*tick.agents, *tick.obstacles)}
        for name, body in drawn.items():
            held, cube = self._drag.held(body.name), name.startswith("object/")
            x, y, z = (*body.position[:2], body.position[2] if cube else 0.0)
            yaw = body.yaw
            if held is not None:
                x, y, z = held.x, held.y, held.z + body.size[0] / 2 if cube else 0.0
                yaw = yaw if held.heading is None else held.heading
            self._place(name, body, (x, y, z, yaw), tick.time)
        for name in set(self._bodies) - set(drawn):
            self._remove(name)

    def update_trails(self) -> None:
        """Redraw the trails behind the Temis."""
        pieces, tones = [], []
        for drawn in self._bodies.values():
            if len(drawn.trail) > 1:
                points = np.array([(x, y, 0.012) for x, y in drawn.trail])
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


def _lengthen(trail: deque, place: tuple[float, float], seconds: float) -> None:
    """One more point; a new trail where the body did not come by itself: it was put there, or time went back."""
    reach = TRAIL_GAP + FASTEST * min(seconds, TRAIL_PAUSE)
    if trail and (seconds <= 0.0 or math.dist(trail[-1], place) > reach):
        trail.clear()
    if not trail or math.dist(trail[-1], place) > TRAIL_GAP:
        trail.append(place)
