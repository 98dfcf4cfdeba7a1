"""Top view of the world for `render_mode="rgb_array"`: drawn with Pillow at twice the size, then scaled down."""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from motm_twin.gym.observation import AgentView
from motm_twin.model.arm_kernels import TCP, fk_arm
from motm_twin.model.geometry import Array, from_frame, rectangle
from motm_twin.model.plant import BodyTruth, Truth
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene
from motm_twin.ui.colours import BRAND, NAMED, PEOPLE, TARGET, WAY_THERE, Rgb

WIDTH = 800  # pixels
HEADER = 26  # pixels of the line of text
FINER = 2  # drawn this much larger
TRAIL_POINTS = 400  # of the way the base has come
FLOOR, TABLE, LOW, WALL, INK = (246, 246, 243), (205, 178, 140), (224, 208, 184), (120, 124, 130), (40, 44, 52)
BODY, ARM, AGENT, SCAN = (58, 68, 84), (235, 236, 238), (233, 120, 60), (214, 60, 60)
_LINKS = (0, 2, 3, 4, 6, 8, TCP)  # frames of the arm that its line passes


class TopView:
    """Draws one scene and the path of the base so far."""

    def __init__(self, scene: Scene) -> None:
        x_min, y_min, x_max, y_max = scene.bounds
        self._scene = scene
        self._scale = FINER * WIDTH / (x_max - x_min)  # pixels per metre
        height = round((y_max - y_min) * self._scale / FINER)
        self._corner = np.array([x_min, y_max])
        self._size = (FINER * WIDTH, FINER * (height + HEADER))
        self._font = ImageFont.load_default(size=FINER * 14)
        self._backdrop = self._furniture()
        self._trail: list[tuple[float, float]] = []

    def follow(self, truth: Truth) -> None:
        """Remember where the base has been."""
        here = (float(truth.pose[0]), float(truth.pose[1]))
        if not self._trail or math.dist(here, self._trail[-1]) > 0.03:
            self._trail = [*self._trail[-TRAIL_POINTS:], here]

    def draw(self, truth: Truth, view: AgentView, counts: str) -> NDArray[np.uint8]:
        """The picture of now, shape (height, width, 3); ``counts``: words for its line of text."""
        image = self._backdrop.copy()
        pen = ImageDraw.Draw(image)
        self._scan(pen, truth, view)
        if len(self._trail) > 1:
            pen.line(self._pixels(self._trail), fill=PEOPLE, width=FINER, joint="curve")
        for body in truth.obstacles:
            self._body(pen, body, LOW)
        for body in truth.agents:
            self._agent(pen, body)
        self._robot(pen, truth, view)
        for body in truth.objects:
            self._body(pen, body, NAMED["red"] if body.state != "held" else NAMED["orange"])
        if view.target is not None:
            self._disc(pen, view.target.position, 0.12, outline=TARGET, width=2 * FINER)
        self._header(pen, view, counts)
        small = image.resize((self._size[0] // FINER, self._size[1] // FINER), Image.Resampling.BOX)
        return np.asarray(small, dtype=np.uint8)

    def _pixels(self, points: Array | Sequence) -> list[tuple[float, float]]:
        """World points (n, 2) [m] on the picture; x to the right, y up."""
        offset = np.asarray(points, dtype=float)[:, :2] - self._corner
        return [(float(x * self._scale), float(FINER * HEADER - y * self._scale)) for x, y in offset]

    def _furniture(self) -> Image.Image:
        image = Image.new("RGB", self._size, FLOOR)
        pen = ImageDraw.Draw(image)
        self._grid(pen)
        for solid in sorted(self._scene.solids, key=lambda solid: solid.z_max):
            colour = {"wall": WALL, "table": TABLE, "desk": TABLE}.get(solid.style, LOW)
            shape = solid.shape
            if isinstance(shape, Cylinder):
                self._disc(pen, shape.centre, shape.radius, fill=colour, outline=INK)
            else:
                pen.polygon(self._pixels(_corners(shape)), fill=colour, outline=INK)
        for place in self._scene.bins:
            self._bin(pen, place)
        return image

    def _grid(self, pen: ImageDraw.ImageDraw) -> None:
        """A line each metre."""
        x_min, y_min, x_max, y_max = self._scene.bounds
        lines = [[(x, y_min), (x, y_max)] for x in range(math.ceil(x_min), math.floor(x_max) + 1)]
        lines += [[(x_min, y), (x_max, y)] for y in range(math.ceil(y_min), math.floor(y_max) + 1)]
        for line in lines:
            pen.line(self._pixels(line), fill=(232, 232, 228), width=FINER)

    def _bin(self, pen: ImageDraw.ImageDraw, place: Bin) -> None:
        frame, inner = (*place.centre, place.yaw), place.side - 2.0 * max(place.wall, 0.02)
        pen.polygon(self._pixels(rectangle(frame, (place.side, place.side))), fill=BRAND, outline=INK)
        pen.polygon(self._pixels(rectangle(frame, (inner, inner))), fill=(176, 200, 222))

    def _disc(self, pen: ImageDraw.ImageDraw, centre: Sequence[float] | Array, radius: float, **style: Any) -> None:
        (x, y), r = self._pixels([centre])[0], radius * self._scale
        pen.ellipse((x - r, y - r, x + r, y + r), **style)

    def _body(self, pen: ImageDraw.ImageDraw, body: BodyTruth, colour: Rgb) -> None:
        corners = rectangle((*body.position[:2], body.yaw), body.size)
        pen.polygon(self._pixels(corners), fill=colour, outline=INK)

    def _agent(self, pen: ImageDraw.ImageDraw, body: BodyTruth) -> None:
        centre, radius = np.array(body.position[:2]), 0.5 * body.size[0]
        self._disc(pen, centre, radius, fill=AGENT, outline=INK)
        nose = centre + radius * np.array([math.cos(body.yaw), math.sin(body.yaw)])
        pen.line(self._pixels([centre, nose]), fill=INK, width=2 * FINER)

    def _scan(self, pen: ImageDraw.ImageDraw, truth: Truth, view: AgentView) -> None:
        """Points of the lidar, as they truly are."""
        scan = view.observation.scan
        if scan is None:
            return
        seen = np.flatnonzero(np.isfinite(scan.ranges))
        angles = scan.angle_min + scan.angle_step * seen
        points = scan.origin + (scan.ranges[seen] * np.stack((np.cos(angles), np.sin(angles)))).T
        for x, y in self._pixels(from_frame(truth.pose, points)):
            pen.rectangle((x - 1, y - 1, x + 1, y + 1), fill=SCAN)

    def _robot(self, pen: ImageDraw.ImageDraw, truth: Truth, view: AgentView) -> None:
        robot = self._scene.robot
        foot, arm = robot.footprint, robot.arm
        corners = rectangle(truth.pose.tolist(), (foot.length, foot.width), foot.offset_x)
        pen.polygon(self._pixels(corners), fill=BODY, outline=INK)
        front = foot.offset_x + 0.5 * foot.length
        nose = np.array([[front - 0.1, 0.08], [front - 0.02, 0.0], [front - 0.1, -0.08]])
        pen.line(self._pixels(from_frame(truth.pose, nose)), fill=ARM, width=2 * FINER, joint="curve")
        if not robot.has_arm:
            return
        frames = fk_arm(view.observation.q)
        line = self._pixels(from_frame(truth.pose, frames[list(_LINKS), :2, 3] + (arm.mount_x, arm.mount_y)))
        pen.line(line, fill=INK, width=round(0.11 * self._scale), joint="curve")
        pen.line(line, fill=ARM, width=round(0.08 * self._scale), joint="curve")
        x, y = line[-1]
        pen.ellipse((x - 4 * FINER, y - 4 * FINER, x + 4 * FINER, y + 4 * FINER), outline=WAY_THERE, width=2 * FINER)

    def _header(self, pen: ImageDraw.ImageDraw, view: AgentView, counts: str) -> None:
        target = view.target
        task = "no task" if target is None else f"{target.kind} {target.name}"
        phase = "" if view.tick is None else f" ({view.tick.arm[-1].phase})"
        text = f"{view.observation.time:6.2f} s   {task}{phase}   {counts}"
        pen.rectangle((0, 0, self._size[0], FINER * HEADER), fill=(255, 255, 255))
        pen.text((FINER * 8, FINER * 4), text, fill=INK, font=self._font)


def _corners(shape: Box | Prism) -> Array:
    return np.array(shape.corners) if isinstance(shape, Prism) else rectangle((*shape.centre, shape.yaw), shape.size)
