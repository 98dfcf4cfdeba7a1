"""What is selected: a ring under it, its name over it, and a knob in front of it to turn it by."""

import math
from dataclasses import dataclass

import numpy as np
import viser

from motm_twin.bus.messages import TickMessage
from motm_twin.model.scene_shapes import outline
from motm_twin.ui import colours
from motm_twin.ui.aim import Surroundings
from motm_twin.ui.drag import Drag, on_plane
from motm_twin.ui.hub import Hub, Visitor
from motm_twin.ui.rotation import yaw_wxyz

ROOT = "/selection"
CORNERS = 48  # of the ring
ROOM = 0.07  # [m] between the selected and its ring
STEM = 0.16  # [m] from the ring to the knob
KNOB = 0.055  # [m] its radius
FROZEN_SIGN = 0.2  # [m] the sign of a frozen body is high
SIGN_SIZE, SIGN_GAP = 0.78, 0.05  # of the name, and [m] over what is selected


@dataclass(frozen=True)
class Spot:
    """Where the selected stands: floor point or lower face [m], heading [rad], radius [m], whether it can be turned.

    And its height [m].
    """

    x: float
    y: float
    z: float
    heading: float
    radius: float
    turns: bool
    height: float


class SelectionView:
    """One ring, one name and one knob to turn by, for everybody."""

    def __init__(self, server: viser.ViserServer, hub: Hub, drag: Drag) -> None:
        add = server.scene
        self._drag = drag
        self._ring = add.add_line_segments(f"{ROOT}/ring", ring(1.0), colours.SELECTED, thickness=0.022, visible=False)
        self._stem = add.add_line_segments(f"{ROOT}/stem", _stem(1.0), colours.SELECTED, thickness=0.022, visible=False)
        self._knob = add.add_icosphere(
            f"{ROOT}/knob", radius=KNOB, color=colours.SELECTED, visible=False, cast_shadow=False, receive_shadow=False
        )
        self._sign = add.add_label(
            f"{ROOT}/name", "", font_screen_scale=SIGN_SIZE, anchor="bottom-center", depth_test=False, visible=False
        )
        self._knob.on_drag("left")(hub.watching(self._turn))
        self._radius = 0.0
        self._name = ""
        self._place = (0.0, 0.0)
        self._refused = False

    def update(self, name: str, tick: TickMessage, surroundings: Surroundings, *, live: bool) -> None:
        """Mark this; an empty or unknown name: nothing."""
        spot = spot_of(name, tick, surroundings) if name else None
        self._name = name
        turns = spot is not None and spot.turns and live
        shown, named = spot is not None, spot is not None and all(box.name != name for box in surroundings.now.bins)
        for handle, visible in ((self._ring, shown), (self._sign, named), (self._stem, turns), (self._knob, turns)):
            if handle.visible != visible:
                handle.visible = visible
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
        if self._sign.text != name:
            self._sign.text = name
        self._sign.position = (x, y, z + spot.height + SIGN_GAP)
        if turns:
            reach = spot.radius + STEM
            self._stem.wxyz = yaw_wxyz(heading)
            self._knob.position = (x + reach * math.cos(heading), y + reach * math.sin(heading), KNOB)

    def _turn(self, event: viser.SceneNodeDragEvent, visitor: Visitor) -> None:
        """The knob is dragged round: the body faces it."""
        if event.phase == "start":
            reason = self._drag.refusal(visitor)
            self._refused = bool(reason)
            if reason:
                self._drag.tell(visitor, reason)
        pointed = on_plane(np.asarray(event.client.camera.position), np.asarray(event.end_position), KNOB)
        if self._refused or not self._name or pointed is None:
            return
        (x, y), last = self._place, event.phase == "end"
        self._drag.turn(self._name, visitor, (x, y), math.atan2(pointed[1] - y, pointed[0] - x), last=last)


def spot_of(name: str, tick: TickMessage, surroundings: Surroundings) -> Spot | None:
    """Where the thing of this name stands; None when there is none."""
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
    x, y, heading = next(
        ((*body.position[:2], body.yaw) for body in tick.furniture if body.name == name), (*piece.centre, 0.0)
    )
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
