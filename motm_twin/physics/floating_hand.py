"""Grasps of a cube by a moving hand without an arm: contact dynamics compared with the rules of the kinematic plant.

`sweep` tries many such grasps; `write` saves their counts and their figure.
"""

import json
import math
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import msgspec
import mujoco
import numpy as np
from joblib import Parallel, delayed

from motm_twin.model.arm_kernels import ARM_FRAMES, HAND, HAND_LENGTH, TCP
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Gripper as GripperSpec
from motm_twin.model.scene import Physics
from motm_twin.physics.forces import FELT, Grasp
from motm_twin.physics.gripping import STANDS, Fingers
from motm_twin.physics.mjcf import FLOOR, SOLID, TIMESTEP, add_fingers, add_object, add_options, text
from motm_twin.sim.grasp import STRICT, SWEPT
from motm_twin.sim.gripper import Gripper, GripperState
from motm_twin.sim.objects import ObjectState, ObjectWorld
from motm_twin.sim.solids import NOTHING

SIDE = 0.04  # [m] of the cube
LIFT, LIFT_SPEED = 0.10, 0.25  # [m], [m/s] of the lift after closing
STOPS = 0.05  # [s] in which the hand comes to rest before it lifts
HAND_MASS = 3.0  # [kg] of the hand and what moves with it
_GAIN = 5000.0  # [N s/m] of the velocity drives that move the hand
_DT = 0.01  # [s] between two commands
_STARTS = 0.05  # [s] in which the fingers begin to move: until then slow ones do not count as standing
_DOWN = np.diag([1.0, -1.0, -1.0])  # the hand looks down, and closes along y


class Cell(msgspec.Struct, frozen=True, kw_only=True):
    """One grasp: motion of the hand past the cube, and properties of both."""

    closing_time: float = 0.8  # [s]
    along: float = 0.0  # [m/s] of the hand over the cube along the pads
    across: float = 0.0  # [m/s] the same across the pads
    offset: float = 0.0  # [m] of the cube across the pads, when the fingers begin to close
    ahead: float = 0.0  # [m] the same along the pads
    height: float = 0.0  # [m] of the tool centre point over the cube's centre
    yaw: float = 0.0  # [rad] of the cube
    friction: float = 0.8  # of the pads
    force: float = 40.0  # [N]
    mass: float = 0.045  # [kg]


def physics_holds(cell: Cell) -> bool:
    """True when the hand lifts the cube, by contact dynamics."""
    physics = Physics(pad_friction=cell.friction, grip_force=cell.force, object_mass=cell.mass)
    model = _model(physics)
    data = mujoco.MjData(model)
    _place(model, data, cell)
    spec = GripperSpec(closing_time=cell.closing_time)
    fingers = Fingers(spec, physics, [SIDE], _DT)
    state, grasp = GripperState(width=spec.max_width, phase="closing"), Grasp(width=spec.max_width)
    now = 0.0
    steps, until = round(_DT / TIMESTEP), cell.closing_time + STOPS + LIFT / LIFT_SPEED
    while now < until:
        lifting = now >= cell.closing_time + STOPS
        moves = 1.0 if now < cell.closing_time else 0.0
        data.ctrl[:3] = (moves * cell.along, moves * cell.across, LIFT_SPEED * lifting)
        here = float(data.qpos[3:5].sum())
        grasp.still = grasp.still + 1 if abs(here - state.width) < STANDS and now > _STARTS else 0
        state.width = here
        fingers.reference(state, grasp, stuck=False)
        data.ctrl[3] = grasp.width
        mujoco.mj_step(model, data, steps)
        now += _DT
    return float(data.qpos[7]) > 0.5 * SIDE + 0.5 * LIFT and _pressed(model, data)


def rule_holds(cell: Cell, rule: str = STRICT) -> bool:
    """True when the hand holds the cube, by a grasp rule of the kinematic plant."""
    gripper = Gripper(GripperSpec(closing_time=cell.closing_time), ObjectWorld(_DT), _DT, rule)
    state = gripper.start()
    item = ObjectState(name="cube", position=np.array([0.0, 0.0, 0.5 * SIDE]), yaw=0.0, side=SIDE)
    item.turn_to(cell.yaw)
    velocity = np.array([cell.along, cell.across, 0.0])
    tcp = np.array([-cell.ahead, -cell.offset, 0.5 * SIDE + cell.height])
    gripper.command(state, "close", 0.0, tcp, _DOWN, [item])
    frames = np.zeros((len(ARM_FRAMES), 4, 4))
    frames[:, :3, :3] = _DOWN
    for k in range(1, round((cell.closing_time + STOPS) / _DT) + 1):
        moving = velocity if k * _DT <= cell.closing_time + 1e-9 else np.zeros(3)
        tcp = tcp + moving * _DT
        frames[TCP, :3, 3], frames[HAND, :3, 3] = tcp, tcp + np.array([0.0, 0.0, HAND_LENGTH])
        gripper.step(state, k * _DT, frames, moving, [item], NOTHING)
    return state.held == "cube" and state.outcome == "held"


