"""The world as an agent observes it, and as `render_mode="rgb_array"` shows it to people.

Observations are what the robot knows: float32 boxes and small discrete numbers, see docs/gym.md. The picture is a top
view, drawn with Pillow at twice the size, then scaled down.
"""

import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from motm_twin.control.arm.types import ArmGoal, ArmStep, Phase
from motm_twin.control.predictor import dwell_to_plan
from motm_twin.control.targets import odometry_to_world
from motm_twin.control.tick import Tick
from motm_twin.gym.actions import BaseAction
from motm_twin.model.arm_kernels import TCP, fk_arm
from motm_twin.model.geometry import Array, from_frame, rectangle, to_frame
from motm_twin.model.joint_limits import DQ_MAX, Q_MAX, Q_MIN
from motm_twin.model.motion import command_pose
from motm_twin.model.period import PERIOD
from motm_twin.model.plant import BodyTruth, Observation, Scan, Truth
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Bin, Box, Cylinder, Prism, Scene
from motm_twin.planning.types import BaseProblem, Target
from motm_twin.twin import Twin
from motm_twin.ui.colours import BRAND, NAMED, PEOPLE, TARGET, WAY_THERE, Rgb


@dataclass(frozen=True, kw_only=True)
class AgentView:
    """The robot's knowledge at the end of a period, in the loop's own types."""

    observation: Observation
    tick: Tick | None  # of the last period; None after a reset
    pose: Array  # from which the next command acts (the lag of the base is compensated), world, shape (3,)
    twist: Array  # commanded last [m/s, rad/s], shape (2,)
    target: Target | None  # of the active task, world
    next_target: Target | None
    goal: ArmGoal  # what the hand has to do, odometry frame
    next_goal: ArmGoal
    engaged: bool
    dwell: float  # [s]
    time_to_range: float  # [s]

    def problem(self) -> BaseProblem:
        """The base's question as the loop asks it of a planner, on the map of the last period.

        Raises RuntimeError after a reset: there is no map before the first period.
        """
        if self.tick is None:
            raise RuntimeError("there is no map before the first step: step once, with an action of zeros")
        return BaseProblem(
            time=self.observation.time,
            world=self.tick.map,
            pose=self.pose,
            twist=self.twist,
            target=self.target,
            next_target=self.next_target,
            engaged=self.engaged,
            period=PERIOD,
        )


def view_of(twin: Twin, tick: Tick | None) -> AgentView:
    """Knowledge of the robot now, after the period of this Tick."""
    loop, observation = twin.loop, twin.plant.observe()
    sequence, targets, twist = loop.sequence, loop.targets, loop.monitor.twist
    T_odom_world = odometry_to_world(observation)
    lag = loop.known.robot.base.velocity_lag
    pose = command_pose(observation.pose, observation.twist, lag)
    dwell = dwell_to_plan(None if tick is None or tick.arm[-1].outcome else tick.arm[-1].dwell, loop.engaged, lag)
    target = targets.base_target(sequence.active, observation, dwell)
    controller = loop.planner.controller
    assert isinstance(controller, BaseAction)
    times, poses = controller.forecast.motion(pose, twist, controller.twist)
    return AgentView(
        observation=observation,
        tick=tick,
        pose=pose,
        twist=twist,
        target=target,
        next_target=targets.base_target(sequence.following, observation, None),
        goal=targets.arm_goal(sequence.active, sequence.held, observation, T_odom_world),
        next_goal=targets.arm_goal(sequence.following, "", observation, T_odom_world),
        engaged=loop.engaged,
        dwell=0.0 if target is None else target.dwell,
        time_to_range=controller.forecast.time_to_range(times, poses, target),
    )


try:
    import gymnasium
except ImportError as error:
    raise ImportError(
        f"motm_twin.gym needs Gymnasium, which is not installed: {sys.executable} -m pip install 'gymnasium>=1.0'"
    ) from error

spaces = gymnasium.spaces
TASKS = ("none", "pick", "place", "drive")
PHASES = tuple(Phase)
FAR = 50.0  # [m] positions are clipped to
LATE = 60.0  # [s] times are clipped to
SPEED_ROOM = 1.5  # measured speeds may exceed the limits of the robot by this, noise and lags included

Observed = dict[str, Any]


class Now(NamedTuple):
    """All that an observation is made of."""

    view: AgentView
    seen: Observation
    arm: ArmStep | None  # of the last period
    limit: float  # [s] of the episode
    tasks: int


