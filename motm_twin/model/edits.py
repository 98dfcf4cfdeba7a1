"""What a person or program may do to a running twin. Applied at the start of a period and logged with its number.

World edits change the simulated world, and the robot learns of them through its sensors only. Control edits change
what the robot wants or knows. With scene and seed, the log of both replays a run bit for bit.
"""

import msgspec

from motm_twin.model.faults import NAMES, USUAL_JOINT
from motm_twin.model.scene import Task

FARTHEST = 100.0  # [m] from the origin that a body may be put
LONGEST_NAME = 64  # characters of the name of a body
SHAPES = ("box", "cylinder", "temi", "person")
SMALLEST, LARGEST = 0.02, 5.0  # [m] of each side of a body
FASTEST_THROW = 10.0  # [m/s]
FARTHEST_PUSH, LARGEST_TURN = 0.5, 1.0  # [m], [rad] of a push of the base
FAULTS = NAMES
ParameterValue = float | bool | str


class AddObstacle(msgspec.Struct, frozen=True, kw_only=True, tag="add_obstacle", forbid_unknown_fields=True):
    """Put a body into the world, unknown to the map. Temis and persons stand until they are sent somewhere."""

    name: str
    shape: str = "box"  # box | cylinder | temi | person
    x: float
    y: float
    heading: float = 0.0  # [rad]
    size: tuple[float, float, float] = (0.5, 0.5, 0.6)  # box: x, y, z [m]; cylinder: diameter, diameter, height


class MoveBody(msgspec.Struct, frozen=True, kw_only=True, tag="move_body", forbid_unknown_fields=True):
    """Move an obstacle, agent or piece of furniture (with what stands on it); while ``held`` it does not move itself.

    Furniture is placed by the centre of its bounding box as in the scene file, and turned about it.
    """

    name: str
    x: float
    y: float
    heading: float | None = None  # [rad]; None keeps it. Furniture: turned this far from how the scene has it
    held: bool = True


class ReleaseBody(msgspec.Struct, frozen=True, kw_only=True, tag="release_body", forbid_unknown_fields=True):
    """Let go of a dragged body; with a velocity it is thrown: it slides on until it stops or meets something."""

    name: str
    velocity: tuple[float, float] = (0.0, 0.0)  # [m/s], world


class FreezeBody(msgspec.Struct, frozen=True, kw_only=True, tag="freeze_body", forbid_unknown_fields=True):
    """Make an agent stand still, or let it go on."""

    name: str
    frozen: bool = True


class SendAgent(msgspec.Struct, frozen=True, kw_only=True, tag="send_agent", forbid_unknown_fields=True):
    """Let a Temi or person go to a point; there it goes on with its round, or stands when it has none."""

    name: str
    x: float
    y: float


class RemoveBody(msgspec.Struct, frozen=True, kw_only=True, tag="remove_body", forbid_unknown_fields=True):
    """Take an obstacle, agent or piece of furniture away. Furniture that carries a bin or cube cannot be removed."""

    name: str


class MoveObject(msgspec.Struct, frozen=True, kw_only=True, tag="move_object", forbid_unknown_fields=True):
    """Put a cube on whatever is below (x, y), also one that the gripper holds: it is taken out of the fingers."""

    name: str
    x: float
    y: float


class PushRobot(msgspec.Struct, frozen=True, kw_only=True, tag="push_robot", forbid_unknown_fields=True):
    """Shove the base: its true pose jumps, its wheels and so its odometry notice nothing."""

    dx: float  # [m], world
    dy: float
    turn: float = 0.0  # [rad]


class InjectFault(msgspec.Struct, frozen=True, kw_only=True, tag="inject_fault", forbid_unknown_fields=True):
    """A sensor or the robot fails for a while, in one of the ways of `model.faults`. One of a kind replaces another."""

    fault: str  # a kind of `model.faults`: lidar_off, lidar_frozen, ...
    seconds: float = 1.0  # [s] for how long
    delay: float = 0.5  # [s] of what comes or acts late
    amount: float | None = None  # of the kinds that have one, in their unit; None: the usual one
    joint: int = USUAL_JOINT  # 1 to 7, joint_stuck only


class InsertTask(msgspec.Struct, frozen=True, kw_only=True, tag="insert_task", forbid_unknown_fields=True):
    """Put tasks into the list before task ``index`` (None: at its end). A pick comes together with its place."""

    tasks: tuple[Task, ...]
    index: int | None = None


class RemoveTask(msgspec.Struct, frozen=True, kw_only=True, tag="remove_task", forbid_unknown_fields=True):
    """Take a task out of the list; a pick or place that has not begun takes the other half with it."""

    index: int


class MoveTask(msgspec.Struct, frozen=True, kw_only=True, tag="move_task", forbid_unknown_fields=True):
    """Move a waiting task (a pick with its place) to stand before task ``to``; the number of tasks: to the end."""

    index: int
    to: int


class SetParameter(msgspec.Struct, frozen=True, kw_only=True, tag="set_parameter", forbid_unknown_fields=True):
    """Change one parameter of `control.tuning`; None sets it back to what it was at the start."""

    name: str
    value: ParameterValue | None = None


class Announce(msgspec.Struct, frozen=True, kw_only=True, tag="announce", forbid_unknown_fields=True):
    """Tell the robot where a piece of furniture, with its bins and cubes, is now: the map follows."""

    name: str


class Drive(msgspec.Struct, frozen=True, kw_only=True, tag="drive", forbid_unknown_fields=True):
    """Drive the base by hand, for 0.3 s, within its limits and those of the monitor; the arm folds away meanwhile."""

    v: float  # [m/s] forward
    w: float = 0.0  # [rad/s] to the left


WorldEdit = (
    AddObstacle | MoveBody | ReleaseBody | FreezeBody | SendAgent | RemoveBody | MoveObject | PushRobot | InjectFault
)
TaskEdit = InsertTask | RemoveTask | MoveTask
ControlEdit = TaskEdit | SetParameter | Announce | Drive
Edit = WorldEdit | ControlEdit

WORLD_EDITS = WorldEdit.__args__
CONTROL_EDITS = ControlEdit.__args__
EDITS = (*WORLD_EDITS, *CONTROL_EDITS)
