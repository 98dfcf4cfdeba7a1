"""Messages of an external robot: conversion to and from types of the control loop (`model.plant`), and checks.

An invalid message is ignored, and the twin says why.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec
import numpy as np

from motm_twin.bus.plant_messages import (
    VERSION,
    ClockReached,
    DetectionData,
    DetectionList,
    RobotState,
    ScanData,
    TruthData,
    Vector,
)
from motm_twin.model.geometry import Array, compose
from motm_twin.model.plant import Detection, Scan, Truth

_CLEARANCES = ("min_base_clearance", "min_arm_clearance", "min_ee_obstacle", "ee_obstacle")


def vector(values: Array) -> Vector:
    """An array as plain numbers."""
    return np.asarray(values, dtype=float).tolist()


def array(values: Vector, length: int, name: str) -> Array:
    """Plain numbers as an array; ValueError when they are not ``length`` finite ones."""
    if len(values) != length or not all(map(math.isfinite, values)):
        raise ValueError(f"{name} needs {length} finite numbers")
    return np.array(values, dtype=float)


def scan_data(scan: Scan, life: str) -> ScanData:
    """A sweep as it travels."""
    return ScanData(
        version=VERSION,
        life=life,
        stamp=scan.stamp,
        pose=vector(scan.pose),
        origin=vector(scan.origin),
        angle_min=scan.angle_min,
        angle_step=scan.angle_step,
        range_min=scan.range_min,
        range_max=scan.range_max,
        ranges=[value if value < math.inf else None for value in scan.ranges.tolist()],
    )


def scan_of(data: ScanData, origin: float) -> Scan:
    """A received sweep, times counted from ``origin`` [s]; ValueError when its numbers are not usable."""
    numbers = (data.stamp, data.angle_min, data.angle_step, data.range_min, data.range_max)
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a scan needs finite numbers")
    return Scan(
        stamp=data.stamp - origin,
        ranges=np.array([math.inf if value is None else value for value in data.ranges], dtype=float),
        angle_min=data.angle_min,
        angle_step=data.angle_step,
        origin=array(data.origin, 2, "origin of a scan"),
        range_min=data.range_min,
        range_max=data.range_max,
        pose=array(data.pose, 3, "pose of a scan"),
    )


def detection_list(detections: tuple[Detection, ...], stamp: float, life: str) -> DetectionList:
    """A frame of the camera as it travels."""
    seen = [
        DetectionData(
            stamp=one.stamp,
            name=one.name,
            p_base=vector(one.p_base),
            yaw_base=float(one.yaw_base),
            position_sd=float(one.position_sd),
            odometry=vector(one.odometry),
        )
        for one in detections
    ]
    return DetectionList(version=VERSION, life=life, stamp=stamp, detections=seen)


def detection_of(data: DetectionData, origin: float) -> Detection:
    """A received detection, times counted from ``origin`` [s]."""
    return Detection(
        stamp=data.stamp - origin,
        name=data.name,
        p_base=array(data.p_base, 3, "p_base of a detection"),
        yaw_base=data.yaw_base,
        position_sd=data.position_sd,
        odometry=array(data.odometry, 3, "odometry of a detection"),
    )


_TRAVEL = tuple(name for name in Truth.__struct_fields__ if name != "physics")  # forces stay in the robot's report


def truth_data(truth: Truth, stamp: float, life: str) -> TruthData:
    """Ground truth as it travels."""
    fields: dict[str, Any] = {name: getattr(truth, name) for name in _TRAVEL}
    for name in _CLEARANCES:
        fields[name] = fields[name] if math.isfinite(fields[name]) else None
    fields["pose"] = vector(truth.pose)
    return TruthData(version=VERSION, life=life, stamp=stamp, **fields)


def truth_of(data: TruthData) -> Truth:
    """Received ground truth."""
    fields: dict[str, Any] = {name: getattr(data, name) for name in _TRAVEL}
    for name in _CLEARANCES:
        fields[name] = math.inf if fields[name] is None else fields[name]
    fields["pose"] = array(data.pose, 3, "true pose")
    return Truth(**fields)


def moved(detection: Detection, T_run_odometry: Array) -> Detection:
    """A detection of a restarted robot, transformed to the odometry frame of the run."""
    return Detection(
        stamp=detection.stamp,
        name=detection.name,
        p_base=detection.p_base,
        yaw_base=detection.yaw_base,
        position_sd=detection.position_sd,
        odometry=compose(T_run_odometry, detection.odometry),
    )


MAX_BYTES = 1024 * 1024
MAX_AHEAD = 1.0  # [s] that a scan or a frame of the camera may be stamped later than the newest state
LARGEST = 1e11  # of any measure: 3,000 years in s; sums and products of larger ones overflow
MOST = 2**53  # of any count: JSON has no larger whole numbers
FARTHEST = 1e5  # [m] from the origin of the world, or of the odometry
FASTEST = 20.0  # [m/s], [rad/s] of base and joints
TURNED = 10.0  # [rad] of a joint: more than a turn and a half must be degrees
WIDEST = 1.0  # [m] between finger pads
SHUT = -0.01  # [m] the same, of a gripper that is not well calibrated

Message = RobotState | ScanData | DetectionList | ClockReached | TruthData
_KINDS: dict[str, type[Message]] = {
    "state": RobotState,
    "scan": ScanData,
    "detections": DetectionList,
    "truth": TruthData,
    "clock": ClockReached,
}
_DECODERS = {name: msgspec.json.Decoder(kind) for name, kind in _KINDS.items()}
NAMES = tuple(_KINDS)


class RefusedMessage(ValueError):
    """A message that is ignored; the text says what is wrong with it."""


def read(name: str, payload: bytes) -> Message:
    """The message of that key; raises `RefusedMessage`."""
    if len(payload) > MAX_BYTES:
        raise RefusedMessage(f"{len(payload)} bytes: at most {MAX_BYTES} are taken")
    try:
        message = _DECODERS[name].decode(payload)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise RefusedMessage(str(error)) from None
    if message.version != VERSION:
        raise RefusedMessage(f"version {message.version!r}: this twin reads {VERSION!r}")
    _require_bounded(message)
    if isinstance(message, RobotState):
        _check_state(message)
    elif isinstance(message, ScanData):
        _vector("origin", message.origin, 2)
        _pose("pose", message.pose)
    elif isinstance(message, DetectionList):
        for one in message.detections:
            if one.stamp > message.stamp + MAX_AHEAD:
                raise RefusedMessage(f"stamp of {one.name!r} is {one.stamp - message.stamp:.1f} s after its picture")
            _vector(f"p_base of {one.name!r}", one.p_base, 3)
            _pose(f"odometry of {one.name!r}", one.odometry)
            if one.position_sd < 0.0:
                raise RefusedMessage(f"position_sd of {one.name!r} is {one.position_sd:g} m: it can not be negative")
    elif isinstance(message, TruthData):
        _pose("pose", message.pose)
    return message


def _require_bounded(value: Any, name: str = "") -> None:
    """Raise `RefusedMessage` for a number that is too large to compute with, however deep; ranges are checked later."""
    if isinstance(value, float | int):
        most = LARGEST if isinstance(value, float) else MOST
        if not abs(value) <= most:
            said = f"{value:g}" if isinstance(value, float) else f"a whole number of {value.bit_length()} bits"
            raise RefusedMessage(f"{name} has {said}: {most:g} at most can be")
    elif isinstance(value, msgspec.Struct):
        for field in value.__struct_fields__:
            if field != "ranges":
                _require_bounded(getattr(value, field), field)
    elif isinstance(value, list | tuple):
        for part in value:
            _require_bounded(part, name)


def _check_state(state: RobotState) -> None:
    _pose("pose", state.pose)
    _pose("odometry", state.odometry)
    _within("twist", _vector("twist", state.twist, 2), -FASTEST, FASTEST, "m/s, rad/s")
    _within("q", _vector("q", state.q, 7), -TURNED, TURNED, "rad")
    _within("dq", _vector("dq", state.dq, 7), -FASTEST, FASTEST, "rad/s")
    _within("gripper_width", [state.gripper_width], SHUT, WIDEST, "m")


def _pose(name: str, values: Sequence[float]) -> None:
    _within(name, _vector(name, values, 3)[:2], -FARTHEST, FARTHEST, "m")


def _vector(name: str, values: Sequence[float], length: int) -> Sequence[float]:
    if len(values) != length or not all(map(math.isfinite, values)):
        raise RefusedMessage(f"{name} needs {length} finite numbers, and has {_short(values)}")
    return values


def _within(name: str, values: Iterable[float], low: float, high: float, unit: str) -> None:
    for value in values:
        if not low <= value <= high:
            raise RefusedMessage(f"{name} has {value:g}: {low:g} to {high:g} {unit} can be")


def _short(values: Sequence[Any]) -> str:
    return f"{len(values)}" if len(values) > 8 else str(list(values))
