"""Motion by contact dynamics: drives follow their references with limited force, and all bodies push each other.

`PlantState` is the whole state: before each substep MuJoCo's data are set from it, and read back after. So a plant can
be copied, restored and edited like the kinematic one.
"""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from motm_twin.model.arm_kernels import ARM_FRAMES, FLANGE, HAND, HAND_LENGTH, TCP
from motm_twin.model.assets import LINKS
from motm_twin.model.exact import norm
from motm_twin.model.geometry import Array, wrap_angle
from motm_twin.model.plant import SUBSTEP, Contact, PhysicsTruth
from motm_twin.model.profile import Q_MAX, Q_MIN
from motm_twin.model.scene import REFLEXES, Scene
from motm_twin.physics.forces import ArmAlone, Contacts, Grasp, PhysicsState, disagreements, force_of, note_reflexes
from motm_twin.physics.gripping import Fingers
from motm_twin.physics.mjcf import (
    DAMPING,
    STIFFNESS,
    TIMESTEP,
    WHEEL_GAIN,
    WHEEL_RADIUS,
    Kind,
    base_inertia,
    compile_model,
    kind_of,
    standing_bodies,
    track,
)
from motm_twin.sim.cube_contacts import between_pads
from motm_twin.sim.grasp import near
from motm_twin.sim.mechanics import NO_SLIDES, DriveCommand, Moved, Surroundings, drives
from motm_twin.sim.objects import FLOOR_LEVEL, ObjectState, over
from motm_twin.sim.plant_state import ArmState, BaseState, PlantState
from motm_twin.sim.referee import SUPPORT_CLEAR
from motm_twin.sim.solids import Scenery, Solids

_STEPS = round(SUBSTEP / TIMESTEP)
_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_SETTLING = 30  # substeps in which all bodies settle at the start
_AHEAD = 0.05  # [rad] largest lead of a joint's reference over a joint that is blocked
_STILL = 2e-6  # [m], [rad] smaller motion of a resting object is ignored
_EDITED = 1e-9  # [m], [rad] larger differences between state and dynamics are the user's edits
_AT_REST = 0.02  # [m/s] a fallen object that is slower ...
_REST = 8  # ... for so many substeps has come to rest
_FALLS = 0.15  # [m/s] an object that moves down faster is falling
_DEEP = 0.01  # [m] deeper penetration is a fault of the simulation: a falling object moves less far in a step
_SEPARATION_TIME = 100  # substeps after an edit in which bodies that the user put into each other separate again


class _Free(NamedTuple):
    """Addresses of a free joint and its body, which have the same name."""

    q: int
    v: int
    body: int

    @classmethod
    def of(cls, model: mujoco.MjModel, name: str) -> "_Free":
        """Look up the addresses in a model."""
        joint = model.joint(name)
        return cls(int(joint.qposadr[0]), int(joint.dofadr[0]), model.body(name).id)


