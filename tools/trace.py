"""Run one trial and show what happened: a text log, and a picture of path, speed, phases and distances.

Usage: python tools/trace.py exp1 --variant trial1 --seed 0 --png out/trace.png [--from 10 --until 20]
"""

import argparse
import json
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np

from motm_twin.control.tick import Tick
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import find_method
from motm_twin.model.scene import Box, Cylinder, Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.trial import run_scene

mpl.use("Agg")
import matplotlib.pyplot as plt


def line(tick: Tick) -> str:
    """One period in one line."""
    step, plan, pose = tick.arm[-1], tick.plan, tick.truth.pose
    return (
        f"{tick.time:6.2f} task {tick.task_index} {step.phase:8s} pose ({pose[0]:5.2f} {pose[1]:5.2f} {pose[2]:5.2f})"
        f" v {tick.observation.twist[0]:5.2f} w {tick.observation.twist[1]:5.2f} acc ({plan.acceleration[0]:5.2f}"
        f" {plan.acceleration[1]:5.2f}) {plan.status:7s} {tick.placement.mode:7s} r {tick.placement.radius:.2f}"
        f" t_h {plan.t_h:5.1f} range {plan.time_to_range:5.1f} exp {plan.expansions:4d}"
        f" | err {step.error:.3f} tilt {step.tilt:.2f} dwell {step.dwell:.2f} eng {int(step.engaged)}"
        f" hold {int(step.holding)} {step.limiter} {step.qp_status if step.qp_status != 'solved' else ''}"
        f" {tick.stop_reason or step.reason}"
    )


def draw(scene: Scene, ticks: list[Tick], path: Path) -> None:
    """The trial as a picture."""
    figure, axes = plt.subplot_mosaic(
        [["map", "map"], ["speed", "speed"], ["arm", "arm"]], figsize=(13, 16), height_ratios=[3, 1, 1]
    )
    top = axes["map"]
    for solid in scene.solids:
        colour = "0.75" if solid.mapped else "orange"
        if isinstance(solid.shape, Box):
            (x, y), (sx, sy) = solid.shape.centre, solid.shape.size
            top.add_patch(plt.Rectangle((x - sx / 2, y - sy / 2), sx, sy, color=colour, alpha=0.6))
        elif isinstance(solid.shape, Cylinder):
            top.add_patch(plt.Circle(solid.shape.centre, solid.shape.radius, color=colour, alpha=0.6))
        else:
            top.add_patch(plt.Polygon(solid.shape.corners, color=colour, alpha=0.6))
    for item in scene.objects:
        top.plot(*item.position[:2], "rs", ms=4)
        top.annotate(item.name, item.position[:2], fontsize=6)
    time = np.array([tick.time for tick in ticks])
    poses = np.array([tick.truth.pose for tick in ticks])
    speed = np.array([tick.observation.twist for tick in ticks])
    points = top.scatter(poses[:, 0], poses[:, 1], c=speed[:, 0], s=6, cmap="coolwarm", vmin=-0.5, vmax=0.5)
    figure.colorbar(points, ax=top, label="forward speed [m/s]")
    for tick, pose in zip(ticks[::20], poses[::20], strict=True):
        c, s = np.cos(pose[2]), np.sin(pose[2])
        top.arrow(pose[0], pose[1], 0.12 * c, 0.12 * s, head_width=0.04, color="k", lw=0.5)
        top.annotate(f"{tick.time:.0f}", pose[:2], fontsize=5)
    for tick in ticks:
        for contact in tick.truth.contacts[-1:]:
            if abs(contact.time - tick.time) < 0.05:
                top.plot(*tick.truth.pose[:2], "kx", ms=10)
    top.set_aspect("equal")
    axes["speed"].plot(time, speed[:, 0], label="v [m/s]")
    axes["speed"].plot(time, speed[:, 1] / 4, label="w/4 [rad/s]", lw=0.7)
    axes["speed"].legend(loc="lower right")
    phases = [tick.arm[-1].phase for tick in ticks]
    names = sorted(set(phases))
    axes["arm"].plot(time, [names.index(phase) for phase in phases], ".", ms=2)
    axes["arm"].set_yticks(range(len(names)), names)
    for tick in ticks:
        for event in tick.events:
            axes["arm"].annotate(event.text, (event.time, 0), rotation=90, fontsize=6)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=90, bbox_inches="tight")


def main() -> int:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("--variant")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--png", type=Path)
    parser.add_argument("--from", dest="begin", type=float, default=0.0)
    parser.add_argument("--until", type=float, default=0.0)
    parser.add_argument("--stop", type=float, help="stop at this time [s]")
    options = parser.parse_args()
    scene = load_scene(options.scene, options.variant, options.seed)
    if options.stop:
        import msgspec

        scene = msgspec.structs.replace(scene, time_limit=options.stop)
    ticks: list[Tick] = []

    def keep(tick: Tick) -> None:
        ticks.append(tick)
        if options.begin <= tick.time <= options.until:
            print(line(tick))
        for event in tick.events:
            print(f"{event.time:7.2f}  {event.kind}: {event.text}")

    result = run_scene(scene, method=find_method(options.method), on_tick=keep)
    print(json.dumps(result, indent=1))
    if options.png:
        draw(scene, ticks, options.png)
    return 0


if __name__ == "__main__":
    sys.exit(main())
