"""What moves beside the robot: cubes, Temis and persons with their trails, obstacles that somebody added."""

import math
from collections import deque
from dataclasses import dataclass, field

import numpy as np
import viser

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.assets import glb_bytes
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.drag import Drag
from motm_twin.ui.furniture import glb, loose_box_mesh, loose_cylinder_mesh
from motm_twin.ui.rotation import yaw_wxyz
from motm_twin.ui.scene_view import SHADOW_HEIGHT
from motm_twin.ui.shadows import box_shadow_glb, round_shadow_glb
from motm_twin.ui.textures import FLOOR

ROOT = "/bodies"
TRAIL_LENGTH = 48  # points
TRAIL_GAP = 0.06  # [m] between two of them
FASTEST = 3.0  # [m/s] what goes faster was put elsewhere: none walks or is thrown so
TRAIL_PAUSE = 1.0  # [s] longer than this, nobody knows how it came there
MESHES = {"temi": 0.97, "person": 1.75}  # [m] height of the mesh
LYING = SHADOW_HEIGHT + 0.002  # [m] shadows of bodies lie on those of furniture
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
        self._trails = server.scene.add_line_segments(
            f"{ROOT}/trails", np.zeros((1, 2, 3), dtype=np.float32), colours.TRAIL, thickness=0.02, visible=False
        )
        self.trails_on = self.movers_on = True

    def show(self, scene: Scene) -> None:
        """Forget the bodies of the last scene."""
        for drawn in list(self._bodies):
            self._remove(drawn)
        self._colours = {item.name: colours.NAMED.get(item.colour, colours.NAMED["red"]) for item in scene.objects}

    def update(self, tick: TickMessage) -> None:
        """Draw the bodies of a tick; one that is held here is drawn under the pointer."""
        present: set[str] = set()
        for body in tick.objects:
            held = self._drag.held(body.name)
            place = tuple(body.position) if held is None else (held.x, held.y, held.z + body.size[0] / 2)
            present.add(self._place(f"object/{body.name}", body, place, body.yaw, tick.time, False))
        for body in (*tick.agents, *tick.obstacles):
            held, yaw = self._drag.held(body.name), body.yaw
            x, y = body.position[:2]
            if held is not None:
                x, y = held.x, held.y
                yaw = body.yaw if held.heading is None else held.heading
            present.add(self._place(f"body/{body.name}", body, (x, y, 0.0), yaw, tick.time, True))
        for name in set(self._bodies) - present:
            self._remove(name)

    def update_trails(self) -> None:
        """Redraw the trails behind the Temis."""
        pieces, tones = [], []
        for drawn in self._bodies.values():
            if len(drawn.trail) > 1:
                points = np.array([(x, y, 0.012) for x, y in drawn.trail])
                pieces.append(np.stack([points[:-1], points[1:]], axis=1))
                fade = np.linspace(0.0, 0.9, len(points) - 1)[:, None]
                tone = np.array(colours.TRAIL) * fade + FLOOR * (1.0 - fade)
                tones.append(np.repeat(tone[:, None, :], 2, axis=1))
        self._trails.visible = bool(pieces) and self.trails_on
        if pieces:
            with self._server.atomic():
                self._trails.points = np.concatenate(pieces).astype(np.float32)
                self._trails.colors = np.concatenate(tones).astype(np.uint8)

    def _place(self, name: str, body: BodyMessage, position: tuple, yaw: float, time: float, loose: bool) -> str:
        shape = (body.kind, tuple(body.size))
        drawn = self._bodies.get(name)
        if drawn is not None and drawn.shape != shape:
            self._remove(name)
            drawn = None
        if drawn is None:
            drawn = self._add(name, body, loose)
            self._bodies[name] = drawn
        place = (*position, yaw)
        if place != drawn.place:
            drawn.place = place
            drawn.handle.position, drawn.handle.wxyz = position, yaw_wxyz(yaw)
            if drawn.shadow is not None:
                drawn.shadow.position = (position[0], position[1], LYING)
                if body.kind == "box":
                    drawn.shadow.wxyz = yaw_wxyz(yaw)
            if body.kind in MESHES:
                self._lengthen(drawn, position, time - drawn.time)
        drawn.time = time
        if body.kind in MESHES and drawn.handle.visible != self.movers_on:
            drawn.handle.visible = self.movers_on
            if drawn.shadow is not None:
                drawn.shadow.visible = self.movers_on
        self._mark_frozen(name, drawn, body)
        return name

    def _mark_frozen(self, name: str, drawn: _Drawn, body: BodyMessage) -> None:
        if (body.state == FROZEN) == (drawn.sign is not None):
            return
        if drawn.sign is not None:
            drawn.sign.remove()
            drawn.sign = None
        else:
            drawn.sign = self._server.scene.add_label(
                f"{ROOT}/{name}/sign", "\N{SNOWFLAKE} frozen", position=(0.0, 0.0, body.size[2] + 0.08),
                font_screen_scale=0.78, anchor="bottom-center", depth_test=False,
            )  # fmt: skip

    @staticmethod
    def _lengthen(drawn: _Drawn, position: tuple, seconds: float) -> None:
        """One more point; a new trail where the body did not come by itself: it was put there, or time went back."""
        trail = drawn.trail
        reach = TRAIL_GAP + FASTEST * min(seconds, TRAIL_PAUSE)
        if trail and (seconds <= 0.0 or math.dist(trail[-1], position[:2]) > reach):
            trail.clear()
        if not trail or math.dist(trail[-1], position[:2]) > TRAIL_GAP:
            trail.append((position[0], position[1]))

    def _add(self, name: str, body: BodyMessage, loose: bool) -> _Drawn:
        scene, path = self._server.scene, f"{ROOT}/{name}"
        shape = (body.kind, tuple(body.size))
        if not loose:
            side = body.size[0]
            box = scene.add_box(
                path, color=self._colours.get(body.name, colours.NAMED["red"]), dimensions=(side, side, side),
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            self._drag.attach_cube(box, body.name)
            return _Drawn(box, shape)
        length, width, height = body.size[0], body.size[1], body.size[2] or 1.0
        if body.kind in MESHES:
            mesh, scale = glb_bytes(body.kind), height / MESHES[body.kind]
        elif body.kind == "cylinder":
            mesh, scale = glb(loose_cylinder_mesh(length, height)), 1.0
        else:
            mesh, scale = glb(loose_box_mesh((length, width, height))), 1.0
        handle = scene.add_glb(path, mesh, scale=scale, cast_shadow=False, receive_shadow=False)
        dark = box_shadow_glb(length, width, height) if body.kind == "box" else round_shadow_glb(length / 2, height)
        shadow = scene.add_glb(f"{ROOT}/shadow/{name}", dark, cast_shadow=False, receive_shadow=False)
        self._drag.attach(handle, body.name, where=lambda: (float(handle.position[0]), float(handle.position[1])))
        return _Drawn(handle, shape, shadow)

    def _remove(self, name: str) -> None:
        drawn = self._bodies.pop(name)
        if drawn.sign is not None:
            drawn.sign.remove()
        drawn.handle.remove()
        if drawn.shadow is not None:
            drawn.shadow.remove()