def _addresses(model: mujoco.MjModel, names: Sequence[str]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Addresses of the positions and of the rates of joints."""
    joints = [model.joint(name) for name in names]
    return np.array([int(one.qposadr[0]) for one in joints]), np.array([int(one.dofadr[0]) for one in joints])


def _actuators(model: mujoco.MjModel, names: Sequence[str]) -> NDArray[np.int64]:
    return np.array([model.actuator(name).id for name in names])


class Dynamics:
    """`sim.mechanics.Mechanics` in MuJoCo."""

    solid = True

    def __init__(self, scene: Scene) -> None:
        """Take robot and physics of the scene; raises ValueError for a scene without physics."""
        if scene.physics is None:
            raise ValueError("the scene has no physics parameters: set its `physics`")
        self._scene, self._physics, self._robot = scene, scene.physics, scene.robot
        self._base, self._arm = drives(scene, SUBSTEP)
        self._track = track(scene.robot)
        self._inertia = base_inertia(scene.robot, scene.physics)
        self._alone = ArmAlone(scene.robot, scene.physics) if scene.robot.has_arm else None
        self._gain = np.array(DAMPING) / np.array(STIFFNESS)
        self._fingers = Fingers(scene.robot.gripper, scene.physics, [item.side for item in scene.objects], SUBSTEP)
        self._kind: Kind | None = None
        self._solids: Solids | None = None

    def begin(self, state: PlantState, scenery: Scenery) -> tuple[Array, Mapping[str, Array] | None]:
        """Place all bodies as in the scene, and let them settle; returns frames of the arm, and the links."""
        self.prepare(state, scenery)
        data, start = self._data, state.base.pose.copy()
        mujoco.mj_resetData(self._model, data)
        self._put_base(start, level=True)
        for item in state.objects:
            self._put_object(item)
        for one in state.agents:
            data.qpos[self._agents[one.agent.name][0]] = one.pose
        width = state.gripper.width
        if self._robot.has_arm:
            data.qpos[self._joints] = data.ctrl[self._drives] = state.arm.q
            data.qpos[self._sliders] = 0.5 * width
            data.ctrl[self._width] = width
        for _ in range(_SETTLING * _STEPS):
            mujoco.mj_step(self._model, data)
        self._put_base(start, level=False)
        data.qvel[:] = 0.0
        data.time = 0.0
        mujoco.mj_forward(self._model, data)
        state.physics = PhysicsState(
            integration=np.zeros(mujoco.mj_stateSize(self._model, _STATE)),
            base=BaseState(pose=start),
            arm=ArmState(q=state.arm.q.copy(), dq=np.zeros(7)),
            grasp=Grasp(width=width),
        )
        self._save(state)
        links = self._links()
        self._read(state, scenery, (0.0, 0.0))
        return self._frames_of(links), links

    def frames(self, state: PlantState) -> Array:
        """Frames of the arm in this state."""
        self._load(state)
        return self._frames_of(self._links())

    def grip(self, state: PlantState, now: float, frames: Array) -> None:
        """Start the gripper command that changed at ``now`` [s]."""
        self._fingers.command(state, now)

    def substep(self, state: PlantState, command: DriveCommand, around: Surroundings) -> Moved:
        """Advance all bodies by `SUBSTEP`."""
        s, p, model, data = state, state.physics, self._model, self._data
        slides, riding = around.slide() if s.slides else (NO_SLIDES, ())
        scenery, grip = around.scenery, max(command.grip, 1e-3)  # not 0: measured wheel speeds are divided by it
        self.prepare(s, scenery)
        self._load(s)
        if riding:
            self._take_edits(s)
        frames = self._frames_of(self._links())
        poses = [one.pose for one in s.agents]
        around.drive_agents(frames, slides)
        self._lead_agents(s, poses, slides)
        began = (p.base.v, p.base.w)
        before = p.arm.q.copy()
        self._reference(s, command)
        turned = data.qpos[self._wheel_q].copy()
        self._fingers.reference(s.gripper, p.grasp, stuck=command.stuck)
        faults: dict[str, str] = {}
        torque, rates = np.zeros(len(self._rates)), data.qvel[self._rates].copy()
        self._contacts.begin(_lifted(s))
        for k in range(_STEPS):
            share = (k + 1) / _STEPS
            self._drive(began, p.base, grip, share)
            if self._robot.has_arm:
                data.ctrl[self._drives] = before + share * (p.arm.q - before) + self._gain * p.arm.dq
                data.ctrl[self._width] = p.grasp.width
            mujoco.mj_step(model, data)
            self._contacts.look(data, TIMESTEP)
            torque += data.qfrc_actuator[self._rates] / _STEPS
        s.substep += 1
        self._estimate(s, torque, rates)
        mean = self._wheels((data.qpos[self._wheel_q] - turned) / SUBSTEP / grip)
        s.path_length += grip * abs(mean[0]) * SUBSTEP
        mujoco.mj_kinematics(model, data)
        self._save(s)
        self._check(s, faults)
        links = self._links()
        v, w = self._wheels(data.qvel[self._wheel_v] / grip)
        self._contacts.tell(s, SUBSTEP, _between(s, links, self._robot.has_arm))
        twist = self._read(s, scenery, (v, w))
        return Moved(
            frames=self._frames_of(links),
            mean_twist=mean,
            twist=twist,
            slides=slides,
            riding=riding,
            links=links,
            faults=tuple(faults.items()),
        )

    def felt(self, state: PlantState, judged: Sequence[Contact]) -> PhysicsTruth | None:
        """Forces, torques and grasps so far, and disagreements between forces and referee."""
        p = state.physics
        forces = (*p.felt, *(force_of(other, press) for other, press in p.presses.items()))
        return PhysicsTruth(
            forces=tuple(sorted(forces, key=lambda one: one.time)),
            disagreements=disagreements(judged, forces),
            grasps=tuple(p.grasp.done),
            finger_forces=p.grasp.forces,
            external_torque=tuple(p.torque.tolist()),
            torque_peaks=tuple(p.torque_peaks.tolist()),
            reflexes=tuple(p.reflexes.values()),
            phantoms=tuple(p.trips.get(name, 0) for name in REFLEXES),
            wrist=p.wrist,
            wrist_peaks=p.wrist_peaks,
        )

    def edited(self, state: PlantState, scenery: Scenery) -> Mapping[str, Array] | None:
        """Take over the user's changes of the state; returns the links."""
        self._load_after_edit(state, scenery)
        self._take_edits(state)
        mujoco.mj_kinematics(self._model, self._data)
        self._save(state)
        state.physics.edited = state.substep
        return self._links()

    # -- the model -----------------------------------------------------------------------------------------------

    def prepare(self, state: PlantState, scenery: Scenery) -> None:
        """Compile a new model if the state needs one, and place all solids."""
        solids = scenery.solids
        agents = kind_of((), (), state.agents).agents
        if solids is self._solids and self._kind is not None and agents == self._kind.agents:
            return
        found = standing_bodies(solids)
        kind = kind_of(found, state.objects, state.agents)
        if kind != self._kind:
            self._compile(kind)
        self._solids = solids
        for i, one in enumerate(found):
            body = self._model.body(f"s{i}").id
            self._model.body_pos[body], self._model.body_quat[body] = one.place, _about_z(one.yaw)
        self._contacts.name_solids((*solids.names, *solids.disc_names))

    def _compile(self, kind: Kind) -> None:
        model = compile_model(self._scene, self._physics, kind)
        self._model, self._data, self._kind = model, mujoco.MjData(model), kind
        self._free = _Free.of(model, "base")
        self._objects = {name: _Free.of(model, f"object:{name}") for name, _ in kind.objects}
        wheels = ("left_wheel", "right_wheel")
        self._wheel_q, self._wheel_v = _addresses(model, wheels)
        self._wheel_u = _actuators(model, wheels)
        self._agents = {}
        for name, *_ in kind.agents:
            axes = [f"agent:{name}:{axis}" for axis in ("x", "y", "yaw")]
            self._agents[name] = (*_addresses(model, axes), _actuators(model, axes))
        self._rates = np.zeros(0, dtype=np.int64)
        self._link_bodies = {"base_link": self._free.body}
        if self._robot.has_arm:
            arm = [f"panda_joint{k}" for k in range(1, 8)]
            self._joints, self._rates = _addresses(model, arm)
            self._drives = _actuators(model, arm)
            self._width = model.actuator("width").id
            self._sliders, _ = _addresses(model, ("panda_leftfinger", "panda_rightfinger"))
            self._link_bodies |= {link: model.body(link).id for link in LINKS if link != "base_link"}
        self._contacts = Contacts(model, kind)

    # -- state ---------------------------------------------------------------------------------------------------

    def _load(self, state: PlantState) -> None:
        mujoco.mj_setState(self._model, self._data, state.physics.integration, _STATE)
        mujoco.mj_kinematics(self._model, self._data)

    def _save(self, state: PlantState) -> None:
        whole = np.empty(mujoco.mj_stateSize(self._model, _STATE))
        mujoco.mj_getState(self._model, self._data, whole, _STATE)
        state.physics.integration = whole

    def _load_after_edit(self, state: PlantState, scenery: Scenery) -> None:
        """Load the state into a model that fits the edited world: agents and solids may have been added or removed."""
        self._load(state)
        kept, old, model, agents = self._kind, self._data, self._model, self._agents
        q, v, warm, now = old.qpos.copy(), old.qvel.copy(), old.qacc_warmstart.copy(), old.time
        ctrl = {model.actuator(i).name: old.ctrl[i] for i in range(model.nu)}
        self.prepare(state, scenery)
        if self._kind is kept:
            return
        data = self._data
        mujoco.mj_resetData(self._model, data)
        own = min(_first_agent(agents, 0, len(q)), _first_agent(self._agents, 0, self._model.nq))
        free = min(_first_agent(agents, 1, len(v)), _first_agent(self._agents, 1, self._model.nv))
        data.qpos[:own], data.qvel[:free], data.qacc_warmstart[:free] = q[:own], v[:free], warm[:free]
        for i in range(self._model.nu):
            data.ctrl[i] = ctrl.get(self._model.actuator(i).name, 0.0)
        data.time = now
        for one in state.agents:
            at = agents.get(one.agent.name)
            here = self._agents[one.agent.name]
            if at is None:
                data.qpos[here[0]] = one.pose
            else:
                data.qpos[here[0]], data.qvel[here[1]] = q[at[0]], v[at[1]]

    def _take_edits(self, state: PlantState) -> None:
        """Copy differences between state and dynamics into the dynamics: they are the user's edits."""
        data = self._data
        here = self._planar()
        if np.abs(state.base.pose - here).max() > _EDITED:
            self._put_base(state.base.pose, level=False)
        for item in state.objects:
            at = self._objects[item.name]
            apart = np.abs(item.position - data.qpos[at.q : at.q + 3]).max()
            turned = np.abs(item.rotation - _rotation(data.qpos[at.q + 3 : at.q + 7])).max()
            if max(apart, turned) > 2.0 * _STILL:
                self._put_object(item)
        for one in state.agents:
            at = self._agents[one.agent.name]
            if np.abs(one.pose - self._agent_pose(one.agent.name)).max() > _EDITED:
                data.qpos[at[0]], data.qvel[at[1]] = one.pose, 0.0

    def _put_base(self, pose: Array, *, level: bool) -> None:
        """Put the base at a planar pose, shape (3,), keeping tilt and height; ``level``: these are set to 0."""
        data, at = self._data, self._free
        if level:
            data.qpos[at.q : at.q + 7] = (pose[0], pose[1], 0.0, *_about_z(float(pose[2])))
            return
        now = np.zeros(4)
        yaw = float(pose[2]) - float(self._planar()[2])
        mujoco.mju_mulQuat(now, np.array(_about_z(yaw)), data.qpos[at.q + 3 : at.q + 7])
        data.qpos[at.q : at.q + 2] = pose[:2]
        data.qpos[at.q + 3 : at.q + 7] = now
        c, s = math.cos(yaw), math.sin(yaw)
        vx, vy = data.qvel[at.v : at.v + 2].tolist()
        data.qvel[at.v : at.v + 2] = (c * vx - s * vy, s * vx + c * vy)

    def _put_object(self, item: ObjectState) -> None:
        at, quat = self._objects[item.name], np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(item.rotation).ravel())
        self._data.qpos[at.q : at.q + 7] = (*item.position, *quat)
        self._data.qvel[at.v : at.v + 6] = 0.0

    # -- drives --------------------------------------------------------------------------------------------------

    def _reference(self, s: PlantState, command: DriveCommand) -> None:
        """Advance the references of base and arm to the end of the substep, as ideal drives would move."""
        p = s.physics
        self._base.step(p.base, command.twist, more_lag=command.more_lag, grip=0.0)
        self._arm.step(p.arm, command.rates)
        if self._robot.has_arm:
            q = self._data.qpos[self._joints]
            p.arm.q = np.clip(p.arm.q, q - _AHEAD, q + _AHEAD)

    def _drive(self, began: tuple[float, float], end: BaseState, grip: float, share: float) -> None:
        """Command the wheel speeds at a share of the substep, times ``grip``: slip is simulated as slower wheels."""
        change = end.v - began[0], end.w - began[1]
        v, w = began[0] + share * change[0], began[1] + share * change[1]
        push, twist = self._inertia[0] * change[0] / SUBSTEP, self._inertia[1] * change[1] / SUBSTEP
        for side, wheel in zip((-0.5, 0.5), self._wheel_u.tolist(), strict=True):
            turning = grip * (v + side * self._track * w) / WHEEL_RADIUS
            torque = grip * (0.5 * push + 2.0 * side * twist / self._track) * WHEEL_RADIUS
            self._data.ctrl[wheel] = turning + torque / WHEEL_GAIN

    def _wheels(self, turning: Array) -> tuple[float, float]:
        """Forward speed [m/s] and yaw rate [rad/s] of the base for wheel rates [rad/s], shape (2,)."""
        left, right = (WHEEL_RADIUS * turning).tolist()
        return 0.5 * (left + right), (right - left) / self._track

    def _lead_agents(self, s: PlantState, before: list[Array], slides: Mapping[str, object]) -> None:
        """Command the agents' drives from their poses ``before`` to those that they want after the substep."""
        data = self._data
        for one, pose in zip(s.agents, before, strict=True):
            at = self._agents[one.agent.name]
            if one.held or one.agent.name in slides:
                data.qpos[at[0]], data.qvel[at[1]], data.ctrl[at[2]] = one.pose, 0.0, 0.0
                continue
            way = one.pose - pose
            way[2] = wrap_angle(float(way[2]))
            data.ctrl[at[2]] = way / SUBSTEP

    def _estimate(self, s: PlantState, torque: Array, before: Array) -> None:
        """Estimate the external torque on the arm in the substep from its torques, and its rates before, shape (7,)."""
        if self._alone is None:
            return
        p, data = s.physics, self._data
        dq = data.qvel[self._rates]
        q = data.qpos[self._joints] - 0.5 * SUBSTEP * dq
        ddq = (dq - before) / SUBSTEP
        p.torque = torque - self._alone.torque(q, 0.5 * (dq + before), ddq, s.gripper.width)
        note_reflexes(p, s.substep, s.substep * SUBSTEP)
        mujoco.mj_rnePostConstraint(self._model, data)
        load = data.cfrc_int[self._link_bodies["panda_hand"]]  # its torque part is about the robot's centre of mass
        arm = data.xpos[self._link_bodies["panda_hand"]] - data.subtree_com[self._free.body]
        p.wrist = norm(load[3:]), norm(load[:3] - np.cross(arm, load[3:]))
        p.wrist_peaks = max(p.wrist_peaks[0], p.wrist[0]), max(p.wrist_peaks[1], p.wrist[1])

    # -- reading -------------------------------------------------------------------------------------------------

    def _planar(self) -> Array:
        """Pose of the base in the plane, shape (3,)."""
        at, data = self._free, self._data
        x, y = data.qpos[at.q : at.q + 2].tolist()
        w, i, j, k = data.qpos[at.q + 3 : at.q + 7].tolist()
        return np.array([x, y, math.atan2(2.0 * (w * k + i * j), 1.0 - 2.0 * (j * j + k * k))])

    def _agent_pose(self, name: str) -> Array:
        pose = self._data.qpos[self._agents[name][0]].copy()
        pose[2] = wrap_angle(float(pose[2]))
        return pose

    def _links(self) -> dict[str, Array]:
        """Transforms of all links in the world."""
        found = {}
        for link, body in self._link_bodies.items():
            T = np.eye(4)
            T[:3, :3], T[:3, 3] = self._data.xmat[body].reshape(3, 3), self._data.xpos[body]
            found[link] = T
        return found

    def _frames_of(self, links: Mapping[str, Array]) -> Array:
        """Transforms of `ARM_FRAMES` in the world from those of the links, shape (11, 4, 4)."""
        frames = np.tile(np.eye(4), (len(ARM_FRAMES), 1, 1))
        if not self._robot.has_arm:
            return frames
        for i in range(8):
            frames[i] = links[f"panda_link{i}"]
        frames[HAND] = frames[TCP] = links["panda_hand"]
        frames[8], axis = frames[7], frames[7][:3, 2]
        frames[8, :3, 3] = frames[7, :3, 3] + FLANGE * axis
        frames[TCP, :3, 3] = frames[HAND, :3, 3] + HAND_LENGTH * axis
        return frames

    def _read(self, s: PlantState, scenery: Scenery, wheels: tuple[float, float]) -> Array:
        """Update the plant's state from the dynamics; returns the true twist of the base, shape (2,)."""
        data, at = self._data, self._free
        s.base.pose = self._planar()
        s.base.v, s.base.w = wheels
        c, sine = math.cos(s.base.pose[2]), math.sin(s.base.pose[2])
        vx, vy = data.qvel[at.v : at.v + 2].tolist()
        for item in s.objects:
            self._read_pose(item)
        if self._robot.has_arm:
            s.arm.q, s.arm.dq = data.qpos[self._joints].copy(), data.qvel[self._rates].copy()
            frames = self._frames_of(self._links())
            speed = norm(frames[TCP, :3, 3] - s.tcp) / SUBSTEP
            s.tcp = frames[TCP, :3, 3].copy()
            width = float(data.qpos[self._sliders].sum())
            self._fingers.read(s, frames[HAND], width, self._contacts, s.substep * SUBSTEP, speed)
        for item in s.objects:
            self._read_object_state(s, item, scenery.solids)
        for one in s.agents:
            one.pose = self._agent_pose(one.agent.name)
        return np.array([c * vx + sine * vy, data.qvel[at.v + 5]])

    def _read_pose(self, item: ObjectState) -> None:
        """Update the pose of an object; a resting one that moved less than `_STILL` keeps its pose."""
        data, at = self._data, self._objects[item.name]
        position, rotation = data.qpos[at.q : at.q + 3], _rotation(data.qpos[at.q + 3 : at.q + 7])
        moved = max(np.abs(position - item.position).max(), np.abs(rotation - item.rotation).max())
        item.velocity = data.qvel[at.v : at.v + 3].copy()
        if moved > _STILL or item.state in ("held", "falling"):
            item.position, item.rotation = position.copy(), rotation
            item.yaw = _upright_yaw(rotation)

    def _read_object_state(self, s: PlantState, item: ObjectState, solids: Solids) -> None:
        """Update the state of an object, once the held object is known."""
        data, at = self._data, self._objects[item.name]
        speed = float(np.abs(data.qvel[at.v : at.v + 6] * (1.0, 1.0, 1.0, 0.03, 0.03, 0.03)).max())
        quiet = s.physics.quiet
        if item.name == s.gripper.held:
            item.state = "held"
            quiet.pop(item.name, None)
        elif item.state == "held" or (item.state != "falling" and item.velocity[2] < -_FALLS):
            item.state = "falling"
            quiet[item.name] = 0
        elif item.state == "falling":
            pinched = item.name == s.physics.grasp.pressed
            quiet[item.name] = quiet.get(item.name, 0) + 1 if speed < _AT_REST and not pinched else 0
            if quiet[item.name] >= _REST:
                del quiet[item.name]
                item.state = _resting(item, solids)

    def _check(self, s: PlantState, faults: dict[str, str]) -> None:
        """Add faults of the simulation: solver warnings, penetration, joints beyond their limits."""
        data, now = self._data, s.substep * SUBSTEP
        for i, warning in enumerate(data.warning):
            if warning.number:
                faults["solver"] = f"{now:.2f} s: MuJoCo warns: {mujoco.mjtWarning(i).name}"
        if not np.isfinite(data.qpos).all():
            faults["solver"] = f"{now:.2f} s: MuJoCo's state is not finite"
        deep = self._contacts.deepest
        if deep > _DEEP and s.substep - s.physics.edited > _SEPARATION_TIME and not s.slides:
            faults["penetration"] = f"{now:.2f} s: {self._contacts.deepest_pair} overlap by {1e3 * deep:.1f} mm"
        if self._robot.has_arm:
            q = data.qpos[self._joints]
            over_limit = float(np.maximum(q - Q_MAX, Q_MIN - q).max())
            if over_limit > 0.01:
                faults["joint position"] = f"{now:.2f} s: joint position exceeded by {over_limit:.3g} rad"


