"""Robot and world as MJCF, and the model that MuJoCo compiles from it.

The robot is a base on two driven wheels and four casters, and the Panda with its hand. Kinematics, limits and shapes
come from `frankie.urdf`. Values that it lacks are here, with their source. The world is floor, furniture, bins, objects
and agents. Furniture has no degrees of freedom: its bodies can be moved without compiling a new model, as long as
their shapes stay the same.
"""

import math
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from typing import NamedTuple

import mujoco
import numpy as np

from motm_twin.model.assets import COLLISION, finger_boxes, web_assets_dir
from motm_twin.model.geometry import Array
from motm_twin.model.profile import Gripper, RobotProfile
from motm_twin.model.scene import Bump, Physics, Scene
from motm_twin.sim.agents import AgentState
from motm_twin.sim.objects import ObjectState
from motm_twin.sim.solids import Solids

WHEEL_RADIUS = 0.10  # [m] of the drive wheels of an Omron LD-60, which are about 200 mm across
TRACK_SHARE = 0.84  # distance between the wheels, as a share of the footprint's width
CASTER_RADIUS = 0.0375  # [m]
CASTER_STIFFNESS, CASTER_DAMPING, CASTER_MASS = 15000.0, 600.0, 3.0  # [N/m], [N s/m], [kg]; choices of this project
CASTER_LOAD = 70.0  # [N] of each sprung caster on a level floor: the wheels carry the other two thirds
WHEEL_MASS = 2.0  # [kg] each, part of the base's mass
WHEEL_TORQUE = 30.0  # [Nm] of each wheel's drive; a choice of this project: 0.5 m/s^2 takes 2.3 Nm
WHEEL_GAIN = 40.0  # [Nm s/rad] of its velocity loop, which also gets feed-forward torque for the commanded acceleration
WHEEL_ARMATURE = 0.2  # [kg m^2] of its motor behind its gears
CLEARANCE = 0.03  # [m] of the base body above the floor
TORQUE_MAX = (87.0, 87.0, 87.0, 87.0, 12.0, 12.0, 12.0)  # [Nm] Franka Control Interface documentation, Panda
# Gains of the joints' loops: choices of this project. As stiff as is stable at 2 ms even without an implicit
# integrator: the contact solver does not know damping that only such an integrator makes stable; contacts would creep.
STIFFNESS = (2000.0, 2000.0, 800.0, 1200.0, 250.0, 250.0, 250.0)  # [Nm/rad]
DAMPING = (200.0, 200.0, 80.0, 120.0, 25.0, 25.0, 25.0)  # [Nm s/rad]
ARMATURE = 0.1  # [kg m^2] of the joints' motors behind their gears: MuJoCo Menagerie, franka_emika_panda
FINGER_ARMATURE = 0.3  # [kg] of each finger's drive; a choice of this project
FINGER_GAIN, FINGER_DAMPING = 4000.0, 30.0  # [N/m], [N s/m] of the gripper's loop, which holds the width
FLOOR, SOLID, CUBE, ROBOT, AGENT, ROLLING = 1, 2, 4, 8, 16, 32  # kinds of geometry, as bits


class Inertial(NamedTuple):
    """Mass [kg], centre [m] and inertia about it (xx, yy, zz, xy, xz, yz) [kg m^2] in the frame of the link."""

    mass: float
    centre: tuple[float, float, float]
    inertia: tuple[float, float, float, float, float, float]


# Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca: Dynamic Identification of the Franka Emika Panda Robot With Retrieval
# of Feasible Parameters Using Penalty-Based Optimization (IEEE RA-L 4(4), 2019), as Franka Robotics publishes it in
# franka_description, robots/fer/inertials.yaml; hand and fingers: end_effectors/franka_hand/inertials.yaml.
_NUMBERS = {  # mass, centre, inertia
    "link0": (0.629769, -0.041018, -0.00014, 0.049974, 0.00315, 0.00388, 0.004285, 8.2904e-7, 0.00015, 8.2299e-6),
    "link1": (4.970684, 0.003875, 0.002081, -0.04762, 0.70337, 0.70661, 0.0091170, -0.000139, 0.006772, 0.019169),
    "link2": (0.646926, -0.003141, -0.02872, 0.003495, 0.007962, 0.02811, 0.025995, -0.003925, 0.010254, 0.000704),
    "link3": (3.228604, 0.027518, 0.039252, -0.066502, 0.037242, 0.036155, 0.01083, -0.004761, -0.011396, -0.012805),
    "link4": (3.587895, -0.05317, 0.104419, 0.027454, 0.025853, 0.019552, 0.028323, 0.007796, -0.001332, 0.008641),
    "link5": (1.225946, -0.011953, 0.041065, -0.038437, 0.035549, 0.029474, 0.008627, -0.002117, -0.004037, 0.000229),
    "link6": (1.666555, 0.060149, -0.014117, -0.010517, 0.001964, 0.004354, 0.005433, 0.000109, -0.001158, 0.000341),
    "link7": (0.735522, 0.010517, -0.004252, 0.061597, 0.012516, 0.010027, 0.004815, -0.000428, -0.001196, -0.000741),
    "hand": (0.73, -0.01, 0.0, 0.03, 0.001, 0.0025, 0.0017, 0.0, 0.0, 0.0),
    "leftfinger": (0.015, 0.0, 0.0, 0.0, 2.375e-6, 2.375e-6, 7.5e-7, 0.0, 0.0, 0.0),
    "rightfinger": (0.015, 0.0, 0.0, 0.0, 2.375e-6, 2.375e-6, 7.5e-7, 0.0, 0.0, 0.0),
}
INERTIALS = {f"panda_{part}": Inertial(row[0], row[1:4], row[4:]) for part, row in _NUMBERS.items()}
ARM_MASS = sum(one.mass for one in INERTIALS.values())  # [kg]
_CHAIN = {f"panda_link{k}": k for k in range(8)} | {"panda_hand": 8, "panda_leftfinger": 9, "panda_rightfinger": 9}


def text(*values: float) -> str:
    """Numbers as the text of an XML attribute."""
    return " ".join(repr(float(value)) for value in values)


def track(profile: RobotProfile) -> float:
    """Distance [m] between the wheels."""
    return TRACK_SHARE * profile.footprint.width


def base_inertia(profile: RobotProfile, physics: Physics) -> tuple[float, float]:
    """Load that the wheels' drives assume, arm folded: mass [kg], and inertia about the vertical [kg m^2]."""
    foot = profile.footprint
    arm = ARM_MASS if profile.has_arm else 0.0
    turning = physics.base_mass * (foot.length**2 + foot.width**2) / 12.0 + arm * (profile.arm.mount_x + 0.1) ** 2
    motors = 2.0 * WHEEL_ARMATURE / WHEEL_RADIUS**2
    return physics.base_mass + arm + motors, turning + motors * (0.5 * track(profile)) ** 2


def add_robot(
    world: ET.Element, root: ET.Element, profile: RobotProfile, physics: Physics, *, sprung: bool = False
) -> dict[str, bytes]:
    """Add the robot to a model; returns the files of its meshes. ``sprung``: casters on springs, for bumps."""
    base = ET.SubElement(world, "body", name="base")
    ET.SubElement(base, "freejoint", name="base")
    _add_body(base, profile, physics)
    _add_wheels(base, root, profile, physics)
    _add_casters(base, profile, sprung=sprung)
    if not profile.has_arm:
        return {}
    files = add_arm_alone(base, root, profile, physics)
    _exclude_neighbours(root)
    return files


def add_arm_alone(base: ET.Element, root: ET.Element, profile: RobotProfile, physics: Physics) -> dict[str, bytes]:
    """Add the arm to a base; returns the files of its meshes."""
    asset = section(root, "asset")
    for link in COLLISION:
        ET.SubElement(asset, "mesh", name=link, file=f"{link}.stl")
    _add_arm(base, root, profile, physics)
    return {f"{link}.stl": (web_assets_dir() / file).read_bytes() for link, file in COLLISION.items()}


def section(root: ET.Element, name: str) -> ET.Element:
    """The section of a model; it is added if missing."""
    found = root.find(name)
    return ET.SubElement(root, name) if found is None else found


def _joints(kind: str = "") -> list[ET.Element]:
    """Joints of the URDF; ``kind``: an XPath condition on them."""
    urdf = ET.parse(web_assets_dir() / "frankie.urdf").getroot()  # noqa: S314 - our own file, not from outside
    return urdf.findall(f"joint{kind}")


def _part(joint: ET.Element, name: str) -> dict[str, str]:
    """Attributes of a child element of a joint."""
    found = joint.find(name)
    assert found is not None
    return found.attrib


