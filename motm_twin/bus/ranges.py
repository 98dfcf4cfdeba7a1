"""Ranges of the numbers, names and lists in commands, which types can not express.

Bounds of edits are those of `model.edits` and `model.faults`. What a scene, a task list or a parameter allows beyond
them is checked by the twin itself.
"""

import math
import re

from motm_twin.bus.commands import (
    NAME_MAX,
    SPEED_MAX,
    SPEED_MIN,
    AddObstacle,
    Branch,
    Command,
    Drive,
    DriveToPoint,
    HandOver,
    InjectFault,
    InsertTask,
    Inspect,
    Load,
    MoveBody,
    MoveObject,
    MoveTask,
    PushRobot,
    Record,
    Refused,
    ReleaseBody,
    RemoveTask,
    Save,
    Seed,
    SendAgent,
    SetParameter,
    Speed,
    Step,
)
from motm_twin.model import faults
from motm_twin.model.edits import (
    FARTHEST,
    FARTHEST_PUSH,
    FASTEST_THROW,
    LARGEST,
    LARGEST_TURN,
    LONGEST_NAME,
    SHAPES,
    SMALLEST,
    ParameterValue,
)
from motm_twin.model.scene import DriveTo, Pick, Place, Task

MAX_NAME = LONGEST_NAME
MAX_STEPS = 1000
MAX_INDEX = 10**7  # periods: almost six days
MAX_TASKS = 60
MAX_CANDIDATES = 10_000
MAX_COORDINATE = 1000.0  # [m], [rad]
MAX_DRIVE, MAX_TURN = 10.0, 20.0  # [m/s], [rad/s]; the base takes what it can
TOLERANCE_RANGE = (0.01, 5.0)  # [m]
MAX_VALUE = 1e6  # of a parameter
MAX_SEED = 2**31 - 1
_FILE = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,63}\Z")

_COORDINATE = f"at most {MAX_COORDINATE:g} either way"
_BODY = f"at most {FARTHEST:g} either way"
_NAME, _FILE_NAME = f"1 to {MAX_NAME} characters", "1 to 64 letters, digits, '.', '_' or '-'"
_COUNT = f"0 to {MAX_INDEX}"
ALLOWED: dict[tuple[str, str], str] = {  # what docs/zenoh.md says of (command, field)
    ("step", "count"): f"1 to {MAX_STEPS}",
    ("speed", "factor"): f"{SPEED_MIN:g} to {SPEED_MAX:g}",
    ("load", "scene"): "a name of `status.scenes`",
    ("load", "seed"): f"0 to {MAX_SEED}",
    ("load", "method"): "a name of `status.methods`",
    ("seed", "seed"): f"0 to {MAX_SEED}",
    ("drive_to", "x"): _COORDINATE,
    ("save", "name"): _FILE_NAME,
    ("record", "name"): _FILE_NAME,
    ("branch", "index"): "`status.oldest` to the last period",
    ("inspect", "candidate"): f"-1 to {MAX_CANDIDATES}",
    ("hand_over", "to"): f"at most {MAX_NAME} characters",
    ("hand_over", "name"): f"at most {NAME_MAX} characters",
    ("add_obstacle", "name"): _NAME,
    ("add_obstacle", "x"): _BODY,
    ("move_body", "x"): _BODY,
    ("send_agent", "x"): _BODY,
    ("move_object", "x"): _BODY,
    ("add_obstacle", "size"): f"each {SMALLEST:g} to {LARGEST:g}",
    ("release_body", "velocity"): f"its length at most {FASTEST_THROW:g}",
    ("push_robot", "dx"): f"length with dy at most {FARTHEST_PUSH:g}",
    ("push_robot", "turn"): f"at most {LARGEST_TURN:g} either way",
    ("inject_fault", "fault"): "one of the table of faults",
    ("inject_fault", "seconds"): f"{faults.SHORTEST:g} to {faults.LONGEST:g}",
    ("inject_fault", "delay"): f"0 to {faults.LONGEST_DELAY:g}",
    ("inject_fault", "amount"): "as in the table of faults",
    ("inject_fault", "joint"): f"1 to {faults.JOINTS}",
    ("insert_task", "tasks"): f"1 to {MAX_TASKS}",
    ("insert_task", "index"): _COUNT,
    ("drive", "v"): f"-{MAX_DRIVE:g} to {MAX_DRIVE:g}",
    ("drive", "w"): f"-{MAX_TURN:g} to {MAX_TURN:g}",
}


