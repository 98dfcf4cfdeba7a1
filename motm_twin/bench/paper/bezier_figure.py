"""The Bezier figure (Paper, Sec. III-E): 4.35 m in 8.7 s, where rotating, translating and rotating takes 9.2 s."""

import math

import numpy as np

from motm_twin.bench.paper import ground
from motm_twin.bench.paper.part import Drawn
from motm_twin.bench.paper.style import BLUE, GREY, ONE_COLUMN, RED, figure, styled
from motm_twin.model.profile import Footprint
from motm_twin.planning.bezier import bezier_curve, curve_length, curve_time
from motm_twin.planning.parameters import DEG, StaaParameters
from motm_twin.planning.rtr import path_rtr

START = np.array([0.0, 0.0, -30.0 * DEG])  # the poses of the paper's figure: Rotate 30 deg,
GOAL = np.array([4.0, 0.0, 90.0 * DEG])  # Translate 4 m, Rotate 90 deg
SPEED, TURN = 0.5, 100.0 * DEG  # [m/s], [rad/s] of the paper's figure
SAMPLES = 400  # of the curve that is measured; the search uses 16
PUBLISHED = {"distance_m": 4.0, "bezier_length_m": 4.35, "bezier_time_s": 8.7, "path_rtr_s": 9.2}


def numbers() -> dict[str, float]:
    """Lengths [m] and times [s] of the two ways between the poses."""
    offset = StaaParameters().bezier_offset
    curve = bezier_curve(START, GOAL, offset=offset, samples=SAMPLES)
    straight = np.array([START[:2], GOAL[:2]])
    return {
        "distance_m": float(math.dist(START[:2], GOAL[:2])),
        "bezier_length_m": float(curve_length(curve)),
        "bezier_time_s": float(curve_time(curve, START[2], GOAL[2], SPEED, TURN)),
        "path_rtr_s": path_rtr(straight, START[2], GOAL[2], v_f=SPEED, v_r=0.5 * SPEED, w_max=TURN),
        "offset": offset,
    }


def draw() -> Drawn:
    """Both ways from pose to pose, and what they take."""
    found = numbers()
    curve = bezier_curve(START, GOAL, offset=found["offset"], samples=SAMPLES)
    reach = found["offset"] * found["distance_m"]
    first = START[:2] + reach * np.array([math.cos(START[2]), math.sin(START[2])])
    second = GOAL[:2] - reach * np.array([math.cos(GOAL[2]), math.sin(GOAL[2])])
    with styled():
        fig = figure(ONE_COLUMN, 41.0)
        axes = fig.add_subplot()
        axes.plot([0, 4], [0, 0], "--", color=RED, lw=1.6, zorder=3)
        axes.plot(curve[:, 0], curve[:, 1], "-", color=BLUE, lw=2.0, zorder=4)
        for pose, point in ((START, first), (GOAL, second)):
            axes.plot(*zip(pose[:2], point, strict=True), ":", color=GREY, lw=1.0)
            axes.plot(*point, "D", color="white", mec=GREY, ms=4.5, zorder=6)
            ground.robot(axes, pose, Footprint(), colour="#BBD7EA")
        rtr = f"PathRTR: 30°, {found['distance_m']:.0f} m, 90°: {found['path_rtr_s']:.1f} s"
        bezier = f"Bézier: {found['bezier_length_m']:.2f} m, {found['bezier_time_s']:.1f} s"
        axes.text(2.0, 0.1, rtr, color=RED, ha="center", fontsize=7.5)
        axes.text(2.1, -0.86, bezier, color=BLUE, ha="center", va="top", fontsize=7.5)
        ground.metres(axes, (-0.55, 4.55), (-1.25, 0.55))
    rows = [{"quantity": name, "here": round(found[name], 4), "published": value} for name, value in PUBLISHED.items()]
    return Drawn(
        name="bezier",
        title="Bézier path and PathRTR between the same two poses",
        caption=(
            f"The poses of the paper's figure at {SPEED} m/s and 100°/s. Diamonds: the control points, at "
            f"{100 * found['offset']:.0f} % of the distance in front of the start and behind the goal."
        ),
        n="no trial: computed by the planner's own functions",
        rows=rows,
        facts={**found, "curve": curve},
        figure=fig,
    )
