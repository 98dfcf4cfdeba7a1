"""Our own model of a small differential-drive base in the proportions of an LD-60: 0.70 x 0.50 x 0.38 m, x forward."""

import numpy as np
import trimesh
from shapes import Array, Model, box, common, cut, disc, edges, moved, paint, revolve, rounded, slab, squircle, stack

LENGTH, WIDTH, HEIGHT = 0.70, 0.50, 0.38  # [m]
MOUNT = 0.15  # [m] arm base in front of the centre
WHEEL_RADIUS, WHEEL_Y, WHEEL_WIDTH = 0.085, 0.223, 0.036  # [m]
SLOT_LOW, SLOT_HIGH = 0.186, 0.216  # [m] the laser looks out between the shells, at 0.20 m

WHITE = paint("#e9ecef", rough=0.45)
GREY = paint("#b7bec6", rough=0.5)
DARK = paint("#2a2e33", rough=0.7)
RUBBER = paint("#17191c", rough=0.95)
GLOSS = paint("#0d0f12", rough=0.15)
ALUMINIUM = paint("#aab0b6", rough=0.38, metal=0.35)
STEEL = paint("#6d747b", rough=0.35, metal=0.4)
LIGHT = paint("#35b6ff", rough=0.4, glow=0.9)
LASER = paint("#5a0f14", rough=0.15, glow=0.15)
RED = paint("#d31f26", rough=0.4)
YELLOW = paint("#f2b90f", rough=0.5)
GREEN = paint("#2bb24c", rough=0.4, glow=0.35)
SCREEN = paint("#10405f", rough=0.2, glow=0.5)
COPPER = paint("#c98a4b", rough=0.35, metal=0.4)


def base_model() -> Model:
    """The whole base; the arm's foot stands at x = 0.15 m on its top."""
    model = Model()
    _body(model)
    _wheels(model)
    _laser(model)
    _top(model)
    _console(model)
    _details(model)
    return model


def _outline(inset: float = 0.0) -> Array:
    return squircle(LENGTH - 2 * inset, WIDTH - 2 * inset, power=5.5, count=88)


def _arches(radius: float, depth: float) -> list[trimesh.Trimesh]:
    low = 0.5 * WIDTH - depth
    round_arch = trimesh.creation.cylinder(radius=radius, height=depth + 0.05, sections=64)
    middle = low + 0.5 * (depth + 0.05)
    arches = []
    for side in (1.0, -1.0):
        arches.append(moved(round_arch, (0.0, side * middle, WHEEL_RADIUS), turn="x", degrees=90.0))
        arches.append(box((2 * radius, depth + 0.05, WHEEL_RADIUS), (0.0, side * middle, 0.5 * WHEEL_RADIUS)))
    return arches


def _body(model: Model) -> None:
    arches = _arches(WHEEL_RADIUS + 0.011, 0.055)
    vents = [
        box((0.006, 0.06, 0.052), (x, side * 0.25, 0.296))
        for x in np.arange(-0.235, -0.135, 0.0125)
        for side in (1, -1)
    ]
    seams = [box((0.0022, 0.06, 0.16), (x, side * 0.25, 0.29)) for x in (-0.115, 0.19) for side in (1, -1)]

    chassis = stack(_outline(), edges(0.028, 0.06, inset=0.045, radius=0.008))
    core = stack(
        _outline(), [(0.05, 0.032), (0.18, 0.032), (0.181, 0.085), (0.222, 0.085), (0.223, 0.032), (0.36, 0.05)]
    )
    model.add(RUBBER, cut(chassis, *arches), cut(core, *arches))

    skirt = stack(_outline(), edges(0.042, 0.122, inset=0.0, radius=0.014, steps=5))
    grooves = [stack(_outline(), [(z, -0.01), (z + 0.004, -0.01)]) for z in (0.074, 0.086)]
    inner = stack(_outline(), edges(0.06, 0.11, inset=0.0035, radius=0.002))
    model.add(DARK, cut(skirt, *[cut(groove, inner) for groove in grooves], *arches))
    model.add(RUBBER, cut(stack(_outline(), [(0.0735, 0.0026), (0.0905, 0.0026)]), *arches))

    lower = stack(_outline(), [*edges(0.126, SLOT_LOW, inset=0.009, radius=0.006, steps=5)])
    model.add(WHITE, cut(lower, *arches))
    rear = stack(_outline(), [(SLOT_LOW - 0.004, 0.014), (SLOT_HIGH + 0.004, 0.014)])
    lining = [stack(_outline(), [(z - 0.0012, 0.0165), (z + 0.0012, 0.0165)]) for z in (SLOT_LOW, SLOT_HIGH)]
    model.add(GLOSS, *lining)
    model.add(GREY, common(rear, box((0.40, 0.6, 0.1), (-0.315, 0.0, 0.2))))

    upper = stack(_outline(), _upper_levels())
    model.add(WHITE, cut(upper, *vents, *seams))
    behind = stack(_outline(), [(z, inset + 0.0018) for z, inset in _upper_levels()])
    model.add(RUBBER, *[common(gap, behind) for gap in (*vents, *seams)])
    glow = stack(_outline(), edges(SLOT_HIGH - 0.001, SLOT_HIGH + 0.0065, inset=0.0085, radius=0.002, steps=3))
    model.add(LIGHT, glow)