def _add_link(parent: ET.Element, joint: ET.Element, **more: str) -> ET.Element:
    """Add the child link of a joint as a body, with its inertia; ``more``: further attributes."""
    link, origin = _part(joint, "child")["link"], _part(joint, "origin")
    body = ET.SubElement(parent, "body", name=link, pos=origin.get("xyz", "0 0 0"), **more)
    if link in INERTIALS:
        mass, centre, inertia = INERTIALS[link]
        ET.SubElement(body, "inertial", mass=text(mass), pos=text(*centre), fullinertia=text(*inertia))
    return body


def _add_body(base: ET.Element, profile: RobotProfile, physics: Physics) -> None:
    """Add the base's body: a box above the floor, with its mass low in it, as batteries are."""
    foot, mass = profile.footprint, physics.base_mass - 2.0 * WHEEL_MASS
    x, y, z = foot.length, foot.width, 0.5 * foot.height
    inertia = tuple(mass / 12.0 * (a * a + b * b) for a, b in ((y, z), (x, z), (x, y)))
    ET.SubElement(
        base, "inertial", mass=text(mass), pos=text(foot.offset_x, 0.0, 0.5 * z), diaginertia=text(*inertia)
    )  # fmt: skip
    half = 0.5 * (foot.height - CLEARANCE)
    ET.SubElement(
        base, "geom", name="base", type="box", size=text(0.5 * foot.length, 0.5 * foot.width, half),
        pos=text(foot.offset_x, 0.0, CLEARANCE + half), contype=str(ROBOT), conaffinity=str(SOLID | CUBE | AGENT),
        friction="0.4 0.005 0.0001",
    )  # fmt: skip


def _add_wheels(base: ET.Element, root: ET.Element, profile: RobotProfile, physics: Physics) -> None:
    """Add two driven wheels, which touch the floor at one point each."""
    r = WHEEL_RADIUS
    actuator = section(root, "actuator")
    for side, name in ((0.5, "left"), (-0.5, "right")):
        wheel = ET.SubElement(base, "body", name=f"{name}_wheel", pos=text(0.0, side * track(profile), r))
        ET.SubElement(wheel, "joint", name=f"{name}_wheel", type="hinge", axis="0 1 0", armature=text(WHEEL_ARMATURE))
        spin, across = 0.5 * WHEEL_MASS * r * r, 0.25 * WHEEL_MASS * r * r
        ET.SubElement(wheel, "inertial", mass=text(WHEEL_MASS), pos="0 0 0", diaginertia=text(across, spin, across))
        ET.SubElement(
            wheel, "geom", name=f"{name}_wheel", type="ellipsoid", size=text(r, 0.02, r), contype=str(ROLLING),
            conaffinity=str(FLOOR), friction=text(physics.wheel_friction, 0.002, 0.0001), priority="3",
            solref="0.006 1", solimp="0.98 0.995 0.001",
        )  # fmt: skip
        ET.SubElement(
            actuator, "velocity", name=f"{name}_wheel", joint=f"{name}_wheel", kv=text(WHEEL_GAIN),
            forcerange=text(-WHEEL_TORQUE, WHEEL_TORQUE),
        )  # fmt: skip


def _add_casters(base: ET.Element, profile: RobotProfile, *, sprung: bool) -> None:
    """Add four frictionless casters; next to a bump, rigid ones would lift the wheels off the floor."""
    foot = profile.footprint
    for i, (along, across) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
        x = foot.offset_x + along * (0.5 * foot.length - 0.06)
        y = across * (0.5 * foot.width - 0.06)
        holder, place = base, text(x, y, CASTER_RADIUS)
        if sprung:
            holder, place = ET.SubElement(base, "body", name=f"caster{i}", pos=place), "0 0 0"
            ET.SubElement(
                holder, "joint", name=f"caster{i}", type="slide", axis="0 0 1", stiffness=text(CASTER_STIFFNESS),
                damping=text(CASTER_DAMPING), springref=text(-CASTER_LOAD / CASTER_STIFFNESS),
            )  # fmt: skip
            inertia = 0.4 * CASTER_MASS * CASTER_RADIUS**2
            ET.SubElement(holder, "inertial", mass=text(CASTER_MASS), pos="0 0 0", diaginertia=text(*(inertia,) * 3))
        ET.SubElement(
            holder, "geom", name=f"caster{i}", type="sphere", size=text(CASTER_RADIUS), pos=place,
            contype=str(ROLLING), conaffinity=str(FLOOR), condim="1", priority="4", solref="0.006 1",
            solimp="0.98 0.995 0.001",
        )  # fmt: skip


