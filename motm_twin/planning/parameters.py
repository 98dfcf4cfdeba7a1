"""Every number of base placement and base control, once: symbol, unit, and where it comes from.

"Paper" is the reactive-base-control paper, "STAA*" the local planner that it modifies, "own" a choice of this project.
"""

import dataclasses
import math
from typing import NamedTuple

from motm_twin.model.profile import Footprint, RobotProfile

DEG = math.pi / 180.0
TERMINATIONS = ("task", "pass", "reach_goal")
PENALTIES = ("clearance", "grid")
SHORTEST_NODE = 0.05  # [s] between nodes of the local search: a control period


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlacementParameters:
    """Base placement (Paper, Sec. IV)."""

    positions: int = 36  # Paper, Sec. IV: 10 deg increments, two tangential headings each
    radius_min: float = 0.60  # [m] Paper, Sec. IV
    radius_max: float = 0.80  # [m] Paper, Sec. IV
    radius_step: float = 0.05  # [m] own: 0.02 finds the same candidates in the shipped scenes
    next_weight: float = 1.05  # Paper, Sec. IV: weight of C_iN
    clearance: float = (
        0.06  # [m] own: a candidate must keep 1 cm more than the search margin, or it cannot be driven to
    )
    hysteresis: float = 0.3  # [s] own: cuts changes of mind from 22 to 5 per trial at no cost in time
    reach_step: float = 0.05  # [m] own: rings searched when no tangential candidate is viable
    reach_headings: int = 16  # own: headings per position of such a ring
    reach_slack: float = 0.04  # [m] own: those poses must be this far inside the arm's reach
    room: float = 0.5  # [m] own: left to what may be moving where the base waits; both wait for each other without it
    drive_headings: int = 16  # own: arrival headings tried for a drive target that leaves its heading free
    next_goals: int = 6  # own: best poses of the next target that the local search knows
    next_poses: int = 72  # own: those to which the way on is counted: all of a ring, and a share of what is more

    def __post_init__(self) -> None:
        if not 0.0 < self.radius_min <= self.radius_max:
            raise ValueError(f"ring radii {self.radius_min} .. {self.radius_max} m: need 0 < min <= max")
        if self.positions < 1 or self.radius_step <= 0.0 or self.reach_step <= 0.0:
            raise ValueError("placement needs at least one position and positive radius steps")


@dataclasses.dataclass(frozen=True, kw_only=True)
class StaaParameters:
    """Base controller: STAA* with the paper's modifications, each of which can be switched off."""

    node_duration: float = 0.3  # [s] STAA*: Dt between nodes
    notches: int = 7  # STAA*: 7 x 7 accelerations
    cell: float = 0.05  # [m] STAA*: closed list
    heading_bins: int = 31  # STAA*: closed list
    speed_bins: int = 4  # own: two nodes in one cell are not the same when one drives and one stands
    yaw_rate_bins: int = 4  # own: the same
    epsilon: float = 1.0  # STAA*: weight of the heuristic
    growth_margin: float = 0.08  # [m] own: the global path grows obstacles by g, half the base's width and this much
    margin: float = 0.05  # [m] own: clearance that every node keeps
    margin_floor: float = 0.01  # [m] own: a robot that is inside the margin may come this near while it leaves,
    margin_cost: float = 3.0  # [s] own: and pays up to this per node for it; without a way back it would be stuck
    brake_depth: int = 2  # own: nodes up to this depth must be able to stop without a collision
    local_radius: float = 3.5  # [m] STAA*: local region (an 8 m box there), here a disc
    grid_weight: float = 0.3  # [s] own: 1 s over 0.25 m (STAA*) costs 6 s per trial beside a table
    grid_range: float = 0.12  # [m] own: clearance below which the penalty grows from 0 to 1
    penalty: str = "clearance"  # "clearance": of the footprint; "grid": STAA*, the map's proximity at the hull corners
    k_min: float = 0.1  # Paper, Sec. III-D
    k_time: float = 3.0  # [s] Paper, Sec. III-D: k = max(0.1, min(t_h / 3, 1))
    bezier_offset: float = 0.25  # Paper, Sec. III-E: control points at 25 % of the distance
    pass_distance: float = 0.15  # [m] own: "sufficiently close" (Paper, Sec. III-C, gives no number)
    pass_heading: float = 20.0 * DEG  # [rad] own: the same
    termination: str = "task"  # "task": predicted completion of the job; "pass": Paper, Sec. III-C; "reach_goal": STAA*
    goal_orientation: bool = True  # Paper, Sec. III-A
    rotation_cost: bool = True  # Paper, Sec. III-B
    bezier: bool = True  # Paper, Sec. III-E
    scale_penalty: bool = True  # Paper, Sec. III-D
    drive_on: bool = True  # own: a node from which the job gets done is judged by its way to the next target
    prediction: float = 0.0  # [s] STAA*: 1 s, for which what moves is expected to go on; the paper expects nothing
    moving_weight: float = 0.0  # [s] STAA*: 1 s per node at what moves, less with every metre; 0 from 1 m on
    steadiness: float = 0.0  # own: share of the time [s] of full yaw acceleration that is paid for it; STAA* pays none

    def __post_init__(self) -> None:
        if self.termination not in TERMINATIONS:
            raise ValueError(f"termination {self.termination!r}: use one of {TERMINATIONS}")
        if self.penalty not in PENALTIES:
            raise ValueError(f"penalty {self.penalty!r}: use one of {PENALTIES}")
        if self.notches < 3 or self.notches % 2 == 0:
            raise ValueError(f"notches {self.notches}: need an odd number of at least 3, so that 0 is one of them")
        if self.node_duration <= 0.0 or self.cell <= 0.0 or self.growth_margin <= 0.0 or self.local_radius <= 0.0:
            raise ValueError("node_duration, cell, growth_margin and local_radius must be positive")
        if min(self.prediction, self.moving_weight, self.steadiness) < 0.0:
            raise ValueError("prediction, moving_weight and steadiness must not be negative")


