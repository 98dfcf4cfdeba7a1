"""Conversion of Ticks, observations and the reports that repeat an external robot's run to messages on the bus."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from motm_twin.bus import messages
from motm_twin.bus.plant_messages import to_message
from motm_twin.control.arm.types import ArmStep
from motm_twin.control.tick import Tick
from motm_twin.model.geometry import Array
from motm_twin.model.plant import BodyTruth, Contact, CutIn, Detection, Observation, Scan, Truth
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Reason
from motm_twin.model.scene import PlanarPose
from motm_twin.perception.tracks import IDENTITY, RADIUS, SD, VX, VY
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.prediction import ellipses

_DRAWN = 4  # decimals of values that are only drawn: 0.1 mm
_EXACT = 9
_EXPECTED = (1.0, 2.0, 3.0)  # [s] ahead: times of the shown predictions of dynamic obstacles
_TIME = 6  # simulated time in steps of 1 us: 1.97, not 1.9700000000000015
JOINT_NAMES = [f"panda_joint{number}" for number in range(1, 8)]
TCP_FRAME, CAMERA_FRAME, LIDAR_FRAME = "panda_tcp", "camera", "lidar"
_POSITION = 5  # digits: 0.01 mm
_QUATERNION = 6


def seconds(time: float) -> float:
    """A simulated time [s], rounded for a message."""
    return round(float(time), _TIME)


def numbers(values: object, digits: int = _DRAWN) -> list:
    """An array as nested lists of rounded numbers, equal to `numpy.round` in half the time."""
    scale = 10.0**digits
    return (np.rint(np.asarray(values, dtype=float) * scale) / scale).tolist()


def as_message(source: Any, target: Any, digits: int = _DRAWN, **others: Any) -> Any:
    """The message ``target``: ``others``, and the fields of ``source`` with the same names, arrays rounded."""
    names = (name for name in target.__struct_fields__ if name not in others)
    return target(**{name: _sent(getattr(source, name), digits) for name in names}, **others)


def _sent(value: Any, digits: int) -> Any:
    if isinstance(value, float | int | str | None):
        return value
    if isinstance(value, np.ndarray):
        return numbers(value, digits)
    if isinstance(value, tuple):
        kind = _OF_TRUTH.get(type(value[0])) if value else None
        return [msgspec.convert(one, kind, from_attributes=True) for one in value] if kind else list(value)
    return _typed(value) if isinstance(value, Reason) else value.item()


_OF_TRUTH = {Contact: messages.ContactMessage, CutIn: messages.CutInMessage}


def body_message(body: BodyTruth) -> messages.BodyMessage:
    """One true body."""
    return as_message(body, messages.BodyMessage, position=numbers(body.position), size=numbers(body.size))


def _typed(why: Reason) -> Reason:
    """A reason without infinite numbers, which JSON cannot carry."""
    value, limit = (0.0 if math.isinf(number) else float(number) for number in (why.value, why.limit))
    return msgspec.structs.replace(why, value=value, limit=limit, cause=why.cause and _typed(why.cause))


def _track(track: Array) -> messages.TrackMessage:
    return messages.TrackMessage(
        track=int(track[IDENTITY]),
        position=numbers(track[:2]),
        velocity=numbers(track[VX : VY + 1]),
        radius=round(float(track[RADIUS]), _DRAWN),
        position_sd=round(float(track[SD]), _DRAWN),
        expected=numbers(ellipses(track, _EXPECTED)),
        pace=round(math.hypot(track[VX], track[VY]), _DRAWN),
    )


def _arm(step: ArmStep) -> messages.ArmMessage:
    given = step.actuation
    return as_message(
        step,
        messages.ArmMessage,
        time=seconds(step.time),
        base_twist=numbers(given.twist),
        joint_velocity=numbers(given.joint_velocity),
        gripper=given.gripper,
        slack=numbers(step.slack, _EXACT),
    )


def _forces(truth: Truth | None) -> messages.ForcesMessage | None:
    felt = None if truth is None else truth.physics
    if felt is None:
        return None
    newest = felt.grasps[-1] if felt.grasps else None
    return messages.ForcesMessage(
        fingers=_rounded(felt.finger_forces),
        external_torque=_rounded(felt.external_torque),
        torque_peaks=_rounded(felt.torque_peaks),
        phantoms=list(felt.phantoms),
        wrist=_rounded(felt.wrist),
        wrist_peaks=_rounded(felt.wrist_peaks),
        grasp=None if newest is None else msgspec.convert(newest, messages.GraspMessage, from_attributes=True),
    )


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 3) for value in values]


def bodies(truth: Truth | None) -> dict[str, Any]:
    """Fields of a tick with the true bodies and the injected faults; empty without ground truth."""
    groups, names = ("objects", "agents", "obstacles", "furniture"), ("removed", "faults")
    if truth is None:
        return {field: [] for field in (*groups, *names)}
    listed = {group: [body_message(body) for body in getattr(truth, group)] for group in groups}
    return listed | {name: list(getattr(truth, name)) for name in names}


def tick_message(
    tick: Tick,
    run: int,
    server_time: float,
    *,
    began: float = 0.0,
    first: int = 0,
    past: int = -1,
    ended: float | None = None,
    announced: Mapping[str, PlanarPose] | None = None,
) -> messages.TickMessage:
    """The message of one period.

    ``ended`` [s]: completion time; ``announced``: poses of furniture that were announced to the robot.
    """
    truth = tick.truth
    seen = numbers(tick.observation.pose, _EXACT)
    true_pose = seen if truth is None else numbers(truth.pose, _EXACT)
    return as_message(
        tick,
        messages.TickMessage,
        version=messages.TICK_VERSION,
        run=run,
        began=began,
        first=first,
        past=past,
        ended=ended,
        server_time=server_time,
        time=seconds(tick.time),
        robot=as_message(tick.observation, messages.RobotMessage, _EXACT, true_pose=true_pose),
        **bodies(truth),
        announced={name: [*numbers(pose[:2]), float(pose[2])] for name, pose in (announced or {}).items()},
        tasks=[as_message(task, messages.TaskMessage) for task in tick.tasks],
        beliefs=[as_message(belief, messages.BeliefMessage) for belief in tick.beliefs],
        placement=as_message(tick.placement, messages.PlacementMessage),
        plan=as_message(
            tick.plan,
            messages.PlanMessage,
            staa_path=[],
            encounters=[
                as_message(other, messages.EncounterMessage, time=seconds(other.time), reason=str(other.why))
                for other in tick.plan.encounters
            ],
        ),
        arm=[_arm(step) for step in tick.arm],
        events=[as_message(event, messages.EventMessage, time=seconds(event.time)) for event in tick.events],
        stage_ms={name: round(float(value), 3) for name, value in tick.stage_ms.items()},
        score=None if truth is None else as_message(truth, messages.ScoreMessage),
        forces=_forces(truth),
        preview=False,
        tracks=[_track(track) for track in tick.map.tracks],
        edits=list(tick.edits),
        inspected=None,
    )


def grid_bytes(world: WorldMap) -> bytes:
    """Occupancy and proximity of a map in one byte per cell (see GRID_ENCODING)."""
    cells = np.clip(world.proximity * 254.0, 0.0, 254.0).astype(np.uint8)
    cells[world.occupied != 0] = 255
    return cells.tobytes()


def grid_info(world: WorldMap, run: int) -> messages.GridInfo:
    """The attachment that goes with `grid_bytes`."""
    height, width = world.occupied.shape
    return messages.GridInfo(
        version=messages.GRID_VERSION,
        run=run,
        encoding=messages.GRID_ENCODING,
        resolution=float(world.resolution),
        origin=[float(world.origin[0]), float(world.origin[1])],
        width=int(width),
        height=int(height),
        stamp=seconds(world.stamp),
    )


class RobotEncoder:
    """Makes the messages of one robot; holds its kinematics."""

    def __init__(self, profile: RobotProfile) -> None:
        from motm_twin.model.kinematics import Frankie  # slow to import: only once the server listens

        self._robot = Frankie(profile)
        lidar = profile.lidar
        self._lidar = np.array([lidar.x, lidar.y, lidar.z])

    def state(self, observation: Observation, run: int, server_time: float) -> messages.RobotStateMessage:
        """The robot at one instant."""
        return as_message(
            observation,
            messages.RobotStateMessage,
            _EXACT,
            version=messages.ROBOT_VERSION,
            run=run,
            server_time=server_time,
            time=round(float(observation.time), _EXACT),
            joint_names=JOINT_NAMES,
            frames=self._frames(observation),
        )

    def scan(self, scan: Scan, run: int, server_time: float) -> messages.ScanMessage:
        """One sweep."""
        about: dict[str, Any] = {"version": messages.SCAN_VERSION, "run": run, "server_time": server_time}
        return as_message(scan, messages.ScanMessage, _EXACT, **about, ranges=numbers(scan.ranges))

    def _frames(self, observation: Observation) -> dict[str, list[float]]:
        from scipy.spatial.transform import Rotation  # as above

        from motm_twin.model.assets import LINKS

        links = self._robot.link_transforms(observation.pose, observation.q, observation.gripper_width)
        tcp = np.eye(4)
        tcp[:3, 3], tcp[:3, :3] = self._robot.tcp_pose(observation.pose, observation.q)
        lidar = links[0].copy()
        lidar[:3, 3] += lidar[:3, :3] @ self._lidar
        camera = links[LINKS.index("panda_hand")]  # the palm camera looks along its z axis
        transforms = np.concatenate([links, np.stack([tcp, camera, lidar])])
        names = (*LINKS, TCP_FRAME, CAMERA_FRAME, LIDAR_FRAME)
        positions = np.round(transforms[:, :3, 3], _POSITION).tolist()
        x_y_z_w = Rotation.from_matrix(transforms[:, :3, :3]).as_quat(canonical=True)  # w is not negative
        turns = np.round(x_y_z_w[:, [3, 0, 1, 2]], _QUATERNION).tolist()
        return {name: [*position, *turn] for name, position, turn in zip(names, positions, turns, strict=True)}


class ObservationEncoder:
    """Makes the messages of a robot's reports, in order; unchanged scans and detections are left out."""

    def __init__(self) -> None:
        self._run = -1
        self._scan: Scan | None = None
        self._detections: tuple[Detection, ...] | None = None

    def message(self, tick: Tick, run: int, server_time: float) -> messages.ObservationsMessage:
        """The message of one period."""
        if run != self._run:
            self._run, self._scan, self._detections = run, None, None
        samples = [self._sample(seen) for seen in tick.reported or tick.samples]
        return messages.ObservationsMessage(
            version=messages.OBSERVATIONS_VERSION,
            run=run,
            server_time=server_time,
            index=tick.index,
            samples=samples,
            restarted=tick.restarted,
        )

    def _sample(self, seen: Observation) -> messages.Sample:
        scan = None if seen.scan is None or seen.scan is self._scan else to_message(seen.scan, messages.ScanSample)
        same = seen.detections is self._detections
        found = None if same else [to_message(one, messages.DetectionSample) for one in seen.detections]
        self._scan, self._detections = seen.scan, seen.detections
        return to_message(seen, messages.Sample, scan=scan, detections=found)