class ObservationReader:
    """Turns the robot's knowledge into arrays of fixed shapes."""

    def __init__(self, robot: RobotProfile, beams: int) -> None:
        """``beams``: sectors of equal angle round the base, the nearest return of each is observed."""
        if beams < 1:
            raise ValueError(f"{beams} lidar beams: at least one is needed")
        self._robot, self._beams = robot, beams
        arm = robot.arm
        self._mount = np.array([arm.mount_x, arm.mount_y, arm.mount_z])
        self._sectors: tuple[Any, NDArray[np.int64], NDArray[np.int64]] | None = None  # of the last kind of scan
        self.range_max = robot.lidar.range_max
        self._entries = self._table()
        self.space = spaces.Dict({name: space for name, (space, _) in self._entries.items()})

    def read(self, view: AgentView, *, limit: float, tasks: int) -> Observed:
        """The observation; ``limit`` [s] of the episode, ``tasks``: length of the task list."""
        now = Now(view, view.observation, None if view.tick is None else view.tick.arm[-1], limit, tasks)
        return {name: _fitted(space, self._entries[name][1](now)) for name, space in self.space.spaces.items()}

    def _ranges(self, scan: Scan | None) -> Array:
        """The nearest return [m] of every sector, from straight behind counter-clockwise."""
        ranges = np.full(self._beams, self._robot.lidar.range_max)
        if scan is not None:
            sectors, starts = self._sectors_of(scan)
            ranges[sectors] = np.minimum(np.minimum.reduceat(scan.ranges, starts), ranges[sectors])
        return ranges

    def _sectors_of(self, scan: Scan) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Sectors that a scan looks into, and the first beam of each."""
        kind = (len(scan.ranges), scan.angle_min, scan.angle_step)
        if self._sectors is None or self._sectors[0] != kind:
            angles = scan.angle_min + scan.angle_step * np.arange(len(scan.ranges))
            share = (angles + math.pi) / (2.0 * math.pi)
            sector = np.clip(np.floor(share * self._beams).astype(np.int64), 0, self._beams - 1)
            self._sectors = (kind, *np.unique(sector, return_index=True))
        return self._sectors[1:]

    def _table(self) -> dict[str, tuple[spaces.Space, Callable[["Now"], Any]]]:
        """Space and value of every entry."""
        base, lidar, mount = self._robot.base, self._robot.lidar, self._mount
        fastest = SPEED_ROOM * np.array([max(base.forward_speed, base.reverse_speed), base.yaw_rate])
        point, unit, times = _box([-FAR, -FAR, 0.0], [FAR, FAR, 5.0]), _box([0.0], [1.0]), _box([0.0], [LATE])
        yes_or_no, task = spaces.Discrete(2), spaces.Discrete(len(TASKS))
        sectors = _box([0.0] * self._beams, [lidar.range_max] * self._beams)
        return {
            "pose": (_box([-FAR, -FAR, -1.0, -1.0], [FAR, FAR, 1.0, 1.0]), _pose),
            "twist": (_box(-fastest, fastest), lambda now: now.seen.twist),
            "command": (_box(-fastest, fastest), lambda now: now.view.twist),
            "task": (task, lambda now: _task(now.view.target)),
            "target": (point, lambda now: _place(now.view.target, now.view.goal, now.seen)),
            "target_turn": (_box([-1.0, -1.0], [1.0, 1.0]), lambda now: _turn(now.view.goal, now.seen.odometry)),
            "target_sd": (unit, lambda now: now.view.goal.position_sd),
            "next_task": (task, lambda now: _task(now.view.next_target)),
            "next_target": (point, lambda now: _place(now.view.next_target, now.view.next_goal, now.seen)),
            "time_to_range": (times, lambda now: now.view.time_to_range),
            "dwell": (times, lambda now: now.view.dwell),
            "lidar": (sectors, lambda now: self._ranges(now.seen.scan)),
            "joints": (_box(Q_MIN - 0.1, Q_MAX + 0.1), lambda now: now.seen.q),
            "joint_rates": (_box(-SPEED_ROOM * DQ_MAX, SPEED_ROOM * DQ_MAX), lambda now: now.seen.dq),
            "hand": (_box([-2.0, -2.0, -0.5], [2.0, 2.0, 2.0]), lambda now: mount + fk_arm(now.seen.q)[TCP, :3, 3]),
            "gripper": (_box([0.0], [0.1]), lambda now: now.seen.gripper_width),
            "phase": (spaces.Discrete(len(PHASES)), lambda now: PHASES.index(now.arm.phase if now.arm else Phase.STOW)),
            "engaged": (yes_or_no, lambda now: now.view.engaged),
            "holding": (yes_or_no, lambda now: now.arm is not None and now.arm.holding),
            "time_left": (unit, lambda now: 1.0 - now.seen.time / now.limit),
            "progress": (unit, _progress),
        }


def _fitted(space: spaces.Space, value: Any) -> Any:
    """As float32 within the bounds of a box, or as a discrete number."""
    if not isinstance(space, spaces.Box):
        return np.int64(value)
    return np.clip(np.atleast_1d(np.asarray(value, dtype=np.float32)), space.low, space.high)


def _pose(now: Now) -> tuple[float, ...]:
    x, y, heading = now.seen.pose
    return x, y, math.cos(heading), math.sin(heading)


def _progress(now: Now) -> float:
    tick = now.view.tick
    done = 0 if tick is None else sum(task.status in ("done", "failed") for task in tick.tasks)
    return done / max(1, now.tasks)


def _box(low: Any, high: Any) -> spaces.Box:
    return spaces.Box(np.asarray(low, dtype=np.float32), np.asarray(high, dtype=np.float32), dtype=np.float32)


def _task(target: Target | None) -> int:
    return TASKS.index("none" if target is None else target.kind)


def _place(target: Target | None, goal: ArmGoal, now: Observation) -> Array:
    """Position of a target in the base frame, z above the floor [m], shape (3,); zeros without one."""
    if goal.kind != "none":
        return to_frame(now.odometry, goal.position)
    if target is None:
        return np.zeros(3)
    return np.array([*to_frame(now.pose, target.position), 0.0])


def _turn(goal: ArmGoal, odometry: Array) -> tuple[float, float]:
    """Cosine and sine of four times the yaw of a cube or bin in the base frame: a quarter turn leaves them equal."""
    if goal.kind == "none":
        return 0.0, 0.0
    yaw = 4.0 * (goal.yaw - float(odometry[2]))
    return math.cos(yaw), math.sin(yaw)


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
