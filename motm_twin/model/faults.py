"""Faults of sensors and of the robot that can be injected: one table of kinds, with parameters, bounds, units, phrases.

Everything that lists faults is generated from or checked against it: the edit, the scene file, commands, the page,
and the documents.
"""

from typing import Annotated, Literal

import msgspec

from motm_twin.model.bounds import Between, OneOf

SECONDS = Between(0.05, 60.0, unit="s", called="a fault of")  # that it lasts
DELAY = Between(0, 5.0, unit="s", called="a delay of")  # of whatever comes or acts late
JOINT = Between(1, 7)
Field = Literal["", "delay", "amount", "joint"]


class FaultKind(msgspec.Struct, frozen=True, kw_only=True):
    """One kind of fault. Its number, if it has one, is a field of the edit: ``delay``, ``amount`` or ``joint``."""

    name: str
    group: str  # lidar | camera | localisation | wheels | arm | state
    button: str  # on the page
    what: str  # one line for documents
    phrase: str  # while it lasts; "{}" stands for its number
    number: Field = ""
    low: float = 0.0
    high: float = 0.0
    usual: float = 0.0  # its number when none is given
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


def _late(name: str, group: str, button: str, what: str, phrase: str) -> FaultKind:
    return FaultKind(
        name=name,
        group=group,
        button=button,
        what=what,
        phrase=phrase,
        number="delay",
        high=DELAY.high,
        usual=0.5,
        unit="s",
    )


def _by(
    name: str, group: str, button: str, what: str, phrase: str, bounds: tuple[float, float, float], unit: str
) -> FaultKind:
    """A kind with an amount; ``bounds``: least, most, usual."""
    low, high, usual = bounds
    return FaultKind(
        name=name, group=group, button=button, what=what, phrase=phrase, number="amount", low=low, high=high,
        usual=usual, unit=unit,
    )  # fmt: skip


KINDS: dict[str, FaultKind] = {
    kind.name: kind
    for kind in (
        FaultKind(name="lidar_off", group="lidar", button="Lidar off", what="no sweep comes", phrase="lidar off"),
        FaultKind(
            name="lidar_frozen",
            group="lidar",
            button="Lidar frozen",
            what="the last sweep comes again and again, with fresh stamps",
            phrase="lidar frozen",
        ),
        FaultKind(
            name="lidar_blind", group="lidar", button="Lidar blind", what="no beam returns", phrase="lidar blind"
        ),
        _by(
            "lidar_sector",
            "lidar",
            "Lidar half blind",
            "no beam within this angle, straight ahead, returns",
            "{:.0f} deg of the lidar blind",
            (5.0, 360.0, 90.0),
            "deg",
        ),
        _by(
            "lidar_nan",
            "lidar",
            "Lidar NaN",
            "a share of the beams, at least one, says nan",
            "{:.3g} of the lidar's beams nan",
            (0.0, 1.0, 0.3),
            "share",
        ),
        _by(
            "lidar_noise",
            "lidar",
            "Lidar noisy",
            "the noise of the ranges is so many times as large (of 0.01 m where it is none)",
            "lidar noise {:g} times as large",
            (1.0, 50.0, 10.0),
            "times",
        ),
        _late("lidar_delay", "lidar", "Lidar late", "sweeps come late, with their true stamps", "lidar {:.2f} s late"),
        FaultKind(
            name="camera_off", group="camera", button="Camera off", what="nothing is detected", phrase="camera off"
        ),
        _late(
            "camera_delay",
            "camera",
            "Camera late",
            "detections come late, with their true stamps",
            "camera {:.2f} s late",
        ),
        _by(
            "camera_ghost",
            "camera",
            "Ghost cube",
            "an object is reported beside where it stands, whatever the camera looks at",
            "a ghost {:.2f} m beside an object",
            (0.1, 2.0, 0.3),
            "m",
        ),
        FaultKind(
            name="camera_swap",
            group="camera",
            button="Cube swap",
            what="the two objects nearest to the camera are taken for each other",
            phrase="two objects swapped",
        ),
        FaultKind(
            name="camera_lost",
            group="camera",
            button="Cube lost",
            what="the object nearest to the camera is not detected",
            phrase="the nearest object not detected",
        ),
        _by(
            "pose_jump",
            "localisation",
            "Pose jump",
            "the localised pose is so far off",
            "localisation {:.2f} m off",
            (0.1, 1.0, 0.3),
            "m",
        ),
        _by(
            "pose_drift",
            "localisation",
            "Pose drift",
            "the localised pose drifts off at this speed",
            "localisation drifts at {:.2f} m/s",
            (0.05, 0.5, 0.1),
            "m/s",
        ),
        _by(
            "odometry_jump",
            "wheels",
            "Odometry jump",
            "odometry is so far off",
            "odometry {:.2f} m off",
            (0.1, 1.0, 0.3),
            "m",
        ),
        _by(
            "wheel_slip",
            "wheels",
            "Wheels slip",
            "this share of what the wheels turn does not move the base",
            "wheels slip by {:.0%}",
            (0.05, 1.0, 0.5),
            "share",
        ),
        _late(
            "base_lag",
            "wheels",
            "Base late",
            "the base follows its commands with so much more lag",
            "base lags {:.2f} s more",
        ),
        FaultKind(
            name="base_stuck",
            group="wheels",
            button="Base stuck",
            what="the wheels brake, and stand",
            phrase="base stuck",
        ),
        FaultKind(
            name="joint_stuck",
            group="arm",
            button="Joint stuck",
            what="one joint of the arm brakes, and stands",
            phrase="joint {:.0f} stuck",
            number="joint",
            low=JOINT.low,
            high=JOINT.high,
            usual=4,
            unit="",
        ),
        FaultKind(
            name="gripper_stuck", group="arm", button="Fingers stuck", what="the fingers stand", phrase="gripper stuck"
        ),
        _late(
            "state_delay",
            "state",
            "State late",
            "all that the robot says of its own motion comes late, and says so",
            "state of the robot {:.2f} s late",
        ),
    )
}
NAMES = tuple(KINDS)
USUAL_JOINT = 4


class FaultFields(msgspec.Struct, frozen=True, kw_only=True):
    """A fault as the edit and the scene give it."""

    fault: Annotated[str, OneOf(NAMES, where="one of the table of faults")]  # lidar_off, lidar_frozen, ...
    seconds: Annotated[float, SECONDS] = 1.0  # for how long
    delay: Annotated[float, DELAY] = 0.5  # of what comes or acts late
    amount: float | None = None  # as in the table of faults, of the kinds that have one; None: the usual one
    joint: Annotated[int, JOINT] = USUAL_JOINT  # joint_stuck only

    def conflict(self) -> str:
        """Why this kind of fault cannot have this amount, in one sentence; "" when it can."""
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
