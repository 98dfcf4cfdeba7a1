"""A stand-in for the twin that computes nothing: the robot drives a circle round one small table.

For tests of the transport and the page that must not depend on planning. Everything it reports is a valid Tick.
"""

import math
import typing

import numpy as np

from motm_twin.bus.commands import Load
from motm_twin.bus.library import TwinSetup
from motm_twin.bus.messages import SceneChoice
from motm_twin.bus.server import TwinServer
from motm_twin.control.arm.types import ArmStep, ProgramStatus
from motm_twin.control.tick import Event, ObjectBelief, TaskState, Tick
from motm_twin.model.edits import AddObstacle, MoveBody, RemoveBody
from motm_twin.model.plant import Actuation, BodyTruth, Observation, Truth
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import Agent, Bin, Box, Cylinder, Noise, Pick, Place, Scene, SceneObject, Solid
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.types import BasePlan, Placement
from motm_twin.sessions.session import Session
from motm_twin.sim.plant import SimulatedPlant

HOME = np.array([0.0, -0.6, 0.0, -2.3, 0.0, 1.8, 0.785])
CENTRE = np.array([4.2, 1.77])


def solid(name, shape, low, high, *, mapped=True, **style):
    return Solid(name=name, shape=shape, z_min=low, z_max=high, mapped=mapped, **style)


def fake_scene(name="fake", variant="a", seed=0):
    slots = ((3.1, 1.47), (5.3, 1.47), (4.2, 2.07), (3.65, 1.47))
    table = {"group": "object table", "style": "table"}
    legs = [
        solid(f"table {part} {i}", Cylinder(centre=(x, 1.77), radius=radius), low, high, **table)
        for i, x in enumerate((3.6, 4.8))
        for part, radius, low, high in (("post", 0.05, 0.08, 0.75), ("foot", 0.3, 0.0, 0.08))
    ]
    solids = (
        solid("table top", Box(centre=(4.2, 1.77), size=(2.4, 0.8)), 0.75, 0.78, **table),
        *legs,
        solid("desk", Box(centre=(-0.095, 2.22), size=(0.77, 1.18)), 0.0, 0.6, style="desk"),
        solid("round table", Cylinder(centre=(4.27, -1.44), radius=0.365), 0.0, 0.6, style="table"),
        solid("cabinet", Box(centre=(0.335, -1.5525), size=(1.87, 0.295)), 0.0, 0.69, style="cabinet"),
        solid("box 1", Box(centre=(2.7, 1.7), size=(0.5, 0.5)), 0.0, 0.6, mapped=False, style="box"),
    )
    objects = tuple(SceneObject(name=f"cube{i + 1}", position=(x, y, 0.80)) for i, (x, y) in enumerate(slots))
    bins = (Bin(name="drop1", centre=(4.25, -1.29)), Bin(name="drop2", centre=(0.1, 2.13)))
    tasks = tuple(t for i in range(4) for t in (Pick(object=f"cube{i + 1}"), Place(bin=f"drop{i % 2 + 1}")))
    return Scene(
        name=name, variant=variant, seed=seed, title="A circle round a table", robot=RobotProfile(),
        start=(0.0, 0.0, 0.0), solids=solids, objects=objects, bins=bins,
        agents=(Agent(name="temi1", start=(2.0, -0.8, 0.0)),), tasks=tasks, noise=Noise(),
        bounds=(-1.5, -2.5, 7.0, 4.0),
    )  # fmt: skip


class FakeLibrary:
    def __init__(self):
        self.loads = []

    def choices(self):
        return [
            SceneChoice(name="fake", title="A circle", variants=["a", "b"]),
            SceneChoice(name="other", title="Another circle", variants=["c"]),
        ]

    def load(self, scene, variant, seed):
        if scene not in ("fake", "other"):
            raise ValueError(f"no scene {scene!r}: did you mean fake?")
        self.loads.append((scene, variant, seed))
        return fake_scene(scene, variant or "a", seed or 0)

    def changed(self):
        return False


