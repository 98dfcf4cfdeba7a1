"""The world as MJCF: floor, furniture, bins, objects and agents, and the model that is compiled from it all.

Furniture has no degrees of freedom: its bodies can be put elsewhere without compiling anew, as long as their shapes
stay the same.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.scene import Bump, Physics, Scene
from motm_twin.physics.robot_model import AGENT, CUBE, FLOOR, ROBOT, SOLID, add_robot, section, text
from motm_twin.sim.agents import AgentState
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.solids import Solids

TIMESTEP = 0.002  # [s]
SETTLED = 6  # digits [m] of the shape of a solid: where it stands does not change them
AGENT_DENSITY = {"temi": 60.0, "person": 220.0}  # [kg/m^3] of their cylinders: 12 kg (Temi's data sheet) and 75 kg
AGENT_FORCE = {"temi": 60.0, "person": 200.0}  # [N] with which they can be held up; choices of this project
AGENT_GAIN = 2000.0  # [N s/m] of their velocity loops
_MOST_ITERATIONS = 50

Shape = tuple[str, tuple[float, ...], float]  # kind, its numbers [m], height [m]


class Standing(NamedTuple):
    """A solid: its shape, and where its middle is."""

    shape: Shape
    place: tuple[float, float, float]  # [m]
    yaw: float


class Kind(NamedTuple):
    """Purpose of a model: all that can not be changed in it."""

    shapes: tuple[Shape, ...]
    objects: tuple[tuple[str, float], ...]  # name, side [m]
    agents: tuple[tuple[str, str, float, float], ...]  # name, kind, radius, height [m]


def standing(solids: Solids) -> list[Standing]:
    """All solids, polygons before discs."""
    found = []
    for i in range(len(solids.names)):
        low, high = solids.z[i].tolist()
        found.append(_polygon(solids.polygon(i), low, high))
    for (x, y, radius), (low, high) in zip(solids.discs.tolist(), solids.disc_z.tolist(), strict=True):
        shape = ("cylinder", (round(radius, SETTLED),), round(high - low, SETTLED))
        found.append(Standing(shape, (x, y, 0.5 * (low + high)), 0.0))
    return found


def _polygon(corners: Array, low: float, high: float) -> Standing:
    """A convex polygon in a frame along its first edge: a box when it is a rectangle."""
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0)) if len(corners) != 4 else corners.mean(axis=0)
    along = corners[1] - corners[0]
    yaw = math.atan2(along[1], along[0])
    c, s = math.cos(yaw), math.sin(yaw)
    local = (corners - middle) @ np.array([[c, -s], [s, c]])
    numbers = tuple(round(value, SETTLED) for value in local.ravel().tolist())
    height = round(high - low, SETTLED)
    place = (float(middle[0]), float(middle[1]), 0.5 * (low + high))
    if len(corners) == 4:
        half = np.abs(local).mean(axis=0)
        if np.abs(np.abs(local) - half).max() < 10.0**-SETTLED:
            return Standing(("box", tuple(round(2.0 * value, SETTLED) for value in half.tolist()), height), place, yaw)
    return Standing(("prism", numbers, height), place, yaw)


def kind_of(solids: Sequence[Standing], objects: Sequence[ObjectState], agents: Sequence[AgentState]) -> Kind:
    """The kind of model that these need."""
    return Kind(
        tuple(one.shape for one in solids),
        tuple((item.name, item.side) for item in objects),
        tuple((one.agent.name, one.agent.kind, one.agent.radius, one.agent.height) for one in agents),
    )


def compile_model(scene: Scene, physics: Physics, kind: Kind) -> mujoco.MjModel:
    """The model of a scene; bodies of its solids are named by their number, s0, s1, ..."""
    root = ET.Element("mujoco", model=scene.name)
    add_options(root)
    ET.SubElement(root, "asset")
    world = ET.SubElement(root, "worldbody")
    ET.SubElement(world, "geom", name="floor", type="plane", size="0 0 1", contype=str(FLOOR), conaffinity="0")
    for bump in scene.bumps:
        _add_bump(world, bump)
    files = add_robot(world, root, scene.robot, physics, sprung=bool(scene.bumps))
    for name, side in kind.objects:
        add_object(world, name, side, physics)
    for name, of, radius, height in kind.agents:
        _add_agent(world, root, name, (of, radius, height))
    for i, shape in enumerate(kind.shapes):
        _add_solid(world, root, f"s{i}", shape, physics)
    return mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"), files)


def _add_bump(world: ET.Element, bump: Bump) -> None:
    """A ridge: the top of a lying cylinder that is sunk into the floor."""
    radius = (0.25 * bump.width**2 + bump.height**2) / (2.0 * bump.height)
    ET.SubElement(
        world, "geom", name=f"bump:{bump.name}", type="cylinder", size=text(radius, 0.5 * bump.length),
        pos=text(*bump.centre, bump.height - radius), contype=str(FLOOR), conaffinity="0",
        euler=text(0.5 * math.pi, 0.0, bump.yaw - 0.5 * math.pi),
    )  # fmt: skip


def add_options(root: ET.Element) -> None:
    """Options of the solver: small steps, true friction cones, and few iterations against creeping."""
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", eulerseq="XYZ")
    option = ET.SubElement(
        root, "option", timestep=text(TIMESTEP), integrator="implicitfast", cone="elliptic", impratio="10",
        solver="Newton", iterations=str(_MOST_ITERATIONS), tolerance="1e-8", noslip_iterations="3",
    )  # fmt: skip
    ET.SubElement(option, "flag", sensor="disable")


def add_object(world: ET.Element, name: str, side: float, physics: Physics) -> None:
    """A cube that moves freely."""
    mass = physics.object_mass or physics.object_density * side**3
    body = ET.SubElement(world, "body", name=f"object:{name}")
    ET.SubElement(body, "freejoint", name=f"object:{name}")
    ET.SubElement(
        body, "geom", name=f"object:{name}", type="box", size=text(*(0.5 * side,) * 3), mass=text(mass), condim="4",
        contype=str(CUBE), conaffinity=str(FLOOR | SOLID | CUBE | ROBOT | AGENT), priority="1",
        friction=text(physics.object_friction, 0.005, 0.0001), solref="0.005 1", solimp="0.95 0.99 0.0005",
    )  # fmt: skip


def _add_agent(world: ET.Element, root: ET.Element, name: str, size: tuple[str, float, float]) -> None:
    """An agent that drives in the plane; its drives give way to more than their force."""
    kind, radius, height = size
    body = ET.SubElement(world, "body", name=f"agent:{name}", pos=text(0.0, 0.0, 0.5 * height))
    actuator = section(root, "actuator")
    most, mass = AGENT_FORCE[kind], AGENT_DENSITY[kind] * math.pi * radius * radius * height
    for axis, way in (("x", "1 0 0"), ("y", "0 1 0"), ("yaw", "0 0 1")):
        joint, turns = f"agent:{name}:{axis}", axis == "yaw"
        ET.SubElement(body, "joint", name=joint, type="hinge" if turns else "slide", axis=way)
        gain, limit = (AGENT_GAIN * radius**2, most * radius) if turns else (AGENT_GAIN, most)
        ET.SubElement(actuator, "velocity", name=joint, joint=joint, kv=text(gain), forcerange=text(-limit, limit))
    ET.SubElement(
        body, "geom", name=f"agent:{name}", type="cylinder", size=text(radius, 0.5 * height), mass=text(mass),
        contype=str(AGENT), conaffinity=str(SOLID | CUBE | ROBOT | AGENT), friction="0.3 0.005 0.0001",
    )  # fmt: skip


def _add_solid(world: ET.Element, root: ET.Element, name: str, shape: Shape, physics: Physics) -> None:
    kind, numbers, height = shape
    body = ET.SubElement(world, "body", name=name)
    geom = ET.SubElement(
        body, "geom", name=name, contype=str(SOLID), conaffinity="0",
        friction=text(physics.object_friction, 0.005, 0.0001),
    )  # fmt: skip
    half = 0.5 * height
    if kind == "box":
        geom.attrib |= {"type": "box", "size": text(0.5 * numbers[0], 0.5 * numbers[1], half)}
    elif kind == "cylinder":
        geom.attrib |= {"type": "cylinder", "size": text(numbers[0], half)}
    else:
        corners = np.array(numbers).reshape(-1, 2)
        points = [(*corner, z) for z in (-half, half) for corner in corners.tolist()]
        mesh = " ".join(text(*point) for point in points)
        ET.SubElement(section(root, "asset"), "mesh", name=name, vertex=mesh)
        geom.attrib |= {"type": "mesh", "mesh": name}
