"""Reports of an external robot, period by period, as messages: with these its run is computed again."""

from typing import Any

import msgspec
import numpy as np

from motm_twin.control.tick import Tick
from motm_twin.model.plant import Detection, Observation, Scan

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
    """Input of one arm step; scan and detections only where they are others than in the sample before."""

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
    """Inputs of the arm steps of one period, oldest first. The first period of a run has scan and detections."""

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


def _fields(source: Any, target: Any, **others: Any) -> Any:
    """The fields of ``target`` taken from ``source``, arrays as lists; infinite numbers in them as null."""
    taken = {name: _plain(getattr(source, name)) for name in target.__struct_fields__ if name not in others}
    return target(**taken, **others)


def _plain(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        finite = np.isfinite(value)
        return [item if ok else None for item, ok in zip(value.tolist(), finite.tolist(), strict=True)]
    return value.item() if isinstance(value, np.generic) else value
