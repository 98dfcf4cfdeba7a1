"""The simulated robot and its world as a Plant.

Kinematic only: nothing is stopped or pushed by contact except cubes by the fingers. A base that is driven into a box
goes on through it, and the referee records the contact.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from motm_twin.model.arm_kernels import HAND, TCP, fk_arm
from motm_twin.model.edits import AddObstacle, MoveBody, ReleaseBody, WorldEdit
from motm_twin.model.geometry import Array, from_frame, wrap_angle
from motm_twin.model.joint_limits import READY
from motm_twin.model.plant import Actuation, BodyTruth, Observation, Truth
from motm_twin.model.scene import Scene
from motm_twin.model.state import Stateful
from motm_twin.sim.agents import DECISION_STEPS, Agents, AgentState, RobotShadow
from motm_twin.sim.arm import Arm, ArmState
from motm_twin.sim.base import Base, BaseState
from motm_twin.sim.camera import Camera, CameraState
from motm_twin.sim.gripper import Gripper, GripperState
from motm_twin.sim.lidar import Lidar, LidarState
from motm_twin.sim.localisation import Localisation, LocalisationState
from motm_twin.sim.objects import ObjectState, ObjectWorld, start_objects
from motm_twin.sim.referee import Referee, RefereeState, World
from motm_twin.sim.solids import Solids, build_solids, obstacle_disc, rectangle
from motm_twin.sim.world_edits import apply_to_agent, apply_to_obstacles, check_edit

SUBSTEP = 0.01  # [s]
_RNG_LIDAR, _RNG_CAMERA, _RNG_LOCALISATION = 0x11DA2, 0xCA3E2A, 0x10CA7E
_SHADOW_TIMES = (0.0, 0.4, 0.8)  # [s] ahead at which agents expect the base
_SHADOW_LINKS = ((2, 0.10), (4, 0.10), (5, 0.10), (7, 0.10), (HAND, 0.11), (TCP, 0.06))  # frame, radius [m]


@dataclass
class PlantState:
    """Everything that changes."""

    substep: int
    command: Actuation
    base: BaseState
    arm: ArmState
    tcp: Array  # tool centre point, world [m], shape (3,)
    gripper: GripperState
    gripper_command: str
    objects: list[ObjectState]
    agents: list[AgentState]
    obstacles: tuple[AddObstacle, ...]  # put there or moved by a person
    taken: tuple[str, ...]  # solids of the scene that a person moved (now among the obstacles) or removed
    lidar: LidarState
    camera: CameraState
    localisation: LocalisationState
    referee: RefereeState


class SimulatedPlant(Stateful[PlantState]):
    """A robot in a scene: `observe`, `command`, `step`; and for people and programs `apply` and `truth`."""

    def __init__(self, scene: Scene, arm_start: Array = READY) -> None:
        """A plant at the start of the scene; arm_start [rad], shape (7,)."""
        robot, noise = scene.robot, scene.noise
        self.scene = scene
        self._base = Base(robot.base, SUBSTEP)
        self._arm = Arm(robot.arm.velocity_lag, SUBSTEP)
        self._object_world = ObjectWorld(scene.bins, SUBSTEP)
        self._gripper = Gripper(robot.gripper, self._object_world, SUBSTEP)
        self._agents = Agents(scene.agents, SUBSTEP)
        self._lidar = Lidar(robot.lidar, noise.lidar_range_sd)
        self._camera = Camera(robot.camera, noise)
        self._localisation = Localisation(noise, SUBSTEP)
        self._referee = Referee(scene, SUBSTEP)
        self._mount = np.array([robot.arm.mount_x, robot.arm.mount_y, robot.arm.mount_z])
        self._lidar_period = max(1, round(1.0 / (robot.lidar.rate * SUBSTEP)))
        self._camera_period = max(1, round(1.0 / (robot.camera.rate * SUBSTEP)))
        self._tallest = max((agent.height for agent in scene.agents), default=0.0)
        self._cached_for: tuple[tuple[AddObstacle, ...], tuple[str, ...]] | None = None
        self._start(arm_start)

    def _start(self, arm_start: Array) -> None:
        scene = self.scene
        pose = np.array(scene.start, dtype=float)
        at_rest = Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open")
        seeds = [np.random.default_rng([scene.seed, tag]) for tag in (_RNG_LIDAR, _RNG_CAMERA, _RNG_LOCALISATION)]
        arm = ArmState(q=np.array(arm_start, dtype=float), dq=np.zeros(7))
        frames = self._frames(pose, arm.q)
        objects, agents = start_objects(scene.objects), self._agents.start()
        base, gripper, tcp = BaseState(pose=pose), self._gripper.start(), frames[TCP, :3, 3].copy()
        self._refresh_solids((), ())
        referee = self._referee.start(self._world(0.0, base, arm, gripper, tcp, objects, agents))
        self._state = PlantState(
            substep=0,
            command=at_rest,
            base=base,
            arm=arm,
            tcp=tcp,
            gripper=gripper,
            gripper_command="open",
            objects=objects,
            agents=agents,
            obstacles=(),
            taken=(),
            lidar=LidarState(rng=seeds[0]),
            camera=CameraState(rng=seeds[1]),
            localisation=self._localisation.start(pose, seeds[2]),
            referee=referee,
        )
        self._sense(frames)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._state.substep * SUBSTEP

    def observe(self) -> Observation:
        """What the sensors say now."""
        s = self._state
        return Observation(
            time=self.time,
            pose=s.localisation.pose.copy(),
            odometry=s.localisation.odometry.copy(),
            twist=s.localisation.twist.copy(),
            q=s.arm.q.copy(),
            dq=s.arm.dq.copy(),
            gripper_width=s.gripper.width,
            gripper_moving=self._gripper.moving(s.gripper),
            scan=s.lidar.scan,
            detections=s.camera.detections,
        )

    def command(self, actuation: Actuation) -> None:
        """Set what the robot does from now on."""
        self._state.command = actuation

    def step(self, dt: float) -> None:
        """Let dt [s] pass, a multiple of `SUBSTEP`."""
        count = round(dt / SUBSTEP)
        if count < 1 or abs(count * SUBSTEP - dt) > 1e-9:
            raise ValueError(f"step of {dt} s: must be a positive multiple of {SUBSTEP} s")
        for _ in range(count):
            self._substep()

    def check(self, edit: WorldEdit, pending: Sequence[WorldEdit] = ()) -> None:
        """Raise ValueError when the world cannot take this edit (after others that still wait to be applied)."""
        obstacles, taken = self._state.obstacles, self._state.taken
        for earlier in pending:
            obstacles, taken = apply_to_obstacles(self.scene, obstacles, taken, earlier)
        check_edit(self.scene, obstacles, taken, edit)

    def apply(self, edit: WorldEdit) -> None:
        """Change the world as a person does; raises ValueError when it cannot be."""
        self.check(edit)
        s = self._state
        names = [agent.name for agent in self.scene.agents]
        if isinstance(edit, MoveBody | ReleaseBody) and edit.name in names:
            i = names.index(edit.name)
            apply_to_agent(s.agents[i], edit)
        else:
            s.obstacles, s.taken = apply_to_obstacles(self.scene, s.obstacles, s.taken, edit)
            self._refresh_solids(s.obstacles, s.taken)
            for item in s.objects:
                if item.state not in ("held", "falling"):
                    self._object_world.check_support(item, s.objects, self._solids)
        self._referee.edited(s.referee, edit.name, self.time)

    def truth(self) -> Truth:
        """Ground truth, for readers of Ticks."""
        s, referee = self._state, self._state.referee
        return Truth(
            pose=s.base.pose.copy(),
            objects=tuple(
                BodyTruth(
                    name=item.name,
                    kind="cube",
                    position=_triple(item.position),
                    yaw=item.yaw,
                    state=item.state,
                    size=(item.side,) * 3,
                )
                for item in s.objects
            ),
            agents=tuple(
                BodyTruth(
                    name=agent.name,
                    kind=agent.kind,
                    position=(float(state.pose[0]), float(state.pose[1]), 0.0),
                    yaw=float(state.pose[2]),
                    state=state.mode,
                    size=(2.0 * agent.radius, 2.0 * agent.radius, agent.height),
                )
                for agent, state in zip(self.scene.agents, s.agents, strict=True)
            ),
            obstacles=tuple(_obstacle_truth(item) for item in s.obstacles),
            contacts=self._referee.contacts(referee),
            picks=referee.picks,
            places=len(referee.placed),
            drops=referee.drops,
            min_base_clearance=referee.min_base_clearance,
            min_arm_clearance=referee.min_arm_clearance,
            min_ee_obstacle=referee.min_ee_obstacle,
            ee_obstacle=referee.ee_obstacle,
            plant_faults=tuple(referee.check.faults.values()),
        )

    def _substep(self) -> None:
        s = self._state
        before, old_v, old_w, old_tcp = self.time, s.base.v, s.base.w, s.tcp
        if s.command.gripper != s.gripper_command:
            s.gripper_command = s.command.gripper
            hand = self._frames(s.base.pose, s.arm.q)[TCP]
            self._gripper.command(s.gripper, s.gripper_command, before, hand[:3, 3], hand[:3, :3], s.objects)
        self._base.step(s.base, s.command.twist)
        self._arm.step(s.arm, s.command.joint_velocity)
        s.substep += 1
        self._refresh_solids(s.obstacles, s.taken)
        frames = self._frames(s.base.pose, s.arm.q)
        s.tcp = frames[TCP, :3, 3].copy()
        velocity = (s.tcp - old_tcp) / SUBSTEP
        rotation, hand = frames[TCP, :3, :3], frames[HAND, :3, 3]
        self._gripper.step(s.gripper, self.time, s.tcp, rotation, hand, velocity, s.objects, self._solids)
        for item in s.objects:
            if item.state == "falling":
                self._object_world.fall(item, s.objects, self._solids)
        if s.agents:
            look = s.substep % DECISION_STEPS == 0
            self._agents.step(s.agents, look, self._shadow(frames) if look else _NO_SHADOW, self._in_the_way)
        twist = np.array([s.base.v, s.base.w])
        mean_twist = np.array([0.5 * (old_v + s.base.v), 0.5 * (old_w + s.base.w)])
        self._localisation.step(s.localisation, s.base.pose, mean_twist, twist)
        self._sense(frames)
        self._referee.step(s.referee, self._world(self.time, s.base, s.arm, s.gripper, s.tcp, s.objects, s.agents))

    def _sense(self, frames: Array) -> None:
        s = self._state
        if s.substep % self._lidar_period == 0:
            z = self.scene.robot.lidar.z
            agents = self._agents.discs(s.agents)
            discs = np.vstack([self._lidar_discs, agents[agents[:, 3] >= z, :3]])
            cubes = [
                item for item in s.objects if item.state != "held" and abs(item.position[2] - z) <= 0.5 * item.side
            ]
            segments = np.vstack([self._lidar_segments, *(_square(item) for item in cubes)])
            self._lidar.sweep(s.lidar, self.time, s.base.pose, s.localisation.pose, segments, discs)
        if s.substep % self._camera_period == 0:
            self._camera.frame(
                s.camera,
                self.time,
                s.base.pose,
                s.localisation.odometry,
                frames[HAND],
                frames,
                s.objects,
                self._solids,
                self._agents.discs(s.agents),
            )

    def _frames(self, pose: Array, q: Array) -> Array:
        """World transforms of `ARM_FRAMES`, shape (11, 4, 4)."""
        c, s = math.cos(pose[2]), math.sin(pose[2])
        x, y, z = self._mount
        T = np.array(
            [
                [c, -s, 0.0, pose[0] + c * x - s * y],
                [s, c, 0.0, pose[1] + s * x + c * y],
                [0.0, 0.0, 1.0, z],
                [0.0, 0.0, 0.0, 1.0],
            ]
        )
        return T @ fk_arm(q)

    def _shadow(self, frames: Array) -> RobotShadow:
        base, foot = self._state.base, self.scene.robot.footprint
        rectangles = []
        for ahead in _SHADOW_TIMES:
            heading = float(base.pose[2]) + base.w * ahead
            middle = float(base.pose[2]) + 0.5 * base.w * ahead
            x = float(base.pose[0]) + base.v * ahead * math.cos(middle) + foot.offset_x * math.cos(heading)
            y = float(base.pose[1]) + base.v * ahead * math.sin(middle) + foot.offset_x * math.sin(heading)
            rectangles.append(rectangle(x, y, heading, (foot.length, foot.width)))
        discs = np.array([[frames[i, 0, 3], frames[i, 1, 3], radius] for i, radius in _SHADOW_LINKS])
        first = 4 * np.arange(len(rectangles) + 1)
        return RobotShadow(corners=np.vstack(rectangles), first=first, discs=discs)

    def _refresh_solids(self, obstacles: tuple[AddObstacle, ...], taken: tuple[str, ...]) -> None:
        """Arrays of the world for these obstacles: a cache, so it is no part of the state."""
        if self._cached_for == (obstacles, taken):
            return
        self._cached_for = (obstacles, taken)
        standing = [solid for solid in self.scene.solids if solid.name not in taken]
        self._solids: Solids = build_solids(standing, self.scene.bins, obstacles)
        self._in_the_way = self._solids.below(self._tallest)
        self._lidar_segments = self._solids.segments_at(self.scene.robot.lidar.z)
        self._lidar_discs = self._solids.discs_at(self.scene.robot.lidar.z)

    def _world(
        self,
        now: float,
        base: BaseState,
        arm: ArmState,
        gripper: GripperState,
        tcp: Array,
        objects: list[ObjectState],
        agents: list[AgentState],
    ) -> World:
        return World(
            time=now,
            pose=base.pose,
            twist=np.array([base.v, base.w]),
            q=arm.q,
            dq=arm.dq,
            width=gripper.width,
            held=gripper.held,
            tcp=tcp,
            objects=objects,
            solids=self._solids,
            agents=self._agents.discs(agents),
            agent_velocity=np.array(
                [[state.v * math.cos(state.pose[2]), state.v * math.sin(state.pose[2])] for state in agents]
            ).reshape(-1, 2),
        )


_NO_SHADOW = RobotShadow(corners=np.zeros((0, 2)), first=np.zeros(1, dtype=np.int64), discs=np.zeros((0, 3)))


def _triple(point: Array) -> tuple[float, float, float]:
    return float(point[0]), float(point[1]), float(point[2])


def _obstacle_truth(item: AddObstacle) -> BodyTruth:
    disc = obstacle_disc(item)
    size = item.size if disc is None else (2.0 * disc[0], 2.0 * disc[0], disc[1])
    return BodyTruth(
        name=item.name, kind=item.shape, position=(item.x, item.y, 0.0), yaw=wrap_angle(item.heading), size=size
    )


def _square(item: ObjectState) -> Array:
    frame = np.array([item.position[0], item.position[1], item.yaw])
    half = 0.5 * item.side
    corners = from_frame(frame, np.array([[-half, -half], [half, -half], [half, half], [-half, half]]))
    return np.hstack([corners, np.roll(corners, -1, axis=0)])
