"""The twin as a Gymnasium environment: one step is one control period (50 ms) of the loop of `run`.

It can render a top view of the world, drawn with Pillow at twice the size, then scaled down.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from types import EllipsisType
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from motm_twin.control.tick import SETTLE_PERIODS, Tick
from motm_twin.gym.actions import ArmAction, BaseAction, agent_method
from motm_twin.gym.observation import AgentView, ObservationReader, Observed, gymnasium, spaces, view_of
from motm_twin.methods.registry import find_method
from motm_twin.model.arm_kernels import TCP, fk_arm
from motm_twin.model.geometry import Array, from_frame, rectangle
from motm_twin.model.plant import BodyTruth, Truth
from motm_twin.model.profile import DQ_MAX, BaseLimits
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene
from motm_twin.model.scene_file import load_document, load_scene
from motm_twin.twin import Twin
from motm_twin.ui.colours import BRAND, NAMED, PEOPLE, TARGET, WAY_THERE, Rgb

WIDTH = 800  # pixels
HEADER = 26  # pixels of the line of text
FINER = 2  # factor of oversampling
TRAIL_POINTS = 400  # most points of the drawn path of the base
FLOOR, TABLE, LOW, WALL, INK = (246, 246, 243), (205, 178, 140), (224, 208, 184), (120, 124, 130), (40, 44, 52)
BODY, ARM, AGENT, SCAN = (58, 68, 84), (235, 236, 238), (233, 120, 60), (214, 60, 60)
_LINKS = (0, 2, 3, 4, 6, 8, TCP)  # frames of the arm that its drawn line joins


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
        """Add the base's position to its drawn path."""
        here = (float(truth.pose[0]), float(truth.pose[1]))
        if not self._trail or math.dist(here, self._trail[-1]) > 0.03:
            self._trail = [*self._trail[-TRAIL_POINTS:], here]

    def draw(self, truth: Truth, view: AgentView, counts: str) -> NDArray[np.uint8]:
        """Picture of the present state, shape (height, width, 3); ``counts``: end of its line of text."""
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
        """World points (n, 2) [m] in pixels of the picture; x to the right, y up."""
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
        """Draw a line each metre."""
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
        """Draw the lidar's points, from the true pose of the base."""
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


@dataclass(frozen=True, kw_only=True)
class RewardWeights:
    """Weight of each event. Objects count once: lifting the same one again earns nothing."""

    second: float = -1.0  # for every second that passes
    pick: float = 10.0  # an object lifted for the first time
    place: float = 10.0  # an object in a bin where the task list wants it, for the first time
    drop: float = -10.0  # an object fell elsewhere
    contact: float = -20.0  # an episode of contact that the robot caused
    given_up: float = -10.0  # a task that failed


@dataclass(frozen=True, kw_only=True)
class Score:
    """Events since the reset."""

    time: float = 0.0  # [s]
    picked: frozenset[str] = frozenset()  # objects that were lifted at least once
    placed: frozenset[str] = frozenset()  # objects that were in a right bin at least once
    lifts: int = 0
    landings: int = 0
    drops: int = 0
    contacts: int = 0
    caused: int = 0  # of the contacts, by the robot
    dropped: frozenset[str] = frozenset()  # objects that fell elsewhere and were not picked up and placed since
    given_up: int = 0


def score_of(before: Score, tick: Tick, truth: Truth, time: float) -> Score:
    """The score at the end of a period, at ``time`` [s]."""
    held = {item.name for item in truth.objects if item.state == "held"} if truth.picks > before.lifts else set()
    binned = {item.name for item in truth.objects if item.state.startswith("binned:")}
    return Score(
        time=time,
        picked=before.picked | held,
        placed=before.placed | binned if truth.places > before.landings else before.placed,
        lifts=truth.picks,
        landings=truth.places,
        drops=truth.drops,
        contacts=len(truth.contacts),
        caused=sum(contact.caused_by_robot for contact in truth.contacts),
        dropped=frozenset(truth.dropped),
        given_up=sum(task.status == "failed" for task in tick.tasks),
    )


def reward(weights: RewardWeights, before: Score, now: Score) -> float:
    """Reward of the change from one score to the next."""
    return (
        weights.second * (now.time - before.time)
        + weights.pick * (len(now.picked) - len(before.picked))
        + weights.place * (len(now.placed) - len(before.placed))
        + weights.drop * (now.drops - before.drops)
        + weights.contact * (now.caused - before.caused)
        + weights.given_up * (now.given_up - before.given_up)
    )


