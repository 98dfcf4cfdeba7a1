"""Tracks of people and Temis, as the robot follows them, and the one that it meets.

An arrow ends where somebody will be in one second. The ellipses hold its place 1 s and 2 s from now: the farther
ahead, the less sure. A bold ring marks the one that the robot waits for, makes way for, or passes.
"""

import math
from typing import NamedTuple

import numpy as np
import viser
from numpy.typing import NDArray

from motm_twin.bus.messages import TickMessage, TrackMessage
from motm_twin.model.reason import Kind
from motm_twin.ui import colours
from motm_twin.ui.scene.drag import ring
from motm_twin.ui.scene.light import FLOOR
from motm_twin.ui.scene.robot_view import COLOURED, add_lines

TRACKS = "/tracks"
MOST = 12  # that are drawn
SHADES = {1.0: 0.8, 2.0: 0.45}  # how much of the colour the ellipse after so many seconds has
HEAD = 0.07  # [m] half the width of an arrow's head
STANDS = 0.1  # [m/s] a slower one has neither arrow nor ellipses, and the robot waits when it is slower
HEIGHT, OVER, BESIDE = 0.02, 0.15, 0.1  # [m] of lines and numbers over the floor; of the ring beside a track
SOON = 4.0  # [s] a later encounter may still turn out otherwise
_CIRCLE = ring(1.0)


class Met(NamedTuple):
    """A track that the robot meets, and a phrase about it with a gap for its name."""

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
    """Place [m] of a number: at the tip of the arrow, outside of the body in any case."""
    (x, y), (vx, vy), speed = track.position, track.velocity, math.hypot(*track.velocity)
    u, v = (vx / speed, vy / speed) if speed >= STANDS else (0.0, -1.0)
    away = max(speed, track.radius + 2.0 * BESIDE)
    return x + away * u, y + away * v, OVER


def met(tick: TickMessage) -> Met | None:
    """The track that the robot waits for, makes way for or passes, in this order; None when it meets nobody."""
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
    """From a place to where it is after one second, with a head, shape (3, 2, 3)."""
    tip, ahead = place + velocity, velocity / max(float(np.linalg.norm(velocity)), 1e-9)
    across = np.array([-ahead[1], ahead[0], 0.0])
    ends = [tip - HEAD * (2.0 * ahead + side * across) for side in (1.0, -1.0)]
    return np.array([(place, tip), *((end, tip) for end in ends)])


def _tone(share: float) -> NDArray[np.float64]:
    """So much of the colour of people, on the floor."""
    return colours.linear(np.array(colours.PEOPLE) * share + FLOOR * (1.0 - share))
