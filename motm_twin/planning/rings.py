"""Candidate poses on circles round a target."""

import functools
import math

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import angle_of
from motm_twin.model.geometry import Array


def ring(centre: Array, radius: float, positions: int) -> tuple[Array, Array, Array]:
    """Candidates on a circle: poses (2 n, 3), places (n, 2), place of each pose. Headings are tangential.

    Even entries drive round the target counter-clockwise, odd ones clockwise (Paper, Sec. IV).
    """
    unit, heading, place_of = _unit_ring(positions)
    place = np.asarray(centre)[:2] + radius * unit
    pose = np.empty((len(heading), 3))
    pose[:, :2], pose[:, 2] = place[place_of], heading
    return pose, place, place_of


def rings(centre: Array, radii: Array, positions: int) -> tuple[Array, Array, Array]:
    """`ring` of each of the radii (k,), one after the other: poses (2 k n, 3), places (k n, 2), place of each pose."""
    unit, heading, place_of = _unit_ring(positions)
    place = (np.asarray(centre)[:2] + radii[:, None, None] * unit).reshape(-1, 2)
    place_of = (place_of + positions * np.arange(len(radii), dtype=np.int32)[:, None]).ravel()
    return np.column_stack((place[place_of], np.tile(heading, len(radii)))), place, place_of


@functools.cache
def _unit_ring(positions: int) -> tuple[Array, Array, NDArray[np.int32]]:
    """Places (n, 2) on a circle of 1 m, two headings (2 n,) at each, and the place of each heading."""
    angle = np.arange(positions) * (2.0 * math.pi / positions)
    place_of = np.repeat(np.arange(positions, dtype=np.int32), 2)
    heading = np.repeat(angle, 2) + np.tile((0.5 * math.pi, -0.5 * math.pi), positions)
    return np.column_stack((np.cos(angle), np.sin(angle))), angle_of(np.sin(heading), np.cos(heading)), place_of


def spokes(centre: Array, radius: float, positions: int, headings: int) -> tuple[Array, Array, Array]:
    """All headings at every position of a circle: poses (n h, 3), places (n, 2), place of each pose."""
    unit, heading, place_of = _unit_spokes(positions, headings)
    place = np.asarray(centre)[:2] + radius * unit
    return np.column_stack((place[place_of], heading)), place, place_of.copy()


@functools.cache
def _unit_spokes(positions: int, headings: int) -> tuple[Array, Array, NDArray[np.int32]]:
    """Places (n, 2) on a circle of 1 m, headings (n h,) at each, and the place of each heading."""
    angle = np.arange(positions) * (2.0 * math.pi / positions)
    place_of = np.repeat(np.arange(positions, dtype=np.int32), headings)
    away = np.tile(np.arange(headings) * (2.0 * math.pi / headings), positions)
    heading = np.repeat(angle, headings) + math.pi + away
    return np.column_stack((np.cos(angle), np.sin(angle))), angle_of(np.sin(heading), np.cos(heading)), place_of
