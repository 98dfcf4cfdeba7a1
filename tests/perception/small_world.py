"""A small world for the perception tests, and a lidar that shares no code with that of the simulation."""

import math

import numpy as np
import pytest
import shapely

from motm_twin.model.known import KnownWorld
from motm_twin.model.plant import Observation, Scan
from motm_twin.model.profile import Lidar, RobotProfile
from motm_twin.model.scene import Box, Cylinder, SceneObject, Solid

LIDAR = Lidar(x=0.0, beams=361, field_of_view=math.radians(270.0))


def table() -> tuple[Solid, ...]:
    """A table top on two posts: the lidar sees the posts only."""
    top = Solid(
        name="top", shape=Box(centre=(3.0, 1.5), size=(2.0, 0.8)), z_min=0.75, z_max=0.78, mapped=True, group="table"
    )
    posts = tuple(
        Solid(
            name=f"post{x}",
            shape=Cylinder(centre=(x, 1.5), radius=0.05),
            z_min=0,
            z_max=0.75,
            mapped=True,
            group="table",
        )
        for x in (2.5, 3.5)
    )
    return (top, *posts)


POSTS = tuple(shapely.Point(x, 1.5).buffer(0.05) for x in (2.5, 3.5))


@pytest.fixture
def known() -> KnownWorld:
    """The table and a solid cabinet in a room of 8 x 7 m."""
    cabinet = Solid(name="cabinet", shape=Box(centre=(0.0, -2.0), size=(2.0, 0.4)), z_min=0.0, z_max=0.7, mapped=True)
    lamp = Solid(name="lamp", shape=Cylinder(centre=(1.0, 2.5), radius=0.3), z_min=1.9, z_max=2.3, mapped=True)
    return KnownWorld(
        robot=RobotProfile(lidar=LIDAR),
        start=(0.0, 0.0, 0.0),
        solids=(*table(), cabinet, lamp),
        objects=(SceneObject(name="cube", position=(2.2, 1.2, 0.8), yaw=0.1),),
        object_sd=0.03,
        bins=(),
        tasks=(),
        bounds=(-2.0, -3.0, 6.0, 4.0),
    )


def cast(pose: np.ndarray, bodies: list[shapely.Polygon], rng: np.random.Generator | None = None) -> np.ndarray:
    """Exact ranges of the lidar at a pose, plus 1 cm noise when a generator is given; inf where nothing is hit."""
    ranges = np.full(LIDAR.beams, np.inf)
    bearings = pose[2] + LIDAR.field_of_view * np.linspace(-0.5, 0.5, LIDAR.beams)
    along = np.column_stack([np.cos(bearings), np.sin(bearings)])
    for body in bodies:
        corners = shapely.get_coordinates(body.exterior) - pose[:2]
        left = along @ np.vstack([corners[:, 1], -corners[:, 0]]) > 0.0  # of which beam each corner is
        beam, side = np.nonzero(left[:, :-1] != left[:, 1:])
        start, end = corners[side], corners[side + 1]
        (x, y), (dx, dy) = along[beam].T, (end - start).T
        way = (start[:, 0] * dy - start[:, 1] * dx) / (x * dy - y * dx)
        met = (way >= 0.0) & (way <= LIDAR.range_max)
        np.minimum.at(ranges, beam[met], way[met])
        if shapely.intersects_xy(body, *pose[:2]):
            ranges[:] = 0.0
    return ranges if rng is None else ranges + rng.normal(0.0, 0.01, LIDAR.beams)


def scan_of(ranges: np.ndarray, pose: np.ndarray, stamp: float) -> Scan:
    """A scan with these ranges."""
    return Scan(
        stamp=stamp,
        ranges=ranges,
        angle_min=-LIDAR.field_of_view / 2,
        angle_step=LIDAR.field_of_view / (LIDAR.beams - 1),
        origin=np.zeros(2),
        range_min=LIDAR.range_min,
        range_max=LIDAR.range_max,
        pose=pose,
    )


def observe(time: float, scan: Scan | None = None, detections: tuple = (), pose=None, odometry=None) -> Observation:
    """An observation with everything else at rest."""
    pose = np.zeros(3) if pose is None else pose
    return Observation(
        time=time,
        pose=pose,
        odometry=pose if odometry is None else odometry,
        twist=np.zeros(2),
        q=np.zeros(7),
        dq=np.zeros(7),
        gripper_width=0.08,
        gripper_moving=False,
        scan=scan,
        detections=detections,
    )


def look(mapper, time: float, bodies: list, pose=None, rng=None):
    """One period of the mapper with a scan of these bodies (posts included), from a pose."""
    pose = np.zeros(3) if pose is None else np.array(pose, dtype=float)
    ranges = cast(pose, [*POSTS, *bodies], rng)
    return mapper.update(observe(time, scan_of(ranges, pose, time), pose=pose))


def box(x: float, y: float, side: float = 0.5) -> shapely.Polygon:
    """A square box."""
    return shapely.box(x - side / 2, y - side / 2, x + side / 2, y + side / 2)


def degrees(value: float) -> float:
    """Degrees to radians."""
    return math.radians(value)
