"""The simulated robot and its world as a Plant: sensors, edits and the referee around a `Mechanics` that moves bodies.

By default it is kinematic: contact stops or pushes nothing except cubes at the fingers and thrown bodies. A
base that is driven into a box passes through it, and the referee records the contact.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress

import msgspec
import numpy as np

from motm_twin.model.arm_kernels import HAND, TCP, fk_arm, placed_frames
from motm_twin.model.edits import WorldEdit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import SUBSTEP, Actuation, Observation, Truth
from motm_twin.model.profile import READY, ArmSpec
from motm_twin.model.scene import PlanarPose, Point, Scene, Task
from motm_twin.model.state import Stateful
from motm_twin.sim.agent_kernels import shadow_corners
from motm_twin.sim.agents import Agents, AgentState, start_agent
from motm_twin.sim.bodies import RobotObstruction, slide_body, square_outline
from motm_twin.sim.crowd import DECISION_STEPS, NO_ROBOT, RobotShadow
from motm_twin.sim.faults import CubeMover, FaultEffects, expire, gripper_with
from motm_twin.sim.gripper import Gripper
from motm_twin.sim.kernels import compile_gaps
from motm_twin.sim.mechanics import NO_SLIDES, ControlErrors, DriveCommand, Kinematics, Mechanics, Moved, drives
from motm_twin.sim.objects import ObjectWorld, start_objects
from motm_twin.sim.plant_state import ArmState, BaseState, PlantState, truth_of
from motm_twin.sim.referee import Referee
from motm_twin.sim.sensors import Camera, CameraState, Lidar, LidarState, Localisation, Picture
from motm_twin.sim.solids import Furnishings, Layout, Scenery, build_scenery
from motm_twin.sim.verdict import NOT_JUDGED, World
from motm_twin.sim.world_edits import Effects, Rehearsal, check_edit

_RNG = 0x11DA2, 0xCA3E2A, 0x10CA7E  # seeds of lidar, camera, localisation
_SHADOW_TIMES = np.array([0.0, 0.4, 0.8])  # [s] ahead at which agents expect the base
_SHADOW_FIRST = 4 * np.arange(len(_SHADOW_TIMES) + 1)
_SHADOW_LINKS = np.array([2, 4, 5, 7, HAND, TCP])  # frames of discs that stand for the arm
_SHADOW_RADII = np.array([0.10, 0.10, 0.10, 0.10, 0.11, 0.06])  # [m]


class _MountedArm:
    """Kinematics of the arm on the base."""

    def __init__(self, arm: ArmSpec) -> None:
        self._mount = (arm.mount_x, arm.mount_y)
        self._mount_frame = np.eye(4)  # world
        self._mount_frame[2, 3] = arm.mount_z

    def __call__(self, pose: Array, q: Array) -> Array:
        """World transforms of `ARM_FRAMES`, shape (11, 4, 4)."""
        base_x, base_y, heading = pose.tolist()
        c, s = math.cos(heading), math.sin(heading)
        (x, y), T = self._mount, self._mount_frame
        T[0, 0], T[0, 1], T[0, 3] = c, -s, base_x + c * x - s * y
        T[1, 0], T[1, 1], T[1, 3] = s, c, base_y + s * x + c * y
        return placed_frames(T, fk_arm(q))


class SimulatedPlant(Stateful[PlantState]):
    """A robot in a scene: `observe`, `command`, `step`; `apply` and `truth` for persons and programs."""

    def __init__(
        self, scene: Scene, arm_start: Array = READY, mechanics: Callable[[Scene], Mechanics] | None = None
    ) -> None:
        """A plant at the start of the scene; arm_start [rad], shape (7,); ``mechanics``: other than `Kinematics`."""
        robot, noise, mismatch = scene.robot, scene.noise, scene.mismatch
        self.scene = scene
        shaken = noise if robot.has_arm else msgspec.structs.replace(noise, arm_rate_sd=0.0)
        self._errors = ControlErrors(shaken, mismatch, scene.seed)
        self._command_delay = round(mismatch.command_delay / SUBSTEP)
        self._object_world = ObjectWorld(SUBSTEP)
        self._gripper = gripper_with(scene, self._object_world, SUBSTEP)
        self._agents = Agents(SUBSTEP)
        self._lidar = Lidar(robot.lidar, noise.lidar_range_sd)
        self._named = scene.detections == "named"
        self._camera = Camera(robot.camera, noise, named=self._named, bias=self._errors.camera_bias)
        self._camera_latency = round(noise.camera_latency / SUBSTEP)
        self._localisation = Localisation(noise, SUBSTEP)
        self._referee = Referee(scene, SUBSTEP)
        self._frames = _MountedArm(robot.arm)
        self._lidar_period = max(1, round(1.0 / (robot.lidar.rate * SUBSTEP)))
        self._camera_period = max(1, round(1.0 / (robot.camera.rate * SUBSTEP)))
        self._furnishings = Furnishings(scene)
        kinematics = Kinematics(*drives(scene, SUBSTEP), self._gripper, self._object_world, self._frames)
        self._mechanics = kinematics if mechanics is None else mechanics(scene)
        self._effects = Effects(self._furnishings, self._object_world, self._frames, SUBSTEP)
        self._cube_mover = CubeMover(scene)
        self._faults = FaultEffects(scene, SUBSTEP)
        compile_gaps()
        self._start(arm_start)

    def _start(self, arm_start: Array) -> None:
        scene = self.scene
        pose = np.array(scene.start, dtype=float)
        at_rest = Actuation(twist=np.zeros(2), joint_velocity=np.zeros(7), gripper="open")
        lidar, camera, localisation = (np.random.default_rng([scene.seed, tag]) for tag in _RNG)
        arm = ArmState(q=np.array(arm_start, dtype=float), dq=np.zeros(7))
        agents = [start_agent(agent, rank, added=False) for rank, agent in enumerate(scene.agents)]
        tallest = max((agent.height for agent in scene.agents), default=0.0)
        self._refresh_caches(build_scenery(self._furnishings, Layout(), tallest), agents)
        self._state = s = PlantState(
            substep=0,
            command=at_rest,
            base=BaseState(pose=pose),
            arm=arm,
            tcp=np.zeros(3),
            gripper=self._gripper.start(),
            gripper_command="open",
            objects=start_objects(scene.objects),
            agents=agents,
            lidar=LidarState(rng=lidar),
            camera=CameraState(rng=camera),
            localisation=self._localisation.start(pose, localisation),
            referee=NOT_JUDGED,
        )
        frames, links = self._mechanics.begin(s, self._scenery)
        s.tcp = frames[TCP, :3, 3].copy()
        s.referee = self._referee.start(self._world(links=links))
        self._sense(frames)

    @property
    def time(self) -> float:
        """Simulated time [s]."""
        return self._state.substep * SUBSTEP

    def observe(self) -> Observation:
        """Sensor readings now."""
        s = self._state
        return self._faults.late(s.faults, self._reported(), s.substep)

    def _reported(self) -> Observation:
        """The observation with the faults of pose, odometry and gripper, before any delay of the motion report."""
        s = self._state
        return Observation(
            time=self.time,
            pose=self._faults.localised(s.faults, s.localisation, s.substep).copy(),
            odometry=self._faults.odometry(s.faults, s.localisation, s.substep).copy(),
            twist=s.localisation.twist.copy(),
            q=s.arm.q.copy(),
            dq=s.arm.dq.copy(),
            gripper_width=s.gripper.width,
            gripper_moving=Gripper.moving(s.gripper) and not s.faults.active("gripper_stuck"),
            scan=s.lidar.scan,
            detections=s.camera.picture.detections,
            camera_stamp=s.camera.picture.stamp if self.scene.robot.has_arm else None,
        )

    def command(self, actuation: Actuation) -> None:
        """Set the command that acts from now on, or after the command delay of the scene's mismatch."""
        s = self._state
        if self._command_delay:
            s.commands = (*s.commands, (s.substep + self._command_delay, actuation))
        else:
            s.command = actuation

    def step(self, dt: float) -> None:
        """Let dt [s] pass, a multiple of `SUBSTEP`."""
        count = round(dt / SUBSTEP)
        if count < 1 or abs(count * SUBSTEP - dt) > 1e-9:
            raise ValueError(f"step of {dt} s: must be a positive multiple of {SUBSTEP} s")
        for _ in range(count):
            self._substep()
        s = self._state
        for edit in self._cube_mover.attempts(s.objects, s.base.pose, self._scenery.solids):
            with suppress(ValueError):  # the world may refuse it
                self.apply(edit)
                break

    def restore(self, state: PlantState) -> None:
        """Continue from a snapshot."""
        super().restore(state)
        self._refresh_caches(self._effects.scenery(self._state, self._scenery), self._state.agents)
        self._mechanics.prepare(self._state, self._scenery)

    def rehearsal(self) -> Rehearsal:
        """A rehearsal of queued edits, one after another; discard it before `apply`, `step` or `restore`."""
        return Rehearsal(self._effects, self._state, self._scenery)

    def apply(self, edit: WorldEdit) -> None:
        """Apply an edit of a person; raises ValueError when it is impossible."""
        s = self._state
        check_edit(self._furnishings, s, self._scenery, edit)
        effect, scenery = self._effects.apply(s, self._scenery, edit)
        self._refresh_caches(scenery, s.agents)
        world = self._world(links=self._mechanics.edited(s, scenery))
        self._referee.edited(s.referee, world, moved=effect.moved, disturbed=effect.disturbed)
        if effect.pushed:
            self._referee.pushed(s.referee, world)

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """Give the referee the current task list: it counts objects that end up in the bins of this list."""
        self._referee.expect(self._state.referee, tasks)

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """Give the referee the announced places of furniture, which are those in the robot's map."""
        s = self._state
        s.layout = msgspec.structs.replace(s.layout, announced=tuple(announced.items()))
        self._refresh_caches(self._effects.scenery(s, self._scenery), s.agents)

    def truth(self) -> Truth:
        """Ground truth, for readers of Ticks."""
        truth = truth_of(self._state, self._furnishings, self._referee, SUBSTEP)
        felt = self._mechanics.felt(self._state, truth.contacts)
        return truth if felt is None else msgspec.structs.replace(truth, physics=felt)

    def _substep(self) -> None:
        s = self._state
        while s.commands and s.commands[0][0] <= s.substep:
            s.command, s.commands = s.commands[0][1], s.commands[1:]
        stuck = s.faults.active("gripper_stuck")
        wider = s.command.gripper == "open" and s.command.opening != s.gripper.opening
        if (s.command.gripper != s.gripper_command or wider) and not stuck:
            s.gripper_command, s.gripper.opening = s.command.gripper, s.command.opening
            self._mechanics.grip(s, self.time, self._mechanics.frames(s))
        twist, more_lag, grip = self._faults.base(s.faults, s.command.twist)
        rates = self._faults.rates(s.faults, self._errors.rates(s.command.joint_velocity, s.substep))
        command = DriveCommand(twist=twist, more_lag=more_lag, grip=grip, rates=rates, stuck=stuck)
        moved = self._mechanics.substep(s, command, self)
        self._localisation.step(s.localisation, s.base.pose, moved.mean_twist, (s.base.v, s.base.w))
        self._sense(moved.frames)
        self._referee.step(s.referee, self._world(moved, links=moved.links))

    @property
    def scenery(self) -> Scenery:
        """Everything that does not move by itself."""
        return self._scenery

    def slide(self) -> tuple[Mapping[str, Point], tuple[str, ...]]:
        """Move thrown bodies; their velocities in this substep, and the objects carried along."""
        s = self._state
        shapes = self._referee.robot
        robot = RobotObstruction(shapes, shapes.place(s.base.pose, s.arm.q, s.gripper.width))
        slides, riding = dict(s.slides), []
        for name in slides:
            riding += slide_body(s, self._scenery.solids, name, robot, SUBSTEP)
            self._scenery = self._effects.scenery(s, self._scenery)
        return slides, tuple(riding)

    def drive_agents(self, frames: Array, slides: Mapping[str, Point]) -> None:
        """Move the agents on for a substep."""
        s = self._state
        if s.agents:
            look = s.substep % DECISION_STEPS == 0
            shadow = self._shadow(frames) if look else NO_ROBOT
            self._agents.step(s.agents, look, shadow, self._scenery.in_the_way, slides)

    def _sense(self, frames: Array) -> None:
        s = self._state
        if s.faults.on:
            expire(s.faults, s.substep)
        self._faults.inject_due(s.faults, s.substep)
        if s.substep % self._lidar_period == 0 and not s.faults.active("lidar_off"):
            segments, discs = self._at_lidar_height()
            previous, localised = s.lidar.scan, self._faults.localised(s.faults, s.localisation, s.substep)
            self._lidar.sweep(s.lidar, self.time, s.base.pose, localised, segments, discs)
            self._faults.sweep(s.faults, s.lidar, previous, s.substep)
        if s.substep % self._camera_period == 0 and self.scene.robot.has_arm:
            self._photograph(frames)
        if s.lidar.late:
            s.lidar.arrive(s.substep)
        if s.camera.late:
            s.camera.arrive(s.substep)
        if s.faults.active("state_delay"):
            self._faults.report(s.faults, self._reported(), s.substep)

    def _at_lidar_height(self) -> tuple[Array, Array]:
        """Segments (s, 4) and discs (d, 3) [m] that the lidar can see."""
        s, z = self._state, self.scene.robot.lidar.z
        segments, discs = self._scenery.lidar_segments, self._scenery.lidar_discs
        cubes = [item for item in s.objects if item.state != "held" and abs(item.position[2] - z) <= 0.5 * item.side]
        for item in cubes:
            corners = square_outline(item).corners
            segments = np.concatenate([segments, np.hstack([corners, np.roll(corners, -1, axis=0)])])
        if s.agents:
            agents = self._agents.discs(s.agents)
            discs = np.concatenate([discs, agents[agents[:, 3] >= z, :3]])
        return segments, discs

    def _photograph(self, frames: Array) -> None:
        s, previous = self._state, self._state.camera.picture
        if s.faults.active("camera_off"):
            s.camera.picture, s.camera.late = Picture(previous.stamp), []
            return
        frame = (self.time, s.base.pose, self._faults.odometry(s.faults, s.localisation, s.substep))
        self._camera.take(s.camera, frame, frames, s.objects, self._scenery.solids, self._agents.discs(s.agents))
        found = self._faults.detections(s.faults, s.camera.picture.detections, s.objects, frames[HAND, :3, 3], frame)
        if not self._named:
            found = tuple(msgspec.structs.replace(one, name="") for one in found)
        s.camera.picture = s.camera.picture._replace(detections=found)
        late = s.faults.on.get("camera_delay")
        latency = self._camera_latency + (0 if late is None else round(late.value / SUBSTEP))
        s.camera.late = [entry for entry in s.camera.late if entry[0] < s.substep + latency]  # drop overtaken ones
        if latency:
            s.camera.delay(s.substep + latency, previous)

    def _shadow(self, frames: Array) -> RobotShadow:
        base, foot = self._state.base, self.scene.robot.footprint
        corners = shadow_corners(base.pose, base.v, base.w, _SHADOW_TIMES, foot.length, foot.width, foot.offset_x)
        discs = np.column_stack([frames[_SHADOW_LINKS, :2, 3], _SHADOW_RADII])[: len(frames) * self.scene.robot.has_arm]
        velocity = (base.v * math.cos(base.pose[2]), base.v * math.sin(base.pose[2]))
        return RobotShadow(corners=corners, first=_SHADOW_FIRST, discs=discs, velocity=velocity)

    def _refresh_caches(self, scenery: Scenery, agents: Sequence[AgentState]) -> None:
        """Update the data derived from the state, which is a cache and no part of it."""
        self._scenery = scenery
        self._bodies = tuple((item.agent.name, item.agent.radius, item.agent.height) for item in agents)

    def _world(self, moved: Moved | None = None, *, links: Mapping[str, Array] | None) -> World:
        """The world for the referee, after a substep or, without ``moved``, in the present state."""
        s = self._state
        return World(
            time=self.time,
            pose=s.base.pose,
            twist=np.array([s.base.v, s.base.w]) if moved is None else moved.twist,
            q=s.arm.q,
            dq=s.arm.dq,
            width=s.gripper.width,
            held=s.gripper.held,
            tcp=s.tcp,
            objects=s.objects,
            solids=self._scenery.solids,
            agents=self._agents.discs(s.agents),
            agent_states=s.agents,
            agent_bodies=self._bodies,
            slides=NO_SLIDES if moved is None else moved.slides,
            riders=() if moved is None else moved.riding,
            links=links,
            solid=moved is not None and self._mechanics.solid,
            faults=() if moved is None else moved.faults,
        )
