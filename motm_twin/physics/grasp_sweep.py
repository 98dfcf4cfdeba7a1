"""Sweep of a floating hand: grasps by contact dynamics and by the grasp rules, their counts and their figure."""

import json
import math
from collections import Counter
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from joblib import Parallel, delayed

from motm_twin.physics.floating_hand import Cell, physics_holds, rule_holds
from motm_twin.sim.grasp import STRICT, SWEPT

CLOSING = (0.2, 0.4, 0.6, 0.8)  # [s]
ALONG = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.075, 0.1, 0.15, 0.2)  # [m/s]
ACROSS = (0.0, 0.03, 0.1, 0.2)  # [m/s]
NOMINAL = Cell()
RANDOM, SEED = 4000, 11  # further cells, anywhere between those of the grid
SLOW = 0.05  # [m/s] along and across: Experiment 1 has at most 0.046


class Outcome(NamedTuple):
    """One cell, and who holds it."""

    cell: Cell
    physics: bool
    strict: bool
    swept: bool


def cells(*, quick: bool = False) -> list[Cell]:
    """All combinations of motion, place, friction and force; then one thing at a time."""
    places = ((0.0, 0.0),) if quick else tuple(product((-0.015, 0.0, 0.015), (0.0, 0.015)))
    grips = ((0.8, 40.0),) if quick else tuple(product((0.3, 0.8), (10.0, 40.0)))
    found = [
        Cell(closing_time=time, along=v, across=w, ahead=ahead, offset=offset, friction=friction, force=force)
        for time, v, w, (ahead, offset), (friction, force) in product(CLOSING, ALONG, ACROSS, places, grips)
    ]
    found += [Cell(yaw=math.radians(angle)) for angle in range(0, 46, 5)]
    found += [Cell(height=0.001 * height) for height in range(-6, 31, 2)]
    found += [Cell(mass=mass, friction=mu, force=force) for mass in (0.05, 0.15, 0.5) for mu, force in grips]
    found += [Cell(ahead=0.001 * way) for way in range(0, 36, 2)]
    found += [Cell(offset=0.001 * way) for way in range(0, 36, 2)]
    return found if quick else found + random_cells(RANDOM)


def random_cells(count: int, seed: int = SEED) -> list[Cell]:
    """Cells with everything at random, turned cubes included."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        along, across, ahead, offset = rng.uniform((0.0, 0.0, -0.015, -0.015), (0.12, 0.2, 0.015, 0.015)).tolist()
        time, yaw, height = rng.uniform((0.2, -0.3, -0.004), (0.8, 0.3, 0.012)).tolist()
        friction, force = float(rng.choice((0.3, 0.8))), float(rng.choice((10.0, 40.0)))
        place = {"ahead": ahead, "offset": offset, "yaw": yaw, "height": height}
        moves = {"closing_time": round(time, 2), "along": along, "across": across}
        found.append(Cell(friction=friction, force=force, **place, **moves))
    return found


def outcome(cell: Cell) -> Outcome:
    """Outcome of a cell by physics and by both rules."""
    return Outcome(cell, physics_holds(cell), rule_holds(cell, STRICT), rule_holds(cell, SWEPT))


def sweep(workers: int, *, quick: bool = False) -> list[Outcome]:
    """All cells, in order."""
    return list(Parallel(n_jobs=workers)(delayed(outcome)(cell) for cell in cells(quick=quick)))


def counts(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """Cells that physics and each rule hold and lose."""
    slow = [one for one in outcomes if max(abs(one.cell.along), abs(one.cell.across)) <= SLOW]
    found: Counter[str] = Counter()
    for name, these in (("", outcomes), ("slow: ", slow)):
        found[f"{name}cells"], found[f"{name}physics"] = len(these), sum(one.physics for one in these)
        for rule in (STRICT, SWEPT):
            held = [(one.physics, getattr(one, rule)) for one in these]
            found[f"{name}{rule} holds what physics loses"] = held.count((False, True))
            found[f"{name}{rule} loses what physics holds"] = held.count((True, False))
    return dict(found)


def write(outcomes: Sequence[Outcome], out: Path) -> Path:
    """Counts and cells as ``grasp_rule.json``, the figure beside it."""
    out.mkdir(parents=True, exist_ok=True)
    rows = [{**msgspec.to_builtins(one.cell), **one._asdict(), "cell": None} for one in outcomes]
    target = out / "grasp_rule.json"
    target.write_text(json.dumps({"counts": counts(outcomes), "cells": rows}), encoding="utf-8")
    draw(outcomes, out / "grasp_rule.png")
    return target


def draw(outcomes: Sequence[Outcome], file: Path) -> None:
    """Speed along the pads against closing time, for each speed across them, of the nominal hand."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 3.2), layout="constrained")
    for axes, across in zip(figure.subplots(1, len(ACROSS), sharey=True), ACROSS, strict=True):
        for one in outcomes:
            cell = one.cell
            if msgspec.structs.replace(cell, closing_time=0.8, along=0.0, across=0.0) != NOMINAL:
                continue
            if cell.across == across:
                colour = "tab:green" if one.strict else "tab:olive" if one.swept else "tab:orange"
                colour = colour if one.physics else "0.8" if not one.swept else "tab:red"
                axes.plot(cell.closing_time, 1e3 * cell.along, "s", color=colour, markersize=9)
        axes.set_title(f"across the pads {1e3 * across:.0f} mm/s", fontsize=9)
        axes.set_xlabel("closing time [s]")
    figure.axes[0].set_ylabel("along the pads [mm/s]")
    held = (("both rules", "tab:green"), ("swept", "tab:olive"), ("physics only", "tab:orange"))
    for label, colour in (*((f"held by {by}", colour) for by, colour in held), ("lost", "0.8")):
        figure.axes[-1].plot([], [], "s", color=colour, label=label)
    figure.legend(loc="outside lower center", ncols=4, fontsize=8, frameon=False)
    figure.savefig(file, dpi=110)