class FakeTwin:
    """Same surface as the twin, for errors and pacing; it knows no session and explains nothing."""

    parameters: typing.ClassVar = {}
    next_parameters: typing.ClassVar = {}
    announced: typing.ClassVar = {}
    refused: typing.ClassVar = []

    def __init__(self, scene, *, method=None, periods=100_000, fail_at=None):
        self.scene, self.method, self.periods, self.fail_at = scene, method, periods, fail_at
        self.reset()

    def reset(self):
        self.index = 0
        self.edits, self.queue = [], []
        self.added = {}
        self.agents = {agent.name: (*agent.start, "driving") for agent in self.scene.agents}

    def post(self, edit):
        if isinstance(edit, AddObstacle) and edit.x > 90.0:
            raise ValueError("that is outside the world")
        if isinstance(edit, MoveBody) and edit.name not in (*self.added, *self.agents, *(e.name for e in self.queue)):
            raise ValueError(f"there is no {edit.name!r} to move")
        self.queue.append(edit)

    def session(self):
        method = "motm" if self.method is None else self.method.name
        return Session(scene=self.scene, method=method, periods=self.index)

    def snapshot(self):
        return {"plant": SimulatedPlant(self.scene).snapshot()}

    def candidate_paths(self, index):
        return None

    def staa_path(self):
        return np.zeros((0, 2))

    def advance(self, budget=None):
        if self.fail_at == self.index:
            raise RuntimeError("the fake twin was told to fail")
        edits, self.queue = tuple(self.queue), []
        for edit in edits:
            self._apply(edit)
        tick = fake_tick(self, edits)
        self.index += 1
        return tick

    def _apply(self, edit):
        if isinstance(edit, AddObstacle):
            self.added[edit.name] = (edit.shape, edit.x, edit.y, edit.heading, edit.size)
        elif isinstance(edit, RemoveBody):
            self.added.pop(edit.name)
        elif isinstance(edit, MoveBody) and edit.name in self.added:
            shape, _, _, heading, size = self.added[edit.name]
            self.added[edit.name] = (shape, edit.x, edit.y, heading if edit.heading is None else edit.heading, size)
        elif isinstance(edit, MoveBody):
            heading = self.agents[edit.name][2] if edit.heading is None else edit.heading
            self.agents[edit.name] = (edit.x, edit.y, heading, "held")


def circle(time):
    """Pose on an ellipse round the table at 0.4 m/s."""
    angle = time * 0.2 - 2.0
    x, y = CENTRE[0] + 2.1 * math.cos(angle), CENTRE[1] + 1.35 * math.sin(angle)
    return np.array([x, y, math.atan2(1.35 * math.cos(angle), -2.1 * math.sin(angle))])


def fake_map(scene, time, added):
    x0, y0, x1, y1 = scene.bounds
    res = 0.05
    nx, ny = round((x1 - x0) / res), round((y1 - y0) / res)
    xs, ys = np.meshgrid(x0 + (np.arange(nx) + 0.5) * res, y0 + (np.arange(ny) + 0.5) * res)
    distance = np.full((ny, nx), 9.0)
    for solid in scene.solids:
        if solid.z_min > 0.2 or (solid.z_max < 0.2 and solid.style != "table"):
            continue
        cx, cy = solid.shape.centre
        if isinstance(solid.shape, Box):
            sx, sy = solid.shape.size
            gap = np.hypot(np.maximum(abs(xs - cx) - sx / 2, 0), np.maximum(abs(ys - cy) - sy / 2, 0))
        else:
            gap = np.maximum(np.hypot(xs - cx, ys - cy) - solid.shape.radius, 0)
        distance = np.minimum(distance, gap)
    for _, x, y, _, _ in added.values():
        distance = np.minimum(distance, np.maximum(np.hypot(xs - x, ys - y) - 0.25, 0))
    occupied = (distance <= 0).astype(np.uint8)
    proximity = np.clip(1.0 - distance / 0.6, 0, 1).astype(np.float32) ** 1.5
    return WorldMap(
        stamp=time, resolution=res, origin=np.array([x0, y0]), occupied=occupied, distance=distance.astype(np.float32),
        proximity=proximity, polygons=(), seen_points=np.zeros((0, 2)), seen_static=np.zeros(0, dtype=bool),
    )  # fmt: skip


def fake_placement(cube, time):
    angles = np.arange(36) * (2 * math.pi / 36)
    poses, rejected = [], []
    cost = []
    for side in (1, -1):
        for angle in angles:
            x, y = cube[0] + 0.6 * math.cos(angle), cube[1] + 0.6 * math.sin(angle)
            poses.append((x, y, angle + side * math.pi / 2))
            out = y > 1.2
            rejected.append("collision with object table" if out else "")
            cost.append(math.inf if out else 8 + 3 * math.cos(angle - 0.3 * time) + (side < 0))
    cost = np.array(cost)
    chosen = int(np.argmin(cost)) if np.isfinite(cost).any() else -1
    goal = np.array(poses[chosen])
    return Placement(
        mode="ring", radius=0.6, poses=np.array(poses), cost_current=cost * 0.6, cost_next=cost * 0.4 / 1.05, cost=cost,
        rejected=tuple(rejected), chosen=chosen, goal=goal, goal_has_heading=True,
        why=Reason(kind=Kind.RING, other="0.60 m", value=4.0, limit=2.0), next_goal=np.array([4.25, -0.6, 0.0]),
    )  # fmt: skip