def _model(physics: Physics) -> mujoco.MjModel:
    root = ET.Element("mujoco", model="floating hand")
    add_options(root)
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(
        world, "geom", name="table", type="plane", size="0 0 1", contype=str(FLOOR | SOLID), conaffinity="0",
        friction=text(physics.object_friction, 0.005, 0.0001),
    )  # fmt: skip
    hand = ET.SubElement(world, "body", name="hand", pos=text(0.0, 0.0, 0.5 * SIDE + HAND_LENGTH), gravcomp="1")
    actuator = ET.SubElement(root, "actuator")
    for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1")):
        ET.SubElement(hand, "joint", name=name, type="slide", axis=axis, armature=text(10.0))
        ET.SubElement(actuator, "velocity", name=name, joint=name, kv=text(_GAIN))
    ET.SubElement(hand, "inertial", mass=text(HAND_MASS), pos="0 0 0", diaginertia="0.01 0.01 0.01")
    carrier = ET.SubElement(hand, "body", name="carrier", euler=text(math.pi, 0.0, 0.0), gravcomp="1")
    add_fingers(carrier, root, physics, GripperSpec())
    add_object(world, "cube", SIDE, physics)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"))


def _place(model: mujoco.MjModel, data: mujoco.MjData, cell: Cell) -> None:
    """Set the start: fingers open, the cube on the table, the hand at the cell's offset and speed."""
    data.qpos[:3] = (-cell.ahead, -cell.offset, cell.height)
    data.qvel[:3] = (cell.along, cell.across, 0.0)
    data.qpos[3:5] = 0.5 * GripperSpec().max_width
    data.qpos[5:12] = (0.0, 0.0, 0.5 * SIDE, math.cos(0.5 * cell.yaw), 0.0, 0.0, math.sin(0.5 * cell.yaw))
    mujoco.mj_forward(model, data)


def _pressed(model: mujoco.MjModel, data: mujoco.MjData) -> bool:
    """True when both pads press the cube."""
    cube, felt = model.geom("object:cube").id, set[str]()
    pairs: Array = data.contact.geom
    for row in range(data.ncon):
        a, b = (int(one) for one in pairs[row])
        address = int(data.contact.efc_address[row])
        if cube in (a, b) and address >= 0 and data.efc_force[address] > FELT:
            felt.add(model.geom(b if a == cube else a).name.rstrip("01"))
    return {"panda_leftfinger", "panda_rightfinger"} <= felt


CLOSING = (0.2, 0.4, 0.6, 0.8)  # [s]
ALONG = (0.0, 0.01, 0.02, 0.03, 0.04, 0.05, 0.075, 0.1, 0.15, 0.2)  # [m/s]
ACROSS = (0.0, 0.03, 0.1, 0.2)  # [m/s]
NOMINAL = Cell()
RANDOM, SEED = 4000, 11  # number and seed of further cells, drawn from about the range of the grid
SLOW = 0.05  # [m/s] along and across: Experiment 1 has at most 0.046


class Outcome(NamedTuple):
    """One cell, and which models hold its cube."""

    cell: Cell
    physics: bool
    strict: bool
    swept: bool


def cells(*, quick: bool = False) -> list[Cell]:
    """All combinations of motion, offset, friction and force; then one parameter at a time; then random cells."""
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
    """Cells with random motion, offset, yaw, height, friction and force."""
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
    """Outcome of a cell by contact dynamics and by both rules."""
    return Outcome(cell, physics_holds(cell), rule_holds(cell, STRICT), rule_holds(cell, SWEPT))


def sweep(workers: int, *, quick: bool = False) -> list[Outcome]:
    """All cells, in order."""
    return list(Parallel(n_jobs=workers)(delayed(outcome)(cell) for cell in cells(quick=quick)))


def counts(outcomes: Sequence[Outcome]) -> dict[str, int]:
    """Numbers of cells that physics holds, and on which each rule disagrees with it."""
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
    """Write counts and cells as ``grasp_rule.json``, with the figure beside it; returns the file."""
    out.mkdir(parents=True, exist_ok=True)
    rows = [{**msgspec.to_builtins(one.cell), **one._asdict(), "cell": None} for one in outcomes]
    target = out / "grasp_rule.json"
    target.write_text(json.dumps({"counts": counts(outcomes), "cells": rows}), encoding="utf-8")
    draw(outcomes, out / "grasp_rule.png")
    return target


def draw(outcomes: Sequence[Outcome], file: Path) -> None:
    """Draw speed along the pads over closing time, for each speed across them, of the nominal hand."""
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
