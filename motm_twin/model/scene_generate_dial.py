"""What a difficulty from 0 to 1 means in numbers: how much there is, how close it stands, and who else is about."""

import dataclasses

AGENTS_FROM = 0.6  # difficulty from which somebody else drives about
DOORS_FROM = 0.3  # difficulty from which half of the rooms are parted by a wall with a doorway


@dataclasses.dataclass(frozen=True, kw_only=True)
class Dial:
    """How hard a generated scene is. Every count grows, and every width shrinks, with the difficulty."""

    difficulty: float
    surfaces: int  # pieces of furniture with cubes on them
    bins: int  # each on a piece of its own
    cubes: int
    drives: int  # tasks to drive somewhere
    clutter: int  # pieces of furniture that are only in the way
    boxes: int  # of them, those that only the lidar sees
    agents: int  # who drive about and yield
    gap: float  # [m] least width between any two pieces
    doorway: float  # [m] width of a doorway, if there is one
    doors: bool  # a wall with a doorway may part the room
    spread: float  # [m] that heights differ from 0.75 m, either way


def dial(difficulty: float) -> Dial:
    """The numbers for a difficulty from 0 to 1."""
    d = difficulty
    return Dial(
        difficulty=d,
        surfaces=1 + round(2.0 * d),
        bins=1 + round(1.5 * d),
        cubes=2 + round(4.0 * d),
        drives=round(1.6 * d),
        clutter=round(5.0 * d),
        boxes=round(3.0 * d),
        agents=0 if d < AGENTS_FROM else 1 + round(2.0 * (d - AGENTS_FROM) / (1.0 - AGENTS_FROM)),
        gap=1.6 - 0.7 * d,
        doorway=1.4 - 0.5 * d,
        doors=d >= DOORS_FROM,
        spread=0.03 + 0.08 * d,
    )