MOST_SEED = 2**31  # scene seeds are drawn below this when a reset names none
Action = NDArray[np.float32]


class MotmEnv(gymnasium.Env[Observed, Action]):
    """Manipulation on the move for a learning agent. docs/gym.md has the actions, the observations and the reward."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - as Gymnasium has it

    def __init__(
        self,
        scene: str = "exp1",
        *,
        variant: str | EllipsisType | None = ...,
        actions: str = "base",
        arm: str = "motm",
        guard: bool = False,
        weights: RewardWeights | None = None,
        beams: int = 72,
        time_limit: float | None = None,
        stop_on_contact: bool = False,
        on_tick: Callable[[Tick], None] | None = None,
        render_mode: str | None = None,
    ) -> None:
        """Make the environment; nothing runs before `reset`.

        Args:
            scene: Name of a shipped scene, or path of a scene file.
            variant: Named variant; None: the scene's default. By default "random" where the scene has it.
            actions: "base" (2 numbers) or "whole_body" (10).
            arm: Method whose arm is used in the mode "base".
            guard: Slow the base before anything on the map, as when a user drives it.
            weights: Weights of the reward.
            beams: Number of lidar sectors that are observed.
            time_limit: End of an episode [s]; None: the scene's.
            stop_on_contact: End the episode at a contact that the robot caused.
            on_tick: Called with every Tick.
            render_mode: "rgb_array" or None.

        Raises:
            ValueError: One of these is not possible.
        """
        if render_mode not in (None, "rgb_array"):
            raise ValueError(f"render mode {render_mode!r}: use 'rgb_array' or None")
        if time_limit is not None and not time_limit > 0.0:
            raise ValueError(f"time limit {time_limit} s: give a positive one, or None for the scene's own")
        self.render_mode = render_mode
        self.weights = weights or RewardWeights()
        self._name, self._time_limit = scene, time_limit
        if variant is ...:  # random arrangements where the scene has them
            variant = "random" if "random" in load_document(scene).variants() else None
        self._variant = variant
        self._stop_on_contact, self._on_tick = stop_on_contact, on_tick
        self._method = agent_method(actions, find_method(arm), guard=guard)
        self.whole_body = actions == "whole_body"
        robot = load_scene(scene, self._variant).robot
        self._base: BaseLimits = robot.base
        self._reader = ObservationReader(robot, beams)
        self.observation_space = self._reader.space
        self._numbers = 10 if self.whole_body else 2
        self.action_space = spaces.Box(-1.0, 1.0, (self._numbers,), dtype=np.float32)
        self._twin: Twin | None = None
        self._picture: TopView | None = None

    @property
    def twin(self) -> Twin:
        """The running twin; edits posted to it change the world. Raises RuntimeError before `reset`."""
        if self._twin is None:
            raise RuntimeError("nothing runs yet: reset the environment first")
        return self._twin

    @property
    def view(self) -> AgentView:
        """Current knowledge of the robot, in the loop's own types."""
        self.twin  # noqa: B018 - raises before a reset
        return self._view

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observed, dict]:
        """Begin an episode. ``seed`` is the scene's, as in `motm-twin run --seed`; None: one is drawn.

        ``options``: {"variant": NAME} for this episode, or {"scene": Scene} for your own scene.
        """
        super().reset(seed=seed)
        scene = self._scene(seed, dict(options or {}))
        if scene.robot.base != self._base or scene.robot.lidar.range_max > self._reader.range_max:
            raise ValueError(f"scene {scene.name} has another robot than this environment: make a new one for it")
        self._twin = Twin(scene, method=self._method)
        self._score, self._settle = Score(), SETTLE_PERIODS
        self._limit = self._time_limit or scene.time_limit
        self._view = view_of(self._twin, None)
        if self.render_mode is not None:
            self._picture = TopView(scene)
        return self._observed(), self._info()

    def step(self, action: Action) -> tuple[Observed, float, bool, bool, dict]:
        """Run one period with this action, clipped to -1 .. 1. Raises ValueError for a wrong or non-finite one."""
        twin = self.twin
        self._take(action)
        tick = twin.advance()
        if self._on_tick is not None:
            self._on_tick(tick)
        assert tick.truth is not None
        self._view = view_of(twin, tick)
        before, time = self._score, self._view.observation.time
        self._score = score_of(before, tick, tick.truth, time)
        if self._picture is not None:
            self._picture.follow(tick.truth)
        terminated = self._ended(tick, tick.truth)
        truncated = not terminated and time >= self._limit
        return self._observed(), reward(self.weights, before, self._score), terminated, truncated, self._info()

    def render(self) -> NDArray[np.uint8] | None:  # pyright: ignore[reportIncompatibleMethodOverride]
        """Picture of the true world from above, shape (height, width, 3); None without a render mode."""
        if self._picture is None:
            return None
        twin = self.twin
        truth = twin.plant.truth()
        assert truth is not None
        score = self._score
        done = f"picked {len(score.picked)}, placed {len(score.placed)}"
        return self._picture.draw(truth, self._view, f"{done}, contacts {score.caused} caused of {score.contacts}")

    def snapshot(self) -> dict[str, Any]:
        """Copy of the state of this episode, its random generators included, for `restore`."""
        twin = {"twin": self.twin.snapshot(), "scene": self.twin.scene}  # first: it raises before a reset
        return {**twin, "score": self._score, "settle": self._settle, "view": self._view}

    def restore(self, state: dict[str, Any]) -> Observed:
        """Continue from a snapshot; returns its observation. Raises ValueError for one of another scene or seed."""
        if state["scene"] != self.twin.scene:
            raise ValueError("the snapshot is of another scene or seed: reset to that first")
        self.twin.restore(state["twin"])
        self._score, self._settle, self._view = state["score"], state["settle"], state["view"]
        return self._observed()

    def _scene(self, seed: int | None, options: dict[str, Any]) -> Scene:
        given = options.pop("scene", None)
        variant = options.pop("variant", self._variant)
        if options:
            raise ValueError(f"reset options {', '.join(map(repr, options))}: only 'variant' and 'scene' exist")
        if given is not None:
            return given
        number = int(self.np_random.integers(MOST_SEED)) if seed is None else seed
        return load_scene(self._name, variant, number)

    def _take(self, action: Action) -> None:
        """Hand the action to base and arm controller."""
        asked = np.asarray(action, dtype=float)
        if asked.shape != (self._numbers,) or not np.isfinite(asked).all():
            raise ValueError(f"action {action}: {self._numbers} finite numbers from -1 to 1 are needed")
        asked = np.clip(asked, -1.0, 1.0)
        loop, base = self.twin.loop, self._base
        controller = loop.planner.controller
        assert isinstance(controller, BaseAction)
        speed = base.forward_speed if asked[0] > 0.0 else base.reverse_speed
        controller.take(np.array([asked[0] * speed, asked[1] * base.yaw_rate]))
        if self.whole_body:
            assert isinstance(loop.manipulator, ArmAction)
            loop.manipulator.take(asked[2:9] * DQ_MAX, "close" if asked[9] > 0.0 else "open")

    def _ended(self, tick: Tick, truth: Truth) -> bool:
        """True when all tasks have ended and released objects had time to land, or a contact ends the episode."""
        if self._stop_on_contact and self._score.caused:
            return True
        ended = tick.done and (truth.places >= _places(tick) or self._settle == 0)
        self._settle -= int(tick.done)
        return ended

    def _observed(self) -> Observed:
        return self._reader.read(self._view, limit=self._limit, tasks=len(self.twin.loop.sequence.tasks))

    def _info(self) -> dict[str, Any]:
        """Counts of the referee so far, and the reason why the robot stands or is slowed."""
        score, tick, scene = self._score, self._view.tick, self.twin.scene
        whole = tick is not None and tick.success and len(score.placed) == _places(tick)
        return {
            "variant": scene.variant,
            "seed": scene.seed,
            "time_s": score.time,
            "picks": len(score.picked),
            "places": len(score.placed),
            "drops": score.drops,
            "dropped": sorted(score.dropped),
            "contacts": score.contacts,
            "contacts_caused": score.caused,
            "given_up": score.given_up,
            "stop_reason": "" if tick is None else tick.stop_reason,
            "is_success": whole and not score.caused and not score.dropped,
        }


def _places(tick: Tick) -> int:
    return sum(task.kind == "place" for task in tick.tasks)
