"""Edits: changes to a running twin by persons or programs, applied at the start of a period and logged with its number.

World edits change the simulated world, and the robot learns of them through its sensors only. Control edits change
the robot's tasks or knowledge. With scene and seed, the log of both replays a run bit for bit.
"""

from typing import Annotated

import msgspec

from motm_twin.model.bounds import FARTHEST, Between, Count, Length, OneOf, Text
from motm_twin.model.faults import FaultFields
from motm_twin.model.scene import BEHAVIOURS, Task

SHAPES = ("box", "cylinder", "temi", "person")
INDEX = Between(0, 10**7)  # of a period (almost six days) or of a task
ParameterValue = float | bool | str
Name = Annotated[str, Text(1, 64)]
Coordinate = Annotated[float, FARTHEST]
Size = Annotated[tuple[float, float, float], Between(0.02, 5.0, unit="m")]
Throw = Annotated[tuple[float, float], Length(10.0, unit="m/s", called="velocity of a thrown body")]
Heading = Annotated[float, Between(-1000.0, 1000.0, unit="rad")]


class AddObstacle(msgspec.Struct, frozen=True, kw_only=True, tag="add_obstacle", forbid_unknown_fields=True):
    """Put a body into the world, unknown to the map. Temis and persons stand until they are sent somewhere."""

    name: Name
    shape: Annotated[str, OneOf(SHAPES)] = "box"
    x: Coordinate
    y: Coordinate
    heading: Heading = 0.0
    size: Size = (0.5, 0.5, 0.6)  # box: x, y, z; cylinder: diameter, diameter, height

    def conflict(self) -> str:
        """Refusal of a cylinder that is not round; "" for any other body."""
        if self.shape != "cylinder" or self.size[0] == self.size[1]:
            return ""
        return f"size {list(self.size)} of a cylinder: it is diameter, diameter, height, and the first two differ"


class MoveBody(msgspec.Struct, frozen=True, kw_only=True, tag="move_body", forbid_unknown_fields=True):
    """Move an obstacle, agent or piece of furniture (with what stands on it); while ``held`` it does not move itself.

    Furniture is placed by the centre of its bounding box as in the scene file, and turned about it.
    """

    name: Name
    x: Coordinate
    y: Coordinate
    heading: Heading | None = None  # None: unchanged. Furniture: turn from its pose in the scene
    held: bool = True


class ReleaseBody(msgspec.Struct, frozen=True, kw_only=True, tag="release_body", forbid_unknown_fields=True):
    """Let go of a dragged body; with a velocity it is thrown: it slides on until it stops or meets something."""

    name: Name
    velocity: Throw = (0.0, 0.0)  # world


class FreezeBody(msgspec.Struct, frozen=True, kw_only=True, tag="freeze_body", forbid_unknown_fields=True):
    """Make an agent stand still, or let it go on."""

    name: Name
    frozen: bool = True


class SendAgent(msgspec.Struct, frozen=True, kw_only=True, tag="send_agent", forbid_unknown_fields=True):
    """Let a Temi or person go to a point; there it goes on with its round, or stands when it has none."""

    name: Name
    x: Coordinate
    y: Coordinate


class SetBehaviour(msgspec.Struct, frozen=True, kw_only=True, tag="set_behaviour", forbid_unknown_fields=True):
    """Choose how a Temi or person moves among others: `blind` stops for nobody, `orca` needs the extra [people]."""

    name: Name
    behaviour: Annotated[str, OneOf(BEHAVIOURS)]


class RemoveBody(msgspec.Struct, frozen=True, kw_only=True, tag="remove_body", forbid_unknown_fields=True):
    """Take an obstacle, agent or piece of furniture away. Furniture that carries a bin or cube cannot be removed."""

    name: Name


class MoveObject(msgspec.Struct, frozen=True, kw_only=True, tag="move_object", forbid_unknown_fields=True):
    """Put a cube on whatever is below (x, y), also one that the gripper holds: it is taken out of the fingers."""

    name: Name
    x: Coordinate
    y: Coordinate


class PushRobot(msgspec.Struct, frozen=True, kw_only=True, tag="push_robot", forbid_unknown_fields=True):
    """Shove the base: its true pose jumps, its wheels and so its odometry notice nothing."""

    dx: Annotated[float, Length(0.5, unit="m", other="dy", called="length of a push")]  # world
    dy: float
    turn: Annotated[float, Between(-1.0, 1.0, unit="rad")] = 0.0


class InjectFault(FaultFields, frozen=True, kw_only=True, tag="inject_fault", forbid_unknown_fields=True):
    """A sensor or the robot fails for a while, in one of the ways of `model.faults`. One of a kind replaces another."""


class InsertTask(msgspec.Struct, frozen=True, kw_only=True, tag="insert_task", forbid_unknown_fields=True):
    """Put tasks into the list before task ``index`` (None: at its end). A pick comes together with its place."""

    tasks: Annotated[tuple[Task, ...], Count(1, 60)]
    index: Annotated[int, INDEX] | None = None


class RemoveTask(msgspec.Struct, frozen=True, kw_only=True, tag="remove_task", forbid_unknown_fields=True):
    """Take a task out of the list; a pick or place that has not begun takes the other half with it."""

    index: Annotated[int, INDEX]


class MoveTask(msgspec.Struct, frozen=True, kw_only=True, tag="move_task", forbid_unknown_fields=True):
    """Move a waiting task (a pick with its place) to stand before task ``to``; the number of tasks: to the end."""

    index: Annotated[int, INDEX]
    to: Annotated[int, INDEX]


class SetParameter(msgspec.Struct, frozen=True, kw_only=True, tag="set_parameter", forbid_unknown_fields=True):
    """Change one parameter of `control.tuning`; None sets it back to what it was at the start."""

    name: Name
    value: Annotated[float, Between(-1e6, 1e6)] | bool | Annotated[str, Text(0, 64)] | None = None


class Announce(msgspec.Struct, frozen=True, kw_only=True, tag="announce", forbid_unknown_fields=True):
    """Tell the robot where a piece of furniture, with its bins and cubes, is now: the map follows."""

    name: Name


class Drive(msgspec.Struct, frozen=True, kw_only=True, tag="drive", forbid_unknown_fields=True):
    """Drive the base by hand, for 0.3 s, within its limits and those of the monitor; the arm folds away meanwhile."""

    v: Annotated[float, Between(-10.0, 10.0, unit="m/s")]  # forward; the base takes what it can
    w: Annotated[float, Between(-20.0, 20.0, unit="rad/s")] = 0.0  # to the left


WorldEdit = (
    AddObstacle
    | MoveBody
    | ReleaseBody
    | FreezeBody
    | SendAgent
    | SetBehaviour
    | RemoveBody
    | MoveObject
    | PushRobot
    | InjectFault
)
TaskEdit = InsertTask | RemoveTask | MoveTask
ControlEdit = TaskEdit | SetParameter | Announce | Drive
Edit = WorldEdit | ControlEdit

WORLD_EDITS = WorldEdit.__args__
CONTROL_EDITS = ControlEdit.__args__
EDITS = (*WORLD_EDITS, *CONTROL_EDITS)
