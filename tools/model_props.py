"""Our own models of what stands or drives in a scene: a Temi-like robot, the red cube, the bin."""

import numpy as np
import trimesh
from shapes import (
    Model,
    box,
    common,
    curve,
    cut,
    disc,
    edges,
    moved,
    paint,
    revolve,
    rounded,
    slab,
    squircle,
    stack,
    sweep,
)

WHITE = paint("#f1f2f4", rough=0.4)
DARK = paint("#24272c", rough=0.55)
RUBBER = paint("#141518", rough=0.95)
GLOSS = paint("#08090b", rough=0.12)
GREY = paint("#8d949c", rough=0.45)
FACE = paint("#0a1420", rough=0.15, glow=0.4)
LIGHT = paint("#3fe0d0", rough=0.4, glow=0.95)
RED = paint("#d2232a", rough=0.5)
BLUE = paint("#3d6f9e", rough=0.6)
BLUE_DARK = paint("#2f5880", rough=0.65)

TILT = 28.0  # [deg] of the tablet, looking up
TABLET = (0.075, 0.895)  # [m] x, z of the tablet's centre


def temi_model() -> Model:
    """Temi-like robot, 1 m tall within 0.25 m of its axis, driving along x; origin on the floor."""
    model = Model()
    _temi_base(model)
    _temi_neck(model)
    _temi_tablet(model)
    return model


def _temi_base(model: Model) -> None:
    outline = squircle(0.46, 0.40, power=2.7, count=96)
    arch = [
        moved(
            trimesh.creation.cylinder(radius=0.083, height=0.10, sections=56),
            (-0.035, side * 0.214, 0.075),
            turn="x",
            degrees=90.0,
        )
        for side in (1, -1)
    ]
    arch += [box((0.166, 0.10, 0.075), (-0.035, side * 0.214, 0.0375)) for side in (1, -1)]
    model.add(RUBBER, cut(stack(outline, edges(0.022, 0.075, inset=0.006, radius=0.016, steps=5)), *arch))
    slot = stack(outline, [(0.04, 0.022), (0.145, 0.022)])
    well = [moved(tool, (0.0, 0.004 * np.sign(tool.centroid[1]), 0.0)) for tool in arch]
    model.add(GLOSS, cut(slot, *well))
    lower = stack(outline, edges(0.066, 0.092, inset=0.0, radius=0.006, steps=4))
    model.add(WHITE, cut(lower, *arch))
    dome = [(0.112, 0.012), (0.114, 0.004), (0.122, 0.0), (0.138, 0.003)]
    dome += [(0.138 + 0.052 * np.sin(a), 0.003 + 0.145 * (1.0 - np.cos(a)) ** 1.15) for a in np.linspace(0.12, 1.5, 12)]
    model.add(WHITE, cut(stack(outline, dome), *arch))
    model.add(LIGHT, cut(stack(outline, edges(0.1085, 0.1135, inset=0.0085, radius=0.001, steps=2)), *arch))

    tyre = revolve([(0.075 - i, z) for z, i in edges(-0.016, 0.016, radius=0.009, steps=5)], sections=56)
    hub = revolve(
        [(0.053, 0.0), (0.053, 0.0165), (0.048, 0.0185), (0.027, 0.015), (0.023, 0.018), (0.0, 0.0185)], sections=48
    )
    for side in (1, -1):
        for material, mesh in ((RUBBER, tyre), (GREY, hub)):
            model.add(material, moved(mesh, (-0.035, side * 0.183, 0.075), turn="x", degrees=-90.0 * side))
    caster = revolve([(0.022 - i, z) for z, i in edges(-0.010, 0.010, radius=0.004, steps=3)], sections=28)
    model.add(RUBBER, moved(caster, (0.165, 0.0, 0.022), turn="x", degrees=90.0))