def _upper_levels() -> list[tuple[float, float]]:
    angle = np.linspace(0.0, 0.5 * np.pi, 8)
    radius = 0.034
    wall = [(SLOT_HIGH + 0.006, 0.012), (SLOT_HIGH + 0.009, 0.009), (0.26, 0.010), (0.30, 0.0135)]
    top = [(0.368 - radius * (1 - np.sin(a)), 0.0165 + radius * (1 - np.cos(a))) for a in angle]
    return wall + top


def _wheels(model: Model) -> None:
    half = 0.5 * WHEEL_WIDTH
    bevel = [(WHEEL_RADIUS - inset, z) for z, inset in edges(-half, half, radius=0.007, steps=4)]
    tyre = revolve(bevel, sections=64)
    tread = [box((0.004, 0.01, WHEEL_WIDTH + 0.002), (0.0, WHEEL_RADIUS, 0.0))]
    grooves = [moved(t, (0, 0, 0), turn="z", degrees=a) for t in tread for a in range(0, 360, 15)]
    tyre = cut(tyre, *grooves, trimesh.creation.cylinder(radius=0.062, height=0.1, sections=64))
    hub = revolve(
        [(0.0625, -half + 0.004), (0.0625, half - 0.005), (0.050, half - 0.009), (0.022, half - 0.003), (0.018, half)]
    )
    ring = cut(
        disc(0.0585, half - 0.009, half - 0.0035), trimesh.creation.cylinder(radius=0.0535, height=0.2, sections=40)
    )
    bolts = [
        moved(disc(0.0042, half - 0.009, half - 0.002, sections=12), (0.034 * np.cos(a), 0.034 * np.sin(a), 0.0))
        for a in np.arange(6) * np.pi / 3
    ]
    for side in (1.0, -1.0):

        def place(mesh: trimesh.Trimesh, side: float = side) -> trimesh.Trimesh:
            return moved(mesh, (0.0, side * WHEEL_Y, WHEEL_RADIUS), turn="x", degrees=-90.0 * side)

        model.add(RUBBER, place(tyre))
        model.add(GREY, place(hub))
        model.add(LIGHT, place(ring))
        model.add(STEEL, *[place(bolt) for bolt in bolts])

    well = disc(WHEEL_RADIUS - 0.002, -0.001, 0.001, edge=0.0004, sections=48)
    for side in (1.0, -1.0):
        model.add(RUBBER, moved(well, (0.0, side * 0.1958, WHEEL_RADIUS), turn="x", degrees=90.0))
    wheel = revolve([(0.030 - inset, z) for z, inset in edges(-0.011, 0.011, radius=0.004, steps=2)], sections=20)
    for x in (-0.255, 0.255):
        for y in (-0.15, 0.15):
            model.add(RUBBER, moved(wheel, (x - 0.012, y, 0.030), turn="x", degrees=90.0))
            model.add(
                STEEL, box((0.03, 0.004, 0.04), (x, y - 0.015, 0.038)), box((0.03, 0.004, 0.04), (x, y + 0.015, 0.038))
            )


