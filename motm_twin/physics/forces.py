"""Contact forces from MuJoCo, external torques as the arm would estimate them, and the state of the contact dynamics.

Forces: of the pads on an object, and of the robot on everything else.

Torques: the arm's own controller assumes a base at rest: tau_ext = tau - (M(q) ddq + c(q, dq) + g(q)). So it contains
the effects of base accelerations and floor bumps, not of contacts alone. Beyond a threshold the Panda stops by a
reflex; a moving base alone can trip it: a phantom collision.
"""

import xml.etree.ElementTree as ET
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field

import mujoco
import numpy as np

from motm_twin.model.geometry import Array
from motm_twin.model.plant import Contact, ContactForce, GraspTruth
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import REFLEXES, Physics
from motm_twin.physics.mjcf import Kind, add_arm_alone
from motm_twin.sim.plant_state import ArmState, BaseState, PlantState


@dataclass
class Press:
    """An ongoing contact of the robot with another body."""

    began: float  # [s]
    last: float
    bodies: tuple[str, ...]  # of the robot, in order of contact
    force: float  # [N] largest
    impulse: float  # [Ns]


@dataclass
class Grasp:
    """State of the fingers and of the object between them."""

    width: float  # [m] commanded to the drive
    waits: int = 0  # substeps until the fingers begin to move
    still: int = 0  # substeps for which the fingers have not moved
    pressed: str = ""  # object that both pads press
    loose: int = 0  # substeps for which a held object was not pressed by both pads
    forces: tuple[float, float] = (0.0, 0.0)  # [N] of left and right pad on it
    began: float = 0.0  # [s] of the command to close
    speed: float = 0.0  # [m/s] largest of the tool centre point since then
    places: dict[str, Array] = field(default_factory=dict)  # [m] of the objects then
    taken: tuple[Array, Array] | None = None  # pose of the held object in the hand when it was grasped
    done: list[GraspTruth] = field(default_factory=list)  # all grasps, the newest last


@dataclass
class PhysicsState:
    """State of the contact dynamics, in addition to that of the kinematic plant."""

    integration: Array  # of MuJoCo: mjSTATE_INTEGRATION
    base: BaseState  # reference of the base's drives: its speeds
    arm: ArmState  # reference of the arm's drives
    grasp: Grasp
    quiet: dict[str, int] = field(default_factory=dict)  # substeps for which a falling object has been at rest
    presses: dict[str, Press] = field(default_factory=dict)  # ongoing contacts of the robot, by the other body
    torque: Array = field(default_factory=lambda: np.zeros(7))  # [Nm] external, as the arm estimates it
    torque_peaks: Array = field(default_factory=lambda: np.zeros(7))  # [Nm] largest magnitude so far
    reflexes: dict[str, str] = field(default_factory=dict)  # threshold: time and joint that first passed it, as text
    trips: dict[str, int] = field(default_factory=dict)  # threshold: number of times it was passed without a contact
    over: dict[str, int] = field(default_factory=dict)  # threshold: last substep in which it was passed
    wrist: tuple[float, float] = (0.0, 0.0)  # [N], [Nm] at the hand's mount, weight included
    wrist_peaks: tuple[float, float] = (0.0, 0.0)  # largest so far
    edited: int = -1000  # substep of the user's newest edit
    felt: list[ContactForce] = field(default_factory=list)  # contacts that have ended


FELT = 0.5  # [N] smaller contact forces are ignored
ENDED = 0.1  # [s] without force after which a contact has ended, as for the referee
_NONE = -2  # index of no object
_OF_ROBOT = ("base", "panda_", "held:")
_FLOOR, _SOLID, _CUBE, _BODY, _LEFT, _RIGHT, _ROLLS, _AGENT = range(8)
_CLASSES = {  # prefixes of a geometry's name, the first match counts; solids are s0, s1, ...
    _FLOOR: ("floor", "bump:"),
    _CUBE: ("object:",),
    _AGENT: ("agent:",),
    _LEFT: ("panda_leftfinger",),
    _RIGHT: ("panda_rightfinger",),
    _ROLLS: ("left_wheel", "right_wheel", "caster"),
    _BODY: ("base", "panda_"),
}