def _temi_neck(model: Model) -> None:
    path = curve(
        [
            (-0.075, 0, 0.155),
            (-0.100, 0, 0.32),
            (-0.098, 0, 0.50),
            (-0.062, 0, 0.68),
            (0.0, 0, 0.80),
            (0.055, 0, 0.875),
        ],
        44,
    )
    share = np.linspace(0.0, 1.0, len(path))
    flare = 0.055 * np.exp(-share / 0.05)
    widths = 0.094 - 0.040 * share + flare
    depths = 0.052 - 0.020 * share + flare
    model.add(WHITE, sweep(path, [squircle(d, w, power=3.2, count=40) for d, w in zip(depths, widths, strict=True)]))
    strip = slice(4, 40)
    front = path[strip] + np.array([0.001, 0.0, 0.0])
    outlines = [
        np.array([0.5 * d - 0.0045, 0.0]) + squircle(0.014, 0.48 * w, power=4.0, count=28)
        for d, w in zip(depths[strip], widths[strip], strict=True)
    ]
    model.add(DARK, sweep(front, outlines))

    tray = stack(squircle(0.235, 0.23, power=3.2, count=72), edges(0.455, 0.471, radius=0.006, steps=5))
    pocket = stack(squircle(0.205, 0.20, power=3.2, count=72), [(0.4625, 0.004), (0.475, 0.0)])
    model.add(WHITE, moved(cut(tray, pocket), (0.045, 0.0, 0.0)))
    model.add(
        DARK,
        moved(stack(squircle(0.206, 0.201, power=3.2, count=72), [(0.460, 0.003), (0.4635, 0.003)]), (0.045, 0.0, 0.0)),
    )
    bracket = sweep(
        curve([(-0.10, 0, 0.40), (-0.06, 0, 0.425), (-0.02, 0, 0.448)], 14), [squircle(0.024, 0.075, count=28)] * 14
    )
    model.add(WHITE, bracket)


def _temi_tablet(model: Model) -> None:
    def place(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
        """From the tablet's own plane (x up the screen, y left, z out of the screen) to the robot."""
        return moved(moved(mesh, (0, 0, 0), turn="y", degrees=90.0 - TILT), (TABLET[0], 0.0, TABLET[1]))

    def flip(mesh: trimesh.Trimesh, x: float, y: float) -> trimesh.Trimesh:
        return place(moved(mesh, (-x, y, 0.0)))

    model.add(WHITE, place(slab(0.176, 0.262, -0.012, 0.005, corner=0.022, edge=0.006)))
    model.add(GLOSS, place(slab(0.166, 0.252, 0.0, 0.0062, corner=0.017, edge=0.0012)))
    model.add(FACE, place(slab(0.142, 0.222, 0.0, 0.0068, corner=0.010, edge=0.0004)))
    model.add(DARK, flip(disc(0.0035, 0.004, 0.0072, edge=0.0004, sections=20), 0.0775, 0.0))
    for y in (-0.044, 0.044):
        eye = stack(squircle(0.040, 0.026, power=2.4, count=36), edges(0.005, 0.0078, radius=0.0006, steps=2))
        model.add(LIGHT, flip(eye, 0.016, y))
    ring = cut(
        disc(0.034, 0.005, 0.0078, edge=0.0006, sections=64),
        trimesh.creation.cylinder(radius=0.0285, height=0.1, sections=64),
    )
    model.add(LIGHT, flip(common(ring, box((0.05, 0.05, 0.05), (0.0415, 0.0, 0.0))), -0.006, 0.0))
    joint = moved(
        trimesh.creation.cylinder(radius=0.016, height=0.075, sections=36), (0.052, 0.0, 0.872), turn="x", degrees=90.0
    )
    model.add(GREY, joint)


def cube_model() -> Model:
    """Red cube of 40 mm with softened edges; origin at its centre."""
    model = Model()
    angle = np.linspace(0.0, 0.5 * np.pi, 5)
    radius, half = 0.0025, 0.02
    levels = [(-half + radius * (1 - np.sin(a)), radius * (1 - np.cos(a))) for a in angle[::-1]]
    levels += [(half - radius * (1 - np.sin(a)), radius * (1 - np.cos(a))) for a in angle]
    model.add(RED, stack(rounded(0.04, 0.04, 0.003, steps=5), levels))
    return model


def bin_model() -> Model:
    """Open square bin, 0.40 m outside, walls 10 mm, 0.10 m high; origin at the middle of its underside."""
    model = Model()
    body = stack(rounded(0.40, 0.40, 0.016), edges(0.0, 0.098, inset=0.002, radius=0.006))
    rim = stack(rounded(0.40, 0.40, 0.016), edges(0.084, 0.10, radius=0.003))
    hollow = stack(rounded(0.38, 0.38, 0.010), [(0.006, 0.003), (0.009, 0.0), (0.2, 0.0)])
    grips = [box((0.09, 0.5, 0.022), (0.0, 0.0, 0.062)), box((0.5, 0.09, 0.022), (0.0, 0.0, 0.062))]
    model.add(BLUE, cut(body, hollow, *grips[:1]))
    model.add(BLUE_DARK, cut(rim, hollow))
    ribs = [box((0.005, 0.401, 0.072), (x, 0.0, 0.047)) for x in (-0.15, -0.09, 0.09, 0.15)]
    model.add(BLUE_DARK, *[cut(rib, box((0.5, 0.397, 0.5), (0, 0, 0.1))) for rib in ribs])
    return model
