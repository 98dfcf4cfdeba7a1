"""What is selected: a ring under it, and a handle to turn it by."""

import math
from dataclasses import dataclass

import numpy as np
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.scene_shapes import outline
from motm_twin.ui import colours
from motm_twin.ui.aim import Surroundings
from motm_twin.ui.drag import Drag
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.rotation import yaw_wxyz

ROOT = "/selection"
CORNERS = 48  # of the ring
ROOM = 0.07  # [m] between the selected and its ring
GIZMO = 1.35  # radius of the handle, in rings


@dataclass(frozen=True)
class Spot:
    """Where the selected stands: floor point or lower face [m], heading [rad], radius [m], whether it can be turned."""

    x: float
    y: float
    z: float
    heading: float
    radius: float
    turns: bool


class SelectionView:
    """One ring and one handle for everybody."""

    def __init__(self, server: viser.ViserServer, hub: Hub, drag: Drag) -> None:
        self._hub, self._drag = hub, drag
        self._ring = server.scene.add_line_segments(
            f"{ROOT}/ring", ring(1.0), colours.SELECTED, thickness=0.03, visible=False
        )
        self._server = server
        self._gizmo: viser.TransformControlsHandle | None = None
        self._radius = 0.0
        self._name, self._spot = "", None
        self._turning = False

    def update(self, name: str, tick: TickMessage, surroundings: Surroundings, *, live: bool) -> None:
        """Mark this; an empty or unknown name: nothing."""
        spot = spot_of(name, tick, surroundings) if name else None
        self._name, self._spot = name, spot
        visible = spot is not None
        if self._ring.visible != visible:
            self._ring.visible = visible
        if spot is not None:
            held = self._drag.held(name)
            x, y, z = (spot.x, spot.y, spot.z) if held is None else (held.x, held.y, held.z)
            self._ring.position = (x, y, z + 0.016)
            if spot.radius != self._radius:
                self._radius = spot.radius
                self._ring.points = ring(spot.radius)
        self._update_gizmo(spot if live else None)

    def _update_gizmo(self, spot: Spot | None) -> None:
        if spot is None or not spot.turns:
            if self._gizmo is not None:
                self._gizmo.remove()
                self._gizmo, self._turning = None, False
            return
        scale = round(GIZMO * spot.radius, 2)
        if self._gizmo is not None and self._gizmo.scale != scale:
            self._gizmo.scale = scale
        if self._gizmo is None:
            self._gizmo = self._server.scene.add_transform_controls(
                f"{ROOT}/turn", scale=scale, line_width=3.0, active_axes=(True, True, False), disable_axes=True,
                disable_sliders=True, depth_test=False, opacity=0.9,
            )  # fmt: skip
            self._gizmo.on_update(self._hub.watching(self._turn))
        if not self._turning:
            held = self._drag.held(self._name)
            x, y = (spot.x, spot.y) if held is None else (held.x, held.y)
            self._gizmo.position, self._gizmo.wxyz = (x, y, 0.02), yaw_wxyz(spot.heading)

    def _turn(self, event: viser.TransformControlsEvent, visitor: Visitor) -> None:
        if self._spot is None or not self._name:
            return
        if event.phase == "start" and (reason := self._drag.refusal(visitor)):
            self._hub.tell(visitor, reason)
        if self._drag.refusal(visitor):
            return
        self._turning = event.phase != "end"
        w, _, _, z = event.target.wxyz
        heading = math.remainder(2.0 * math.atan2(float(z), float(w)), 2.0 * math.pi)
        place = (float(event.target.position[0]), float(event.target.position[1]))
        self._drag.turn(self._name, visitor, place, heading, last=not self._turning)


def spot_of(name: str, tick: TickMessage, surroundings: Surroundings) -> Spot | None:
    """Where the thing of this name stands; None when there is none."""
    for item in tick.objects:
        if item.name == name:
            x, y, z = item.position
            side = item.size[0]
            return Spot(x, y, z - side / 2, item.yaw, 0.72 * side + 0.03, False)
    for body in (*tick.agents, *tick.obstacles):
        if body.name == name:
            half = math.hypot(body.size[0], body.size[1]) / 2 if body.kind == "box" else body.size[0] / 2
            return Spot(body.position[0], body.position[1], 0.0, body.yaw, half + ROOM, True)
    for box in surroundings.now.bins:
        if box.name == name:
            return Spot(*box.centre, box.rim_z, box.yaw, 0.71 * box.side + 0.02, False)
    piece = surroundings.pieces.get(name)
    if piece is None or name in tick.removed:
        return None
    x, y, heading = next(
        ((*body.position[:2], body.yaw) for body in tick.furniture if body.name == name), (*piece.centre, 0.0)
    )
    bounds = np.array([outline(s.shape).bounds for s in surroundings.now.solids if s.name in piece.solids])
    reach = np.concatenate([bounds[:, :2], bounds[:, 2:]]) - (x, y)
    return Spot(x, y, 0.0, heading, round(float(np.linalg.norm(reach, axis=1).max()) + ROOM, 2), True)


def ring(radius: float) -> np.ndarray:
    """A circle about the origin, shape (n, 2, 3)."""
    turn = np.linspace(0.0, 2.0 * np.pi, CORNERS + 1)
    points = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.zeros_like(turn)], axis=1)
    return np.stack([points[:-1], points[1:]], axis=1).astype(np.float32)
