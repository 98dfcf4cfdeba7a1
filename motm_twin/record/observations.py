"""What a robot reported, period by period, as messages: with these the run of an external robot is computed again."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from motm_twin.control.tick import Tick
from motm_twin.model.edits import WorldEdit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Actuation, Detection, Observation, Scan
from motm_twin.model.scene import PlanarPose, Scene, Task

OBSERVATIONS_VERSION = "motm.observations/1"
Vector = list[float]


class ScanSample(msgspec.Struct, frozen=True, kw_only=True):
    """One sweep, exactly; fields as in `model.plant.Scan`, no return is null."""

    stamp: float
    ranges: list[float | None]
    angle_min: float
    angle_step: float
    origin: Vector
    range_min: float
    range_max: float
    pose: Vector


class DetectionSample(msgspec.Struct, frozen=True, kw_only=True):
    """One object seen, exactly; fields as in `model.plant.Detection`."""

    stamp: float  # [s] simulated
    name: str  # "" when the camera does not know which object it is
    p_base: Vector  # [m] centre in the base frame, x, y, z
    yaw_base: float  # [rad] in the base frame
    position_sd: float  # [m] per axis
    odometry: Vector  # pose of the base at the stamp, x, y, heading


class Sample(msgspec.Struct, frozen=True, kw_only=True):
    """What one arm step saw; scan and detections only where they are others than in the sample before."""

    time: float  # [s] simulated
    pose: Vector  # localised base pose x, y, heading, world
    odometry: Vector  # dead-reckoned base pose x, y, heading
    twist: Vector  # forward speed [m/s], yaw rate [rad/s]
    q: Vector  # [rad] arm joints, 7
    dq: Vector  # [rad/s] arm joint rates, 7
    gripper_width: float  # [m]
    gripper_moving: bool
    ahead: float = 0.0  # [s] by which this is a prediction: from when it was observed to when the command acts
    age: float = 0.0  # [s] of the newest state of the robot
    scan: ScanSample | None = None
    detections: list[DetectionSample] | None = None


class ObservationsMessage(msgspec.Struct, frozen=True, kw_only=True):
    """What the arm steps of one period saw, oldest first. The first period of a run has scan and detections."""

    version: str  # motm.observations/1
    run: int  # as in the ticks
    server_time: float  # [s] when it was sent
    index: int  # of the period
    samples: list[Sample]
    restarted: bool = False  # control had been away before this period


class ObservationEncoder:
    """Makes the messages of a run, in order."""

    def __init__(self) -> None:
        self._run = -1
        self._scan: Scan | None = None
        self._detections: tuple[Detection, ...] | None = None

    def message(self, tick: Tick, run: int, server_time: float) -> ObservationsMessage:
        """Of one period."""
        if run != self._run:
            self._run, self._scan, self._detections = run, None, None
        samples = [self._sample(seen) for seen in tick.reported or tick.samples]
        return ObservationsMessage(
            version=OBSERVATIONS_VERSION,
            run=run,
            server_time=server_time,
            index=tick.index,
            samples=samples,
            restarted=tick.restarted,
        )

    def _sample(self, seen: Observation) -> Sample:
        scan = None if seen.scan is None or seen.scan is self._scan else _fields(seen.scan, ScanSample)
        same = seen.detections is self._detections
        found = None if same else [_fields(one, DetectionSample) for one in seen.detections]
        self._scan, self._detections = seen.scan, seen.detections
        return _fields(seen, Sample, scan=scan, detections=found)


class RecordedPlant:
    """A robot that reports what was recorded, whatever it is told. Takes edits of the world without an effect."""

    mirror = False
    shared = True

    def __init__(self, messages: Iterable[ObservationsMessage]) -> None:
        """``messages``: of one run from its first period on, without a gap; ValueError else."""
        self.periods = 0  # that it reports
        self._samples: list[Observation] = []
        self._restarts: set[int] = set()  # first sample of each period before which control had been away
        scan, detections = None, ()
        for expected, message in enumerate(messages):
            if message.index != expected:
                raise ValueError(f"the observations of period {expected} are missing: they go on with {message.index}")
            if message.restarted:
                self._restarts.add(len(self._samples))
            for sample in message.samples:
                _check(sample, expected)
                scan = scan if sample.scan is None else _scan(sample.scan)
                if sample.detections is not None:
                    detections = tuple(_detection(one) for one in sample.detections)
                self._samples.append(_observation(sample, scan, detections))
            self.periods = expected + 1
        self._at = 0

    def begin(self, scene: Scene) -> None:
        """From the first sample on."""
        self._at = 0

    def observe(self) -> Observation:
        """The sample of now; ValueError after the last one."""
        if self._at >= len(self._samples):
            raise ValueError(f"the recording has {len(self._samples)} samples: there is no other")
        return self._samples[self._at]

    def command(self, actuation: Actuation) -> None:
        """Without an effect: what the robot did is known."""

    def step(self, dt: float) -> None:
        """On to the next sample."""
        self._at += 1

    def truth(self) -> None:
        """Nobody knows."""

    def rehearsal(self) -> "RecordedPlant":
        """Every edit that was accepted is again."""
        return self

    def accept(self, edit: WorldEdit) -> None:
        """As above."""

    def apply(self, edit: WorldEdit) -> None:
        """Its effect is in what the robot saw."""

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """There is no referee."""

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """There is no referee."""

    def ready(self) -> bool:
        """There is another sample."""
        return self._at < len(self._samples)

    def text(self) -> str:
        """What it is."""
        return f"a recorded robot: {len(self._samples)} samples"

    def interrupted(self) -> bool:
        """Whether control was away before the period that begins now."""
        return self._at in self._restarts


def _fields(source: Any, target: Any, **others: Any) -> Any:
    """The fields of ``target`` taken from ``source``, arrays as lists; infinite numbers in them as null."""
    taken = {name: _plain(getattr(source, name)) for name in target.__struct_fields__ if name not in others}
    return target(**taken, **others)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        finite = np.isfinite(value)
        return [item if ok else None for item, ok in zip(value.tolist(), finite.tolist(), strict=True)]
    return value.item() if isinstance(value, np.generic) else value


def _array(values: Sequence[float | None]) -> Array:
    return np.array([np.inf if value is None else value for value in values], dtype=float)


def _arrays(sample: msgspec.Struct, **others: Any) -> dict[str, Any]:
    names = [name for name in sample.__struct_fields__ if name not in others]
    values = {name: getattr(sample, name) for name in names}
    return {name: _array(value) if isinstance(value, list) else value for name, value in values.items()} | others


_LENGTHS = {"pose": 3, "odometry": 3, "twist": 2, "q": 7, "dq": 7}
_LENGTHS_SEEN = {"p_base": 3, "odometry": 3}
_LARGEST = 1e6  # of any number of a pose, a joint or a rate: what is more was not measured


def _check(sample: Sample, period: int) -> None:
    """Raise ValueError for numbers that no robot reports: a recording may come from anybody. Control checks scans."""
    seen = [(part, _LENGTHS_SEEN) for part in sample.detections or ()]
    for part, lengths in [(sample, _LENGTHS), *seen]:
        for name, length in lengths.items():
            values = getattr(part, name)
            if len(values) != length or any(abs(value) > _LARGEST for value in values):
                raise ValueError(f"period {period}: {name} has {len(values)} numbers, or one that cannot be")
    if not abs(sample.time) <= _LARGEST or not abs(sample.gripper_width) <= 1.0:
        raise ValueError(f"period {period}: its time or the gripper's width cannot be")


def _scan(sample: ScanSample) -> Scan:
    return Scan(**_arrays(sample))


def _detection(sample: DetectionSample) -> Detection:
    return Detection(**_arrays(sample))


def _observation(sample: Sample, scan: Scan | None, detections: tuple[Detection, ...]) -> Observation:
    return Observation(**_arrays(sample, scan=scan, detections=detections))