def _laser(model: Model) -> None:
    x = 0.298
    model.add(GLOSS, moved(disc(0.036, SLOT_LOW - 0.006, SLOT_HIGH + 0.006), (x, 0.0, 0.0)))
    model.add(LASER, moved(disc(0.0366, 0.195, 0.207), (x, 0.0, 0.0)))


def _top(model: Model) -> None:
    deck = slab(0.54, 0.36, 0.362, 0.3755, corner=0.05, edge=0.003)
    model.add(DARK, moved(deck, (-0.005, 0.0, 0.0)))
    plate = slab(0.31, 0.25, 0.372, HEIGHT - 0.0005, corner=0.02, edge=0.0015)
    model.add(ALUMINIUM, moved(plate, (MOUNT - 0.04, 0.0, 0.0)))
    bolt = disc(0.0055, HEIGHT - 0.001, HEIGHT + 0.0035, edge=0.001, sections=6)
    for dx in (-0.14, -0.07, 0.07, 0.14):
        for dy in (-0.112, 0.112):
            model.add(STEEL, moved(bolt, (MOUNT - 0.04 + dx, dy, 0.0)))
    rail = slab(0.44, 0.016, 0.374, 0.3825, corner=0.004, edge=0.0015)
    groove = box((0.42, 0.005, 0.01), (0.0, 0.0, 0.3825))
    for dy in (-0.152, 0.152):
        model.add(ALUMINIUM, moved(cut(rail, groove), (-0.005, dy, 0.0)))


def _console(model: Model) -> None:
    x, low, high = -0.205, 0.370, 0.3895
    model.add(GREY, moved(slab(0.10, 0.24, low, high, corner=0.018, edge=0.005), (x, 0.0, 0.0)))
    model.add(GLOSS, moved(slab(0.066, 0.094, high - 0.004, high + 0.0008, corner=0.005, edge=0.0005), (x, 0.045, 0.0)))
    model.add(
        SCREEN, moved(slab(0.056, 0.084, high - 0.004, high + 0.0014, corner=0.003, edge=0.0004), (x, 0.045, 0.0))
    )
    model.add(YELLOW, moved(disc(0.024, high - 0.003, high + 0.0025), (x, -0.078, 0.0)))
    stop = revolve(
        [
            (0.010, high),
            (0.010, high + 0.004),
            (0.017, high + 0.0045),
            (0.0178, high + 0.006),
            (0.016, high + 0.0085),
            (0.010, high + 0.0098),
            (0.0, high + 0.010),
        ],
        sections=32,
    )
    model.add(RED, moved(stop, (x, -0.078, 0.0)))
    for dx, material in ((0.020, GREEN), (-0.020, WHITE)):
        model.add(DARK, moved(disc(0.0115, high - 0.003, high + 0.0012), (x + dx, -0.032, 0.0)))
        model.add(material, moved(disc(0.008, high - 0.003, high + 0.003), (x + dx, -0.032, 0.0)))


def _details(model: Model) -> None:
    for side in (1.0, -1.0):
        lamp = slab(0.007, 0.058, -0.006, 0.006, corner=0.003, edge=0.002)
        model.add(LIGHT, moved(lamp, (0.3385, side * 0.115, 0.268)))
        eye = moved(disc(0.009, -0.003, 0.003, sections=24), (0.0, 0.0, 0.0), turn="y", degrees=90.0)
        model.add(GLOSS, moved(eye, (0.3375, side * 0.055, 0.268)))
        model.add(COPPER, box((0.006, 0.014, 0.024), (0.3485, side * 0.03, 0.10)))
    nose = moved(slab(0.02, 0.10, -0.003, 0.003, corner=0.006, edge=0.001), (0.0, 0.0, 0.0), turn="y", degrees=90.0)
    model.add(DARK, moved(nose, (0.3395, 0.0, 0.268)))
    port = moved(
        stack(rounded(0.05, 0.09, 0.008), edges(-0.004, 0.004, radius=0.001)), (0.0, 0.0, 0.0), turn="y", degrees=-90.0
    )
    model.add(DARK, moved(port, (-0.3375, 0.0, 0.27)))