def _add_arm(base: ET.Element, root: ET.Element, profile: RobotProfile, physics: Physics) -> None:
    """Add links, joints and drives of the URDF, with the inertias of `INERTIALS`."""
    arm, actuator = profile.arm, section(root, "actuator")
    bodies = {"base_link": base}
    for joint in _joints():
        body = _add_link(bodies[_part(joint, "parent")["link"]], joint, gravcomp="1")
        link, turn = body.attrib["name"], _part(joint, "origin").get("rpy")
        bodies[link] = body
        if joint.attrib["name"] == "arm_mount":
            body.set("pos", text(arm.mount_x, arm.mount_y, arm.mount_z))
        if turn is not None:
            body.set("euler", turn)
        if joint.attrib["type"] == "revolute":
            _add_joint(body, actuator, joint)
        elif joint.attrib["type"] == "prismatic":
            _add_finger(body, joint, physics, profile.gripper)
        if link in COLLISION:
            ET.SubElement(
                body, "geom", name=link, type="mesh", mesh=link, contype=str(ROBOT), friction="0.4 0.005 0.0001",
                conaffinity=str(FLOOR | SOLID | CUBE | ROBOT | AGENT),
            )  # fmt: skip
    _couple_fingers(root, actuator, physics)


def _add_joint(body: ET.Element, actuator: ET.Element, joint: ET.Element) -> None:
    """Add a joint of the arm; its drive tracks position and rate, and compensates gravity, with limited torque."""
    name, limit = joint.attrib["name"], _part(joint, "limit")
    k = int(name[-1]) - 1
    most = TORQUE_MAX[k]
    ET.SubElement(
        body, "joint", name=name, type="hinge", axis="0 0 1", armature=text(ARMATURE), damping="1",
        range=f"{limit['lower']} {limit['upper']}", actuatorfrcrange=text(-most, most),
        actuatorgravcomp="true",
    )  # fmt: skip
    ET.SubElement(
        actuator, "general", name=name, joint=name, biastype="affine", gainprm=text(STIFFNESS[k]),
        biasprm=text(0.0, -STIFFNESS[k], -DAMPING[k]),
    )  # fmt: skip


def add_fingers(hand: ET.Element, root: ET.Element, physics: Physics, gripper: Gripper) -> None:
    """Add the fingers to a hand without an arm."""
    for joint in _joints("[@type='prismatic']"):
        _add_finger(_add_link(hand, joint), joint, physics, gripper)
    _couple_fingers(root, section(root, "actuator"), physics)


def _add_finger(body: ET.Element, joint: ET.Element, physics: Physics, gripper: Gripper) -> None:
    """Add a finger that slides half the width of the open gripper; its pad is the lower of its two boxes."""
    axis, link = _part(joint, "axis")["xyz"], body.attrib["name"]
    ET.SubElement(
        body, "joint", name=link, type="slide", axis=axis, armature=text(FINGER_ARMATURE), damping="5",
        range=text(0.0, 0.5 * gripper.max_width),
    )  # fmt: skip
    for i, (centre, size) in enumerate(finger_boxes(link)):
        ET.SubElement(
            body, "geom", name=f"{link}{i}", type="box", size=text(*(0.5 * np.array(size))), pos=text(*centre),
            contype=str(ROBOT), conaffinity=str(FLOOR | SOLID | CUBE | ROBOT | AGENT), priority="2", condim="4",
            friction=text(physics.pad_friction, 0.005, 0.0001), solref="0.004 1", solimp="0.97 0.99 0.0005",
        )  # fmt: skip


def _couple_fingers(root: ET.Element, actuator: ET.Element, physics: Physics) -> None:
    """Couple both fingers to their one drive, whose command is the width between the pads [m]."""
    fixed = ET.SubElement(section(root, "tendon"), "fixed", name="width")
    for link in ("panda_leftfinger", "panda_rightfinger"):
        ET.SubElement(fixed, "joint", joint=link, coef="1")
    ET.SubElement(
        section(root, "equality"), "joint", joint1="panda_leftfinger", joint2="panda_rightfinger",
        solref="0.004 1", solimp="0.98 0.995 0.0005",
    )  # fmt: skip
    ET.SubElement(
        actuator, "general", name="width", tendon="width", biastype="affine", gainprm=text(FINGER_GAIN),
        biasprm=text(0.0, -FINGER_GAIN, -FINGER_DAMPING),
        forcerange=text(-physics.grip_force, physics.grip_force),
    )  # fmt: skip


