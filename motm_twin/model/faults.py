"""Faults of sensors and of the robot that can be injected: one table of kinds, with parameters, bounds, units, phrases.

All other lists of faults are generated from it or checked against it: the edit, the scene file, commands, the page,
and the documents.
"""

from typing import Annotated, Any, Literal

import msgspec

from motm_twin.model.bounds import Between, OneOf

SECONDS = Between(0.05, 60.0, unit="s", called="a fault of")  # duration of a fault
DELAY = Between(0, 5.0, unit="s", called="a delay of")  # of data or commands
JOINT = Between(1, 7)
USUAL_JOINT = 4
Field = Literal["", "delay", "amount", "joint"]


class FaultKind(msgspec.Struct, frozen=True):
    """One kind of fault. Its number, if it has one, is a field of the edit: ``delay``, ``amount`` or ``joint``."""

    name: str
    group: str  # lidar | camera | localisation | wheels | arm | state
    button: str  # label of its button on the page
    phrase: str  # shown while it lasts; "{}" stands for its number
    what: str  # one line for documents
    number: Field = ""
    low: float = 0.0
    high: float = 0.0
    usual: float = 0.0  # default of its number
    unit: str = ""

    def value(self, *, delay: float, amount: float | None, joint: int) -> float:
        """The number of an edit with these fields; 0 for a kind that has none."""
        match self.number:
            case "delay":
                return delay
            case "amount":
                return self.usual if amount is None else amount
            case "joint":
                return float(joint)
        return 0.0


_LATE = ("delay", 0.0, DELAY.high, 0.5, "s")


def _kind(head: tuple[str, str, str, str], what: str, number: tuple[Any, ...]) -> FaultKind:
    return FaultKind(*head, what, *number)


_TABLE = (  # name, group, button and phrase; one line for documents; number: its field, least, most, usual, unit
    (("lidar_off", "lidar", "Lidar off", "lidar off"), "no sweep comes", ()),
    (
        ("lidar_frozen", "lidar", "Lidar frozen", "lidar frozen"),
        "the last sweep comes again and again, with fresh stamps",
        (),
    ),
    (("lidar_blind", "lidar", "Lidar blind", "lidar blind"), "no beam returns", ()),
    (
        ("lidar_sector", "lidar", "Lidar half blind", "{:.0f} deg of the lidar blind"),
        "no beam within this angle, straight ahead, returns",
        ("amount", 5.0, 360.0, 90.0, "deg"),
    ),
    (
        ("lidar_nan", "lidar", "Lidar NaN", "{:.3g} of the lidar's beams nan"),
        "a share of the beams, at least one, reports nan",
        ("amount", 0.0, 1.0, 0.3, "share"),
    ),
    (
        ("lidar_noise", "lidar", "Lidar noisy", "lidar noise {:g} times as large"),
        "range noise is larger by this factor (of 0.01 m where there is none)",
        ("amount", 1.0, 50.0, 10.0, "times"),
    ),
    (("lidar_delay", "lidar", "Lidar late", "lidar {:.2f} s late"), "scans arrive late, with their true stamps", _LATE),
    (("camera_off", "camera", "Camera off", "camera off"), "no images arrive", ()),
    (
        ("camera_delay", "camera", "Camera late", "camera {:.2f} s late"),
        "detections arrive late, with their true stamps",
        _LATE,
    ),
    (
        ("camera_ghost", "camera", "Ghost cube", "a ghost {:.2f} m beside an object"),
        "an object is reported beside where it stands, whatever the camera looks at",
        ("amount", 0.1, 2.0, 0.3, "m"),
    ),
    (
        ("camera_swap", "camera", "Cube swap", "two objects swapped"),
        "the two objects nearest to the camera exchange their names",
        (),
    ),
    (
        ("camera_lost", "camera", "Cube lost", "the nearest object not detected"),
        "the object nearest to the camera is not detected",
        (),
    ),
    (
        ("pose_jump", "localisation", "Pose jump", "localisation {:.2f} m off"),
        "the localised pose is off by this distance",
        ("amount", 0.1, 1.0, 0.3, "m"),
    ),
    (
        ("pose_drift", "localisation", "Pose drift", "localisation drifts at {:.2f} m/s"),
        "the localised pose drifts off at this speed",
        ("amount", 0.05, 0.5, 0.1, "m/s"),
    ),
    (
        ("odometry_jump", "wheels", "Odometry jump", "odometry {:.2f} m off"),
        "odometry jumps by this distance",
        ("amount", 0.1, 1.0, 0.3, "m"),
    ),
    (
        ("wheel_slip", "wheels", "Wheels slip", "wheels slip by {:.0%}"),
        "this share of the wheels' motion does not move the base",
        ("amount", 0.05, 1.0, 0.5, "share"),
    ),
    (
        ("base_lag", "wheels", "Base late", "base lags {:.2f} s more"),
        "the base follows its commands with this additional lag",
        _LATE,
    ),
    (("base_stuck", "wheels", "Base stuck", "base stuck"), "the wheels brake and stay still", ()),
    (
        ("joint_stuck", "arm", "Joint stuck", "joint {:.0f} stuck"),
        "one arm joint brakes and stays still",
        ("joint", JOINT.low, JOINT.high, USUAL_JOINT, ""),
    ),
    (("gripper_stuck", "arm", "Fingers stuck", "gripper stuck"), "the fingers do not move", ()),
    (
        ("state_delay", "state", "State late", "state of the robot {:.2f} s late"),
        "the robot's reports of its own motion arrive late, with their true age",
        _LATE,
    ),
)
KINDS = {head[0]: _kind(head, what, number) for head, what, number in _TABLE}
NAMES = tuple(KINDS)


class FaultFields(msgspec.Struct, frozen=True, kw_only=True):
    """A fault as the edit and the scene give it."""

    fault: Annotated[str, OneOf(NAMES, where="one of the table of faults")]  # lidar_off, lidar_frozen, ...
    seconds: Annotated[float, SECONDS] = 1.0  # for how long
    delay: Annotated[float, DELAY] = 0.5  # of what comes or acts late
    amount: float | None = None  # as in the table of faults, of the kinds that have one; None: the usual one
    joint: Annotated[int, JOINT] = USUAL_JOINT  # joint_stuck only

    def conflict(self) -> str:
        """Reason why this kind of fault cannot have this amount, in one sentence; "" when it can."""
        kind = KINDS[self.fault]
        if self.amount is None:
            return ""
        if kind.number != "amount":
            return f"an amount of {self.amount:g}: {kind.name} has none"
        return Between(kind.low, kind.high, unit=kind.unit, called=f"{kind.name} of").refusal("amount", self.amount)


def table() -> str:
    """All kinds as a table for documents (Markdown)."""
    lines = ["| fault | what | number | allowed | usual |", "|---|---|---|---|---|"]
    for kind in KINDS.values():
        unit = f" [{kind.unit}]" if kind.unit else ""
        number = f"`{kind.number}`{unit}" if kind.number else ""
        allowed = f"{kind.low:g} to {kind.high:g}" if kind.number else ""
        usual = f"{kind.usual:g}" if kind.number else ""
        lines.append(f"| `{kind.name}` | {kind.what} | {number} | {allowed} | {usual} |")
    return "\n".join(lines)
