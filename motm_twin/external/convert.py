"""Conversion between types of the control loop (`model.plant`) and messages (`bus.plant_messages`)."""

import math
from typing import Any

import numpy as np

from motm_twin.bus.plant_messages import (
    VERSION,
    DetectionData,
    DetectionList,
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


def truth_data(truth: Truth, stamp: float, life: str) -> TruthData:
    """Ground truth as it travels."""
    fields: dict[str, Any] = {name: getattr(truth, name) for name in truth.__struct_fields__}
    for name in _CLEARANCES:
        fields[name] = fields[name] if math.isfinite(fields[name]) else None
    fields["pose"] = vector(truth.pose)
    return TruthData(version=VERSION, life=life, stamp=stamp, **fields)


def truth_of(data: TruthData) -> Truth:
    """Received ground truth."""
    fields: dict[str, Any] = {name: getattr(data, name) for name in Truth.__struct_fields__}
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