def _exclude_neighbours(root: ET.Element) -> None:
    """Exclude collisions of neighbouring links, of the base and the first two links, and within the hand and link 7."""
    contact = section(root, "contact")
    for one, rank in _CHAIN.items():
        if rank <= 1:
            ET.SubElement(contact, "exclude", body1="base", body2=one)
        for other, later in _CHAIN.items():
            near = later - rank == 1 or (rank >= 7 and later > rank) or (rank == later == 9 and one < other)
            if near and one != other:
                ET.SubElement(contact, "exclude", body1=one, body2=other)


TIMESTEP = 0.002  # [s]
SETTLED = 6  # decimals [m] of the shape of a solid: rounding makes it independent of its pose
AGENT_DENSITY = {"temi": 60.0, "person": 220.0}  # [kg/m^3] of their cylinders: 12 kg (Temi's data sheet) and 75 kg
AGENT_FORCE = {"temi": 60.0, "person": 200.0}  # [N] limit of their drives; choices of this project
AGENT_GAIN = 2000.0  # [N s/m] of their velocity loops
_MOST_ITERATIONS = 50

Shape = tuple[str, tuple[float, ...], float]  # kind, its numbers [m], height [m]


class Standing(NamedTuple):
    """Shape of a solid, and position and yaw of its centre."""

    shape: Shape
    place: tuple[float, float, float]  # [m]
    yaw: float


class Kind(NamedTuple):
    """Contents of a model; when they change, it is compiled anew."""

    shapes: tuple[Shape, ...]
    objects: tuple[tuple[str, float], ...]  # name, side [m]
    agents: tuple[tuple[str, str, float, float], ...]  # name, kind, radius, height [m]


def standing_bodies(solids: Solids) -> list[Standing]:
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
    """The kind of model that these bodies need."""
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
    """Add a ridge: the top of a lying cylinder that is sunk into the floor."""
    radius = (0.25 * bump.width**2 + bump.height**2) / (2.0 * bump.height)
    ET.SubElement(
        world, "geom", name=f"bump:{bump.name}", type="cylinder", size=text(radius, 0.5 * bump.length),
        pos=text(*bump.centre, bump.height - radius), contype=str(FLOOR), conaffinity="0",
        euler=text(0.5 * math.pi, 0.0, bump.yaw - 0.5 * math.pi),
    )  # fmt: skip


def add_options(root: ET.Element) -> None:
    """Set the solver's options: small steps, elliptic friction cones, and a few no-slip iterations against creeping."""
    ET.SubElement(root, "compiler", angle="radian", autolimits="true", eulerseq="XYZ")
    option = ET.SubElement(
        root, "option", timestep=text(TIMESTEP), integrator="implicitfast", cone="elliptic", impratio="10",
        solver="Newton", iterations=str(_MOST_ITERATIONS), tolerance="1e-8", noslip_iterations="3",
    )  # fmt: skip
    ET.SubElement(option, "flag", sensor="disable")


def add_object(world: ET.Element, name: str, side: float, physics: Physics) -> None:
    """Add a cube of side ``side`` [m] that moves freely."""
    mass = physics.object_mass or physics.object_density * side**3
    body = ET.SubElement(world, "body", name=f"object:{name}")
    ET.SubElement(body, "freejoint", name=f"object:{name}")
    ET.SubElement(
        body, "geom", name=f"object:{name}", type="box", size=text(*(0.5 * side,) * 3), mass=text(mass), condim="4",
        contype=str(CUBE), conaffinity=str(FLOOR | SOLID | CUBE | ROBOT | AGENT), priority="1",
        friction=text(physics.object_friction, 0.005, 0.0001), solref="0.005 1", solimp="0.95 0.99 0.0005",
    )  # fmt: skip


def _add_agent(world: ET.Element, root: ET.Element, name: str, size: tuple[str, float, float]) -> None:
    """Add an agent that drives in the plane; its drives are limited to `AGENT_FORCE`."""
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