class Contacts:
    """Reads the contact forces of one model, substep by substep."""

    def __init__(self, model: mujoco.MjModel, kind: Kind) -> None:
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._names = [_own_name(name) for name in names]
        self._objects = [name for name, _ in kind.objects]
        self._class = np.array([_class_of(name) for name in names])
        self._solid = np.array([int(name[1:]) if _class_of(name) == _SOLID else -1 for name in names])
        self._object = np.full(model.ngeom, -1)
        for i, name in enumerate(names):
            if name.startswith("object:"):
                self._object[i] = self._objects.index(name.removeprefix("object:"))
        self.begin("")

    def begin(self, lifted: str) -> None:
        """Begin a substep; ``lifted``: the object held in the air, or ""."""
        self._lifted = self._objects.index(lifted) if lifted else _NONE
        self.deepest, self.deepest_pair = 0.0, ""
        self._peaks: dict[tuple[int, int], list[float]] = {}
        self._pads = np.zeros((len(self._objects), 2))
        self._looks = 0

    def look(self, data: mujoco.MjData, dt: float) -> None:
        """Add the contacts after a solver step of dt [s]."""
        self._looks += 1
        pairs = data.contact.geom
        if not len(pairs):
            return
        kinds = self._class[pairs]
        depth = -data.contact.dist
        worst = int(np.argmax(depth))
        if depth[worst] > self.deepest:
            self.deepest = float(depth[worst])
            self.deepest_pair = " and ".join(self._names[int(g)] for g in pairs[worst])
        held = self._object[pairs] == self._lifted
        own = (kinds == _BODY) | (kinds == _LEFT) | (kinds == _RIGHT) | held
        robot = own[:, 0], own[:, 1]
        rows = np.flatnonzero(robot[0] | robot[1])
        if not len(rows):
            return
        addresses = data.contact.efc_address[rows]
        forces = np.where(addresses >= 0, data.efc_force[np.maximum(addresses, 0)], 0.0)
        for row, force in zip(rows.tolist(), forces.tolist(), strict=True):
            a, b = (int(g) for g in pairs[row])
            if not robot[0][row]:
                a, b = b, a
            side = int(self._class[a])
            item = int(self._object[b])
            if item >= 0 and side in (_LEFT, _RIGHT):
                self._pads[item, side - _LEFT] += force
            elif side == _CUBE and int(self._class[b]) in (_LEFT, _RIGHT):
                self._pads[int(self._object[a]), int(self._class[b]) - _LEFT] += force
                continue
            if force > FELT:
                peak = self._peaks.setdefault((a, b), [0.0, 0.0])
                peak[0] = max(peak[0], force)
                peak[1] += force * dt

    @property
    def pinched(self) -> tuple[str, tuple[float, float]]:
        """The object that both pads press, and their mean forces [N] over the substep; "" for none."""
        if not self._looks or not len(self._pads):
            return "", (0.0, 0.0)
        mean = self._pads / self._looks
        best = int(np.argmax(mean.min(axis=1)))
        left, right = mean[best].tolist()
        return (self._objects[best], (left, right)) if min(left, right) > FELT else ("", (left, right))

    def tell(self, s: PlantState, dt: float, between: set[str]) -> None:
        """Add the substep's forces to the contacts so far, without those of fingers on objects ``between`` them."""
        p, now = s.physics, s.substep * dt
        inside = between | {s.gripper.held, self.pinched[0]}
        for (a, b), (force, impulse) in sorted(self._peaks.items()):
            other = self._names[b]
            if other in inside and self._class[a] in (_LEFT, _RIGHT):
                continue
            press = p.presses.get(other)
            if press is None:
                press = p.presses[other] = Press(began=now, last=now, bodies=(), force=0.0, impulse=0.0)
            body = f"held:{self._names[a]}" if self._class[a] == _CUBE else self._names[a]
            press.bodies = press.bodies if body in press.bodies else (*press.bodies, body)
            press.last, press.force, press.impulse = now, max(press.force, force), press.impulse + impulse
        for other in [other for other, press in p.presses.items() if now - press.last > ENDED]:
            p.felt.append(force_of(other, p.presses.pop(other)))

    def name_solids(self, names: tuple[str, ...]) -> None:
        """Set the names of the solids, by their numbers."""
        for i, number in enumerate(self._solid.tolist()):
            if number >= 0:
                self._names[i] = names[number]