def check_command(command: Command) -> None:
    """Raise Refused, saying what is allowed, unless every number, name and list is within its range."""
    name = getattr(command, "name", None)
    if name is not None and not isinstance(command, HandOver | Save | Record):
        _name("name", name)
    match command:
        case Speed(factor=factor):
            _number("speed", factor, SPEED_MIN, SPEED_MAX)
        case Step(count=count):
            _number("number of steps", count, 1, MAX_STEPS)
        case Load():
            _load(command)
        case Seed(seed=seed):
            _number("seed", seed, 0, MAX_SEED)
        case DriveToPoint(x=x, y=y, heading=heading):
            _place(x, y, heading or 0.0)
        case Save(name=name):
            _file(name)
        case Record(name=name):
            if name:
                _file(name)
        case Branch(index=index):
            _number("period", index, 0, MAX_INDEX)
        case Inspect(candidate=candidate):
            _number("candidate", candidate, -1, MAX_CANDIDATES)
        case HandOver():
            _text("receiver", command.to, MAX_NAME)
            _text("name", command.name, NAME_MAX)
        case AddObstacle():
            _obstacle(command)
        case MoveBody(x=x, y=y, heading=heading):
            _place(x, y, heading or 0.0, FARTHEST)
        case SendAgent(x=x, y=y) | MoveObject(x=x, y=y):
            _place(x, y, farthest=FARTHEST)
        case ReleaseBody(velocity=(vx, vy)):
            _number("speed of a thrown body [m/s]", math.hypot(vx, vy), 0.0, FASTEST_THROW)
        case PushRobot(dx=dx, dy=dy, turn=turn):
            _number("length of a push [m]", math.hypot(dx, dy), 0.0, FARTHEST_PUSH)
            _number("turn of a push [rad]", turn, -LARGEST_TURN, LARGEST_TURN)
        case InjectFault():
            _fault(command)
        case Drive(v=v, w=w):
            _number("speed by hand [m/s]", v, -MAX_DRIVE, MAX_DRIVE)
            _number("turn by hand [rad/s]", w, -MAX_TURN, MAX_TURN)
        case InsertTask():
            _tasks(command)
        case RemoveTask(index=index):
            _number("task", index, 0, MAX_INDEX)
        case MoveTask(index=index, to=to):
            _number("task", index, 0, MAX_INDEX)
            _number("place in the list", to, 0, MAX_INDEX)
        case SetParameter(value=value):
            _value(value)


def _number(what: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:  # nan neither; and a whole number may be too long to be written
        shown = _shown(value) if abs(value) < 1e300 else "out of range"
        raise Refused(f"{what} {shown}: allowed is {_shown(low)} to {_shown(high)}")


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:g}"


def _text(what: str, text: str, longest: int) -> None:
    if len(text) > longest or not text.isprintable():
        raise Refused(f"{what}: at most {longest} printable characters")


def _name(what: str, text: str) -> None:
    if not 1 <= len(text) <= MAX_NAME or not text.isprintable():
        raise Refused(f"{what}: needs 1 to {MAX_NAME} printable characters")


def _file(name: str) -> None:
    if not _FILE.match(name):
        raise Refused(
            f"file name {name[:MAX_NAME]!r}: use 1 to 64 letters, digits, '.', '_' or '-', beginning with a letter or "
            "digit, and no folder"
        )


def _place(x: float, y: float, heading: float = 0.0, farthest: float = MAX_COORDINATE) -> None:
    if not (abs(x) <= farthest and abs(y) <= farthest and abs(heading) <= MAX_COORDINATE):
        raise Refused(f"place ({x:g}, {y:g}, {heading:g}): stay within {farthest:.0f} m")


def _load(command: Load) -> None:
    _name("scene", command.scene)
    if command.variant is not None:
        _text("variant", command.variant, MAX_NAME)
    if command.seed is not None:
        _number("seed", command.seed, 0, MAX_SEED)


def _obstacle(command: AddObstacle) -> None:
    _place(command.x, command.y, command.heading, FARTHEST)
    if command.shape not in SHAPES:
        raise Refused(f"shape {command.shape[:MAX_NAME]!r}: there are {', '.join(SHAPES)}")
    for extent in command.size:
        _number("size [m]", extent, SMALLEST, LARGEST)
    if command.shape == "cylinder" and command.size[0] != command.size[1]:
        raise Refused(
            f"size {list(command.size)} of a cylinder: it is diameter, diameter, height, and the first two differ"
        )


def _fault(command: InjectFault) -> None:
    problem = faults.problem(
        command.fault, seconds=command.seconds, delay=command.delay, amount=command.amount, joint=command.joint
    )
    if problem:
        raise Refused(problem)


def _tasks(command: InsertTask) -> None:
    if not 1 <= len(command.tasks) <= MAX_TASKS:
        raise Refused(f"{len(command.tasks)} tasks: allowed is 1 to {MAX_TASKS}")
    if command.index is not None:
        _number("place in the list", command.index, 0, MAX_INDEX)
    for task in command.tasks:
        _task(task)


def _task(task: Task) -> None:
    match task:
        case Pick(object=name):
            _name("object", name)
        case Place(bin=name):
            _name("bin", name)
        case DriveTo(point=(x, y), heading=heading, tolerance=tolerance):
            _place(x, y, heading or 0.0)
            _number("tolerance [m]", tolerance, *TOLERANCE_RANGE)


def _value(value: ParameterValue | None) -> None:
    if isinstance(value, str):
        _text("value", value, MAX_NAME)
    elif value is not None and not isinstance(value, bool):
        _number("value", value, -MAX_VALUE, MAX_VALUE)
