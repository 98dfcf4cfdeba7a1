"""What moves beside the robot: cubes, Temis with their trails, obstacles that somebody added."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
import viser

from motm_twin.bus.messages import BodyMessage, TickMessage
from motm_twin.model.assets import glb_bytes
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.drag import Drag
from motm_twin.ui.furniture import glb, loose_box_mesh, loose_cylinder_mesh, shadow_glb
from motm_twin.ui.rotation import yaw_wxyz

ROOT = "/bodies"
TRAIL_LENGTH = 48  # points
TRAIL_GAP = 0.06  # [m] between two of them
TEMI_HEIGHT = 0.97  # [m] of the mesh


@dataclass
class _Drawn:
    handle: viser.GlbHandle | viser.BoxHandle
    shape: tuple
    shadow: viser.GlbHandle | None = None
    trail: deque = field(default_factory=lambda: deque(maxlen=TRAIL_LENGTH))
    place: tuple = ()


class BodyView:
    """One node per body, made when it first appears and removed when it is gone."""

    def __init__(self, server: viser.ViserServer, drag: Drag) -> None:
        self._server, self._drag = server, drag
        self._bodies: dict[str, _Drawn] = {}
        self._colours: dict[str, colours.Rgb] = {}
        self._trails = server.scene.add_line_segments(
            f"{ROOT}/trails", np.zeros((1, 2, 3), dtype=np.float32), colours.TRAIL, thickness=0.025, visible=False
        )
        self.trails_on = True

    def show(self, scene: Scene) -> None:
        """Forget the bodies of the last scene."""
        for drawn in list(self._bodies):
            self._remove(drawn)
        self._colours = {item.name: colours.NAMED.get(item.colour, colours.NAMED["red"]) for item in scene.objects}

    def update(self, tick: TickMessage) -> None:
        """Draw the bodies of a tick; one that is being dragged here is drawn under the pointer."""
        present: set[str] = set()
        for body in tick.objects:
            present.add(self._place(f"object/{body.name}", body, tuple(body.position), False))
        for body in (*tick.agents, *tick.obstacles):
            held = self._drag.target(body.name)
            x, y = held or body.position[:2]
            present.add(self._place(f"body/{body.name}", body, (x, y, 0.0), True))
        for name in set(self._bodies) - present:
            self._remove(name)

    def update_trails(self) -> None:
        """Redraw the trails behind the Temis."""
        pieces, tones = [], []
        for drawn in self._bodies.values():
            if len(drawn.trail) > 1:
                points = np.array([(x, y, 0.012) for x, y in drawn.trail])
                pieces.append(np.stack([points[:-1], points[1:]], axis=1))
                fade = np.linspace(0.15, 1.0, len(points) - 1)[:, None]
                tone = np.array(colours.TRAIL) * fade + 216.0 * (1.0 - fade)
                tones.append(np.repeat(tone[:, None, :], 2, axis=1))
        self._trails.visible = bool(pieces) and self.trails_on
        if pieces:
            with self._server.atomic():
                self._trails.points = np.concatenate(pieces).astype(np.float32)
                self._trails.colors = np.concatenate(tones).astype(np.uint8)

    def _place(self, name: str, body: BodyMessage, position: tuple, loose: bool) -> str:
        shape = (body.kind, tuple(body.size))
        drawn = self._bodies.get(name)
        if drawn is not None and drawn.shape != shape:
            self._remove(name)
            drawn = None
        if drawn is None:
            drawn = self._add(name, body, loose)
            self._bodies[name] = drawn
        place = (*position, body.yaw)
        if place != drawn.place:
            drawn.place = place
            drawn.handle.position, drawn.handle.wxyz = position, yaw_wxyz(body.yaw)
            if drawn.shadow is not None:
                drawn.shadow.position, drawn.shadow.wxyz = (position[0], position[1], 0.006), yaw_wxyz(body.yaw)
            if body.kind == "temi":
                self._lengthen(drawn, position)
        return name

    @staticmethod
    def _lengthen(drawn: _Drawn, position: tuple) -> None:
        trail = drawn.trail
        if not trail or np.hypot(trail[-1][0] - position[0], trail[-1][1] - position[1]) > TRAIL_GAP:
            trail.append((position[0], position[1]))

    def _add(self, name: str, body: BodyMessage, loose: bool) -> _Drawn:
        scene, path = self._server.scene, f"{ROOT}/{name}"
        shape = (body.kind, tuple(body.size))
        if not loose:
            side = body.size[0]
            handle = scene.add_box(
                path, color=self._colours.get(body.name, colours.NAMED["red"]), dimensions=(side, side, side),
                cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
            return _Drawn(handle, shape)
        if body.kind == "temi":
            height = body.size[2] or 1.0
            handle = scene.add_glb(
                path, glb_bytes("temi"), scale=height / TEMI_HEIGHT, cast_shadow=False, receive_shadow=False
            )
        else:
            length, width, height = body.size
            mesh = (
                loose_cylinder_mesh(length, height)
                if body.kind == "cylinder"
                else loose_box_mesh((length, width, height))
            )
            handle = scene.add_glb(path, glb(mesh), cast_shadow=False, receive_shadow=False)
        shadow = scene.add_glb(
            f"{ROOT}/shadow/{name}", shadow_glb(*body.size[:2]), cast_shadow=False, receive_shadow=False
        )
        self._drag.attach(handle, body.name)
        return _Drawn(handle, shape, shadow)

    def _remove(self, name: str) -> None:
        drawn = self._bodies.pop(name)
        drawn.handle.remove()
        if drawn.shadow is not None:
            drawn.shadow.remove()