def force_of(other: str, press: Press) -> ContactForce:
    """The contact up to now, as a `ContactForce`."""
    return ContactForce(
        time=press.began, body=press.bodies[0], other=other, force=press.force, impulse=press.impulse,
        duration=press.last - press.began,
    )  # fmt: skip


def disagreements(judged: Sequence[Contact], felt: Sequence[ContactForce]) -> tuple[str, ...]:
    """One sentence for each contact of the robot that only the referee's geometry or only the forces show."""
    robots = [one for one in judged if one.body.startswith(_OF_ROBOT)]
    seen, pressed = _spans(robots), _spans(felt)
    found = [
        (force.time, f"{force.time:.2f} s: {force.body} pressed {force.other} with {force.force:.1f} N, unseen")
        for force in felt
        if not _met(force, seen)
    ]
    found += [
        (one.time, f"{one.time:.2f} s: {one.body} and {one.other} overlap by {1e3 * one.depth:.2f} mm without a force")
        for one in robots
        if not _met(one, pressed)
    ]
    return tuple(text for _, text in sorted(found))


def _spans(contacts: Sequence[Contact | ContactForce]) -> dict[str, tuple[list[float], list[float]]]:
    """For each other body: sorted starts [s] of its contacts, less `ENDED`, and the latest end [s] up to each."""
    spans: dict[str, tuple[list[float], list[float]]] = {}
    for one in sorted(contacts, key=lambda one: one.time):
        begins, ends = spans.setdefault(one.other, ([], []))
        begins.append(one.time - ENDED)
        ends.append(max([one.time + one.duration, *ends[-1:]]))
    return spans


def _met(one: Contact | ContactForce, spans: dict[str, tuple[list[float], list[float]]]) -> bool:
    """True when a contact with the same other body is at the same time, up to the gap `ENDED` between contacts."""
    begins, ends = spans.get(one.other, ([], []))
    count = bisect_right(begins, one.time + one.duration)
    return count > 0 and one.time - ENDED <= ends[count - 1]


def _own_name(name: str) -> str:
    """The referee's name of the body that a geometry belongs to."""
    for part in ("object:", "agent:", "bump:"):
        if name.startswith(part):
            return name.removeprefix(part)
    return name.rstrip("01") if name.startswith(("panda_leftfinger", "panda_rightfinger")) else name


def _class_of(name: str) -> int:
    return next((found for found, beginnings in _CLASSES.items() if name.startswith(beginnings)), _SOLID)


APART = 10  # substeps below a threshold after which passing it counts again


def note_reflexes(p: PhysicsState, substep: int, now: float) -> None:
    """Note the thresholds that the present torque passes; without any contact, it counts as a phantom collision."""
    most = np.abs(p.torque)
    p.torque_peaks = np.maximum(p.torque_peaks, most)
    joint = int(most.argmax())
    for name, limit in REFLEXES.items():
        if most[joint] <= limit:
            continue
        p.reflexes.setdefault(name, f"{now:.2f} s: joint {joint + 1}, {most[joint]:.1f} Nm over {limit:g}")
        if substep - p.over.get(name, -APART) >= APART and not p.presses:
            p.trips[name] = p.trips.get(name, 0) + 1
        p.over[name] = substep


class ArmAlone:
    """Inverse dynamics of the arm on a base at rest."""

    def __init__(self, profile: RobotProfile, physics: Physics) -> None:
        root = ET.Element("mujoco", model="arm")
        ET.SubElement(root, "compiler", angle="radian", autolimits="true", eulerseq="XYZ")
        world = ET.SubElement(root, "worldbody")
        files = add_arm_alone(ET.SubElement(world, "body", name="base"), root, profile, physics)
        self._model = mujoco.MjModel.from_xml_string(ET.tostring(root, encoding="unicode"), files)
        self._model.body_gravcomp[:] = 0.0
        self._model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
        self._data = mujoco.MjData(self._model)

    def torque(self, q: Array, dq: Array, ddq: Array, width: float) -> Array:
        """Torques [Nm] that a motion takes, shape (7,), with the gripper ``width`` [m] open."""
        data = self._data
        data.qpos[:7], data.qvel[:7], data.qacc[:7] = q, dq, ddq
        data.qpos[7:9] = 0.5 * width
        mujoco.mj_inverse(self._model, data)
        return data.qfrc_inverse[:7].copy()
