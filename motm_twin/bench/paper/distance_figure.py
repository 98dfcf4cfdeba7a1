"""Distance from the gripper to what the lidar sees over an exp2 trial, with the regions of Sec. V."""

import math

import numpy as np
from matplotlib.patheffects import Normal, Stroke

from motm_twin.bench.paper.data import command_of
from motm_twin.bench.paper.episode import Episode
from motm_twin.bench.paper.part import Drawn
from motm_twin.bench.paper.style import BLACK, BLUE, ORANGE, TWO_COLUMNS, figure, styled
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.model.geometry import Array

NAME, TITLE = "gripper_distance", "Distance from gripper to the nearest seen obstacle"
SHOWN = 2.0  # [m] of the axis
RED = "#C1121F"  # the region of the paper is red; that of `style` is nearer to orange, and beside it looks like it
JUMP = 0.10  # [m] by which the distance falls in a period when something comes into view


def draw(episode: Episode) -> Drawn:
    """The distance over time; nothing is drawn where nothing is seen."""
    p = AvoidanceParameters()
    time = np.array([each.time for each in episode.moments])
    distance = np.array([math.nan if each.distance is None else each.distance for each in episode.moments])
    jumps = np.flatnonzero(np.abs(np.diff(distance)) > JUMP) + 1
    close = episode.measures["below_d_s"]
    with styled():
        fig = figure(TWO_COLUMNS, 56.0)
        axes = fig.add_subplot()
        axes.axhspan(
            0.0,
            p.d_s,
            facecolor=RED,
            alpha=0.8,
            hatch="////",
            edgecolor="white",
            lw=0.0,
            label=f"below $d_s$ = {p.d_s} m",
        )
        axes.axhspan(
            p.d_s, p.d_i, facecolor=ORANGE, alpha=0.35, lw=0.0, label=f"region of influence, below $d_i$ = {p.d_i} m"
        )
        axes.plot(
            np.insert(time, jumps, time[jumps]),
            np.insert(distance, jumps, math.nan),
            "-",
            color=BLUE,
            lw=1.1,
            label="distance",
            path_effects=[Stroke(linewidth=2.6, foreground="white"), Normal()],  # seen on the red, also in grey
        )
        for stretch in close:
            at = stretch["time"] + 0.5 * stretch["duration_s"]
            axes.plot(at, 0.03, "^", mfc=BLACK, mec="white", mew=0.6, ms=5, clip_on=False, zorder=3)
        axes.set_xlim(0.0, float(time[-1]))
        axes.set_ylim(0.0, SHOWN)
        axes.set_xlabel("time [s]")
        axes.set_ylabel("distance [m]")
        fig.legend(loc="outside upper center", ncols=3)
    seed = episode.spec.seed
    seen = int(np.isfinite(distance).sum())
    return Drawn(
        name=NAME,
        title=TITLE,
        caption=(
            f"Experiment 2 with four Temis, seed {seed}. As the robot itself sees it: horizontally, from the gripper's "
            f"centre to the cells that the lidar found outside the map. {_gaps(distance)} Triangles: stretches in "
            f"which the referee's true distance is below d_s ({len(close)}), with their causes in the table."
        ),
        command=command_of(episode.spec),
        n=f"one trial, {len(episode.moments)} periods, in {seen} of them an obstacle is seen",
        rows=[
            {
                "time_s": each.time,
                "distance_m": each.distance,
                "static": each.static,
                "task": each.task,
                "phase": each.phase,
            }
            for each in episode.moments
        ],
        facts={
            "d_s": p.d_s,
            "d_i": p.d_i,
            "xi": p.xi,
            "stretches_below_d_s": close,
            "approach_excess_mps": episode.measures["approach_excess_mps"],
            "advance_excess_mps": episode.measures["advance_excess_mps"],
        },
        header=(
            "From [s]",
            "For [s]",
            "Least distance [m]",
            "To",
            "Gripper moved there [m]",
            "It moved here [m]",
            "Cause",
        ),
        cells=[
            (
                f"{each['time']:.2f}",
                f"{each['duration_s']:.2f}",
                f"{each['min_m']:.2f}",
                each["other"],
                f"{each['gripper_moved_m']:.2f}",
                f"{each['other_moved_m']:.2f}",
                each["cause"] + (", beside what stands: its d_s gives way" if each["static"] else ""),
            )
            for each in close
        ],
        figure=fig,
        notes=[_line(episode)],
    )


def _gaps(distance: Array) -> str:
    """Why there is no line, where there is none."""
    above, none = float(np.mean(distance > SHOWN)), float(np.mean(np.isnan(distance)))
    said = f"Distances above {SHOWN:g} m are cut off ({100 * above:.0f} % of the time)"
    said += f", and where no obstacle is seen there is no line ({100 * none:.0f} %)" if none else ""
    return said + f"; the line is broken where it jumps by more than {JUMP} m, because another one comes into view."


def _line(episode: Episode) -> str:
    """How well the damper line was kept."""
    most, forward = episode.measures["approach_excess_mps"], episode.measures["advance_excess_mps"]
    if most is None:
        return "The gripper was never below d_i of anything that moves."
    return (
        f"Below d_i of what moves, the gripper's own true approach speed (over 50 ms) was at most {most:.3f} m/s "
        "above the damper "
        f"line, and at most {forward:.3f} m/s above it or above 0 where it asks to retreat."
    )