def _first_agent(agents: dict, which: int, otherwise: int) -> int:
    """First address of the agents' positions (0) or rates (1); ``otherwise`` without agents."""
    return min((int(at[which][0]) for at in agents.values()), default=otherwise)


def _lifted(s: PlantState) -> str:
    """Object held clear of its former support, by the referee's rule; "" for none."""
    item = next((item for item in s.objects if item.name == s.gripper.held), None)
    return item.name if item is not None and item.position[2] > s.gripper.held_from_z + SUPPORT_CLEAR else ""


def _between(s: PlantState, links: Mapping[str, Array], has_arm: bool) -> set[str]:
    """Objects between the pads, by the referee's rule: fingers that touch them grasp or release them."""
    if not has_arm:
        return set()
    hand = links["panda_hand"]
    places = [(item.name, np.array([*item.position, item.yaw])) for item in s.objects if near(s.tcp, item.position)]
    return {name for name, place in places if between_pads(hand, s.gripper.width, place)}


def _about_z(yaw: float) -> tuple[float, float, float, float]:
    return math.cos(0.5 * yaw), 0.0, 0.0, math.sin(0.5 * yaw)


def _rotation(quat: Array) -> Array:
    whole = np.empty(9)
    mujoco.mju_quat2Mat(whole, quat)
    return whole.reshape(3, 3)


def _upright_yaw(rotation: Array) -> float:
    """Yaw of a cube's faces, from its most level axis: any of its axes may be the upright one."""
    level = int(np.argmin(np.abs(rotation[2])))
    return math.atan2(rotation[1, level], rotation[0, level])


def _resting(item: ObjectState, solids: Solids) -> str:
    """State of an object that has come to rest: "binned:NAME", "dropped" or "resting"."""
    for box in solids.bins:
        if box.floor_z - item.side < item.position[2] < box.rim_z + item.side and over(box, item):
            return f"binned:{box.name}"
    return "dropped" if item.bottom < FLOOR_LEVEL else "resting"