def growth(footprint: Footprint, p: StaaParameters) -> float:
    """g [m]: obstacles grown by it leave those ways that the base can drive along, 0.33 m for Frankie.

    Half of the width, which is across the way, and what the search keeps, localisation errs and outlines simplify away.
    """
    return 0.5 * footprint.width + p.growth_margin


def fitted(p: StaaParameters, robot: RobotProfile) -> StaaParameters:
    """The parameters of the local search for a robot; for Frankie they are as they were.

    A node is tested in its middle and at its end: between two tests the base drives its own length at most, so that
    the footprint there covers the way. The local region is left at full speed only where the base can stop after it.
    """
    body, limits = robot.footprint, robot.base
    return dataclasses.replace(
        p,
        node_duration=max(SHORTEST_NODE, min(p.node_duration, 2.0 * body.length / limits.forward_speed)),
        local_radius=max(p.local_radius, limits.stopping_way + 2.0 * body.outer),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReachParameters:
    """When an object is in reach of the arm, and how long a job takes (own, from measured pass-bys of the arm)."""

    r_min: float = 0.35  # [m] arm mount to object, horizontally
    r_max_pick: float = 0.77  # [m] measured: 0.78 at 0.5 m/s fails
    r_max_place: float = 0.88  # [m] to the bin's centre; measured: the cube is let go up to 0.135 m nearer
    azimuth_max: float = 2.6  # [rad] of the object about the mount, either way: joint 1 turns 2.9, not all round
    relative_speed: float = 0.8  # [m/s] fastest the object may pass the base: joint 1 (2.175 rad/s) does 0.76 at r_min
    dwell_pick: float = 1.3  # [s] uninterrupted time in reach of a pick: 0.5 s approach and 0.8 s closing
    dwell_place: float = 0.5  # [s] the same of a drop: 0.3 s approach and 0.2 s opening
    plan_slack: float = 0.02  # [m] plans keep this far inside the reach: poses are known to 1 cm; costs 0.5 s per trial
    plan_speed: float = 0.95  # own: and this far below the speed limit
    engaged_slack: float = 0.0  # [m] added to r_max while the arm is at the object

    def r_max(self, kind: str) -> float:
        """Largest distance [m] from arm mount to target for a "pick" or "place"."""
        return self.r_max_pick if kind == "pick" else self.r_max_place

    def passing_speed(self, forward_speed: float) -> float:
        """Speed [m/s] at which a base of this largest speed passes a target in plans."""
        return min(forward_speed, self.plan_speed * self.relative_speed)

    def dwell(self, kind: str) -> float:
        """Uninterrupted time in reach [s] of a whole "pick" or "place"."""
        return self.dwell_pick if kind == "pick" else self.dwell_place


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanningParameters:
    """All parameters of base placement and base control."""

    placement: PlacementParameters = PlacementParameters()
    staa: StaaParameters = StaaParameters()
    reach: ReachParameters = ReachParameters()


LEAST_ROOM = 0.02  # [m] beyond half the width of the footprint that a way must have, however tight


class Room(NamedTuple):
    """Room that plans keep: growth of obstacles for global paths, margin of the search, clearance of candidates [m]."""

    growth: float
    margin: float
    clearance: float


def room_for(parameters: PlanningParameters, footprint: Footprint, tightness: float) -> Room:
    """The room of a period: 0 as the parameters say, 1 down to the true footprint, for a robot that finds no way."""
    staa, placement = parameters.staa, parameters.placement
    wide = growth(footprint, staa)
    least = Room(min(wide, 0.5 * footprint.width + LEAST_ROOM), min(staa.margin, staa.margin_floor), LEAST_ROOM)
    most = Room(wide, staa.margin, placement.clearance)
    return Room(*(a + tightness * (b - a) for a, b in zip(most, least, strict=True)))
