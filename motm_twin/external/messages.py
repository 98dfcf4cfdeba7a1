"""Messages of an external robot: conversion to and from types of the control loop (`model.plant`), and checks.

An invalid message is ignored, and the twin says why.
"""

import math
from collections.abc import Iterable, Sequence
from typing import Any

import msgspec

from motm_twin.bus.plant_messages import (
    VERSION,
    ClockReached,
    DetectionData,
    DetectionList,
    RobotState,
    ScanData,
    TruthData,
    from_message,
)
from motm_twin.model.geometry import Array, compose
from motm_twin.model.plant import Detection, Scan, Truth

_CLEARANCES = ("min_base_clearance", "min_arm_clearance", "min_ee_obstacle", "ee_obstacle")


def scan_of(data: ScanData, origin: float) -> Scan:
    """A received sweep, times counted from ``origin`` [s]."""
    return from_message(data, Scan, stamp=data.stamp - origin)


def detection_of(data: DetectionData, origin: float, T_run_odometry: Array | None = None) -> Detection:
    """A received detection, times counted from ``origin`` [s]; of a restarted robot in the odometry frame of the run.

    ``T_run_odometry`` is that of the restarted robot.
    """
    seen = from_message(data, Detection, stamp=data.stamp - origin)
    if T_run_odometry is None:
        return seen
    return msgspec.structs.replace(seen, odometry=compose(T_run_odometry, seen.odometry))


def truth_of(data: TruthData) -> Truth:
    """Received ground truth; forces stay in the robot's report."""
    clearances = {name: math.inf if (value := getattr(data, name)) is None else value for name in _CLEARANCES}
    return from_message(data, Truth, **clearances)


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
        has = str(list(values)) if len(values) <= 8 else f"{len(values)}"
        raise RefusedMessage(f"{name} needs {length} finite numbers, and has {has}")
    return values


def _within(name: str, values: Iterable[float], low: float, high: float, unit: str) -> None:
    for value in values:
        if not low <= value <= high:
            raise RefusedMessage(f"{name} has {value:g}: {low:g} to {high:g} {unit} can be")
