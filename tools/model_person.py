"""Our own model of a standing person, for scenes with people about."""

import numpy as np
import trimesh
from shapes import Array, Model, curve, loft, moved, paint, squircle

SKIN = paint("#d9a27c", rough=0.65)
HAIR = paint("#3a2a22", rough=0.8)
SHIRT = paint("#2f7f86", rough=0.8)
TROUSERS = paint("#38455c", rough=0.85)
SHOES = paint("#f0efec", rough=0.6)
SOLE = paint("#4a4f57", rough=0.9)
DARK = paint("#20242b", rough=0.6)

Ring = tuple[float, float, float, float, float]  # centre x, y, z and size along x and y [m]


def person_model() -> Model:
    """A person of 1.75 m within 0.28 m of its axis, looking along x; origin on the floor."""
    model = Model()
    _legs(model)
    _body(model)
    _arms(model)
    _head(model)
    return model


def limb(rings: list[Ring], count: int = 12, steps: int = 9, power: float = 2.3) -> trimesh.Trimesh:
    """A smooth body through level rings from bottom to top."""
    knots = np.array(rings)
    height = np.linspace(knots[0, 2], knots[-1, 2], steps)
    order = np.argsort(knots[:, 2])
    columns = [np.interp(height, knots[order, 2], knots[order, k]) for k in (0, 1, 3, 4)]
    if len(rings) > 3:
        smooth = curve([(row[0], row[1], row[2]) for row in rings], steps)
        sizes = curve([(row[3], row[4], row[2]) for row in rings], steps)
        columns, height = [smooth[:, 0], smooth[:, 1], sizes[:, 0], sizes[:, 1]], smooth[:, 2]
    loops = []
    for x, y, z, length, width in zip(columns[0], columns[1], height, columns[2], columns[3], strict=True):
        outline: Array = squircle(max(length, 0.004), max(width, 0.004), power=power, count=count)
        loops.append(np.column_stack([outline + np.array([x, y]), np.full(count, z)]))
    return loft(loops)


def _legs(model: Model) -> None:
    for side in (1.0, -1.0):
        y = 0.092 * side
        model.add(
            TROUSERS,
            limb(
                [
                    (-0.012, y, 0.07, 0.125, 0.115),
                    (-0.015, y, 0.25, 0.135, 0.125),
                    (0.004, y, 0.48, 0.135, 0.13),
                    (0.0, 0.95 * y, 0.70, 0.165, 0.16),
                    (-0.005, 0.9 * y, 0.90, 0.19, 0.18),
                ]
            ),
        )
        shoe = limb(
            [(0.045, y, 0.022, 0.275, 0.10), (0.043, y, 0.05, 0.262, 0.096), (0.0, y, 0.105, 0.13, 0.085)], 14, 5
        )
        model.add(SHOES, shoe)
        model.add(
            SOLE,
            limb(
                [(0.045, y, 0.0, 0.272, 0.098), (0.045, y, 0.012, 0.282, 0.104), (0.045, y, 0.026, 0.28, 0.103)], 14, 4
            ),
        )


def _body(model: Model) -> None:
    model.add(
        TROUSERS,
        limb(
            [(-0.005, 0.0, 0.83, 0.19, 0.31), (-0.005, 0.0, 0.90, 0.215, 0.345), (0.0, 0.0, 1.0, 0.20, 0.315)],
            28,
            6,
            2.6,
        ),
    )
    model.add(DARK, limb([(0.0, 0.0, 0.972, 0.205, 0.322), (0.0, 0.0, 1.0, 0.205, 0.32)], 18, 3, 2.6))
    model.add(
        SHIRT,
        limb(
            [
                (0.0, 0.0, 0.985, 0.218, 0.335),
                (0.002, 0.0, 1.08, 0.20, 0.305),
                (0.012, 0.0, 1.22, 0.225, 0.35),
                (0.006, 0.0, 1.345, 0.215, 0.405),
                (-0.012, 0.0, 1.425, 0.16, 0.34),
                (-0.018, 0.0, 1.475, 0.12, 0.14),
            ],
            20,
            12,
            2.5,
        ),
    )


def _arms(model: Model) -> None:
    for side in (1.0, -1.0):
        sleeve = limb(
            [
                (-0.012, 0.232 * side, 1.14, 0.098, 0.098),
                (-0.014, 0.222 * side, 1.25, 0.112, 0.108),
                (-0.012, 0.203 * side, 1.36, 0.125, 0.115),
                (-0.010, 0.176 * side, 1.43, 0.085, 0.07),
            ],
            10,
            7,
        )
        forearm = limb(
            [
                (0.075, 0.238 * side, 0.86, 0.055, 0.042),
                (0.055, 0.242 * side, 0.93, 0.062, 0.056),
                (0.020, 0.242 * side, 1.05, 0.076, 0.072),
                (-0.012, 0.236 * side, 1.16, 0.084, 0.082),
            ],
            10,
            7,
        )
        hand = limb(
            [
                (0.105, 0.230 * side, 0.735, 0.030, 0.020),
                (0.102, 0.232 * side, 0.775, 0.072, 0.032),
                (0.092, 0.234 * side, 0.83, 0.080, 0.036),
                (0.077, 0.238 * side, 0.875, 0.055, 0.042),
            ],
            10,
            7,
        )
        model.add(SHIRT, sleeve)
        model.add(SKIN, forearm, hand)


def _head(model: Model) -> None:
    model.add(SKIN, limb([(-0.016, 0.0, 1.44, 0.115, 0.115), (-0.006, 0.0, 1.55, 0.105, 0.105)], 10, 3))
    head = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    head.apply_scale((0.098, 0.077, 0.122))
    model.add(SKIN, moved(head, (0.012, 0.0, 1.622)))
    nose = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
    nose.apply_scale((0.020, 0.013, 0.024))
    model.add(SKIN, moved(nose, (0.108, 0.0, 1.612)))
    for side in (1.0, -1.0):
        ear = trimesh.creation.icosphere(subdivisions=1, radius=1.0)
        ear.apply_scale((0.020, 0.010, 0.030))
        model.add(SKIN, moved(ear, (0.002, 0.078 * side, 1.615)))
        eye = trimesh.creation.icosphere(subdivisions=1, radius=0.0105)
        model.add(DARK, moved(eye, (0.096, 0.030 * side, 1.637)))
    hair = trimesh.creation.icosphere(subdivisions=2, radius=1.0)
    hair.apply_scale((0.107, 0.087, 0.118))
    hair = hair.slice_plane((0.0, 0.0, 0.012), (-0.55, 0.0, 0.9), cap=True)
    model.add(HAIR, moved(hair, (0.002, 0.0, 1.632)))