def fake_tick(twin, edits):
    scene, index = twin.scene, twin.index
    time = index * 0.05
    pose = circle(time)
    q = HOME + np.array(
        [1.5 * math.sin(time * 0.3), 0.2 * math.sin(time * 0.7), 0, 0.2 * math.sin(time * 0.5), 0, 0, 0]
    )
    observation = Observation(
        time=time, pose=pose, odometry=pose, twist=np.array([0.4, 0.2]), q=q, dq=np.zeros(7), gripper_width=0.08,
        gripper_moving=False, scan=None, detections=(),
    )  # fmt: skip
    cube = np.array(scene.objects[0].position)
    placement = fake_placement(cube, time)
    times = np.arange(0, 3.0, 0.375)
    local = np.array([(*circle(time + t), 0.4, 0.2) for t in times])
    plan = BasePlan(
        acceleration=np.zeros(2), status="goal",
        global_path=np.array([pose[:2], (pose[:2] + placement.goal[:2]) / 2 + 0.3, placement.goal[:2]]),
        next_path=np.array([placement.goal[:2], [4.25, -0.6]]), intermediate_goal=placement.goal, local_poses=local,
        local_times=times, bezier=local[3:, :2], expansions=120, cut_by_clock=False, t_h=4.0, k=1.0, time_to_range=2.0,
    )  # fmt: skip
    step = ArmStep(
        time=time, phase="transit", actuation=Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open"),
        reference=np.zeros(3), error=0.1, tilt=0.0, slack=np.zeros(6), manipulability=0.08, active=(), limiter="",
        obstacle_distance=math.inf, allowed_approach=math.inf, program=ProgramStatus.SOLVED, holding=False,
        engaged=False, dwell=1.0, outcome="",
    )  # fmt: skip
    agents = tuple(
        BodyTruth(name=name, kind="temi", position=(x, y, 0.0), yaw=heading, state=state, size=(0.5, 0.5, 1.0))
        for name, (x, y, heading, state) in twin.agents.items()
    )
    obstacles = tuple(
        BodyTruth(name=name, kind=shape, position=(x, y, 0.0), yaw=heading, size=size)
        for name, (shape, x, y, heading, size) in twin.added.items()
    )
    objects = tuple(
        BodyTruth(name=o.name, kind="cube", position=o.position, yaw=o.yaw, state="resting", size=(o.side,) * 3)
        for o in scene.objects
    )
    truth = Truth(
        pose=pose, objects=objects, agents=agents, obstacles=obstacles, contacts=(), picks=1, places=1, drops=0,
        min_base_clearance=0.2, min_arm_clearance=0.1, min_ee_obstacle=0.4, ee_obstacle=0.6, plant_faults=(),
    )  # fmt: skip
    tasks = tuple(
        TaskState(
            kind="pick" if isinstance(t, Pick) else "place",
            target=t.object if isinstance(t, Pick) else t.bin,
            status="done" if i < 2 else "active" if i == 2 else "waiting",
            attempts=int(i <= 2),
        )
        for i, t in enumerate(scene.tasks)
    )
    done = index >= twin.periods
    return Tick(
        index=index, time=time, observation=observation, map=fake_map(scene, time, twin.added), tasks=tasks,
        task_index=2,
        beliefs=tuple(
            ObjectBelief(name=o.name, position=np.array(o.position), yaw=0.0, position_sd=0.03, seen=False, held=False)
            for o in scene.objects
        ),
        placement=placement, plan=plan, arm=(step,) * 5, why=None,
        events=(Event(time=time, kind="picked", text="picked cube1"),) if index == 0 else (), edits=edits,
        stage_ms={"plan": 3.0}, truth=truth, done=done, success=done,
    )  # fmt: skip


def fake_server(*, first=None, playing=True, methods=None, make_twin=FakeTwin, **options):
    """A server of the fake twin."""
    first = first or Load(scene="fake")
    setup = TwinSetup(library=FakeLibrary(), make_twin=make_twin, first=first, playing=playing, methods=methods)
    return TwinServer(setup, **options)
