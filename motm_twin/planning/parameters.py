"""Every number of base placement and base control, once: symbol, unit, and where it comes from.

"Paper" is the reactive-base-control paper, "STAA*" the local planner that it modifies, "own" a choice of this project.
"""

import dataclasses
from typing import Annotated, NamedTuple

from motm_twin.model.number import OWN, STAA, Number, Slider, paper
from motm_twin.model.plant import PERIOD
from motm_twin.model.profile import DEG, Footprint, RobotProfile

TERMINATIONS = ("task", "pass", "reach_goal")
PENALTIES = ("clearance", "grid")


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlacementParameters:
    """Base placement (Paper, Sec. IV)."""

    next_weight: Annotated[float, Number("", paper("IV"), "weight of C_iN, the cost on to the next target"),
        Slider("Weight of the next target", "Base placement",
            "How much the drive on to the next target counts when a place is chosen; 0 ignores it.", (0.0, 3.0, 0.05),
            paper=1.05)] = 1.05  # fmt: skip
    radius_min: Annotated[float, Number("m", paper("IV"), "radius of the first ring of candidates"),
        Slider("Smallest ring", "Base placement", "Radius of the first ring of candidates round the target.",
            (0.45, 0.7, 0.05), paper=0.6)] = 0.60  # fmt: skip
    radius_max: Annotated[float, Number("m", paper("IV"), "radius of the last ring of candidates"),
        Slider("Largest ring", "Base placement",
            "Radius of the last ring, tried when the smaller ones have no free candidate.", (0.7, 0.95, 0.05),
            paper=0.8)] = 0.80  # fmt: skip
    positions: Annotated[int,
        Number("", paper("IV"), "positions on a ring, 10 deg apart, with two tangential headings each"),
        Slider("Positions on a ring", "Base placement",
            "Positions on each ring, with two tangential headings each; 36 are 10 degrees apart.", (12, 48, 4),
            paper=36.0)] = 36  # fmt: skip
    hysteresis: Annotated[float,
        Number("s", OWN, "cost advantage for a new candidate: cuts changes of choice from 22 to 5 per trial at no "
               "cost in time"),
        Slider("Hysteresis of the choice", "Base placement",
            "A new candidate replaces the chosen one only if it is cheaper by this much.",
            (0.0, 2.0, 0.1))] = 0.3  # fmt: skip
    clearance: Annotated[float,
        Number("m", OWN, "clearance of a candidate: 1 cm more than the search's margin, or it cannot be driven to"),
        Slider("Clearance of a candidate", "Safety", "Free space that the base needs round it at a candidate pose.",
            (0.06, 0.2, 0.01))] = 0.06  # fmt: skip
    radius_step: Annotated[
        float, Number("m", OWN, "step between rings; 0.02 finds the same candidates in the shipped scenes")
    ] = 0.05
    headings: Annotated[int, Number("", OWN, "headings tried at a position that allows any")] = 16
    room: Annotated[
        float, Number("m", OWN, "clearance of a waiting base from obstacles that may move, or both wait for each other")
    ] = 0.5
    same_place: Annotated[
        float, Number("m", OWN, "distance up to which a candidate is the same as the last choice")
    ] = 0.06
    same_heading: Annotated[
        float, Number("rad", OWN, "turn up to which a candidate is the same as the last choice")
    ] = 0.15
    clearly_closer: Annotated[
        float, Number("m", OWN, "where no candidate serves, a free place this much closer replaces the last choice")
    ] = 0.5
    beside_round: Annotated[
        float, Number("m", OWN, "largest distance of a waiting place from the target, plus the base's size")
    ] = 2.1
    avoided_cost: Annotated[
        float,
        Number("s", OWN, "added to a candidate near a pose where arm or base failed before; the arm tried for 6 s"),
    ] = 10.0
    next_goals: Annotated[int, Number("", OWN, "cheapest poses of the next target that the local search knows")] = 6

    @property
    def ring_poses(self) -> int:
        """Candidates on a ring; also the most that are kept of the next target, and of places to wait at."""
        return 2 * self.positions

    def __post_init__(self) -> None:
        if not 0.0 < self.radius_min <= self.radius_max:
            raise ValueError(f"ring radii {self.radius_min} .. {self.radius_max} m: need 0 < min <= max")
        if self.positions < 1 or self.radius_step <= 0.0:
            raise ValueError("placement needs at least one position and a positive radius step")


@dataclasses.dataclass(frozen=True, kw_only=True)
class StaaParameters:
    """Base controller: STAA* with the paper's modifications, each of which can be switched off."""

    local_radius: Annotated[float, Number("m", STAA, "radius of the local region of the search; in STAA* a box of 8 m"),
        Slider("Local region", "Base control",
            "Radius of the area that the local search covers; beyond it the robot follows the global path.",
            (1.5, 5.0, 0.25))] = 3.5  # fmt: skip
    node_duration: Annotated[float, Number("s", STAA, "time between two nodes of the local search", symbol="Dt"),
        Slider("Time step of the search", "Base control", "Time between two nodes of the local search.",
            (0.2, 0.5, 0.05))] = 0.3  # fmt: skip
    notches: Annotated[int, Number("", STAA, "accelerations per axis tried at a node: 7 linear, 7 angular"),
        Slider("Accelerations tried", "Base control",
            "Linear accelerations tried at each node, from braking to speeding up; as many angular ones.",
            (5, 7, 2), odd=True)] = 7  # fmt: skip
    epsilon: Annotated[float, Number("", STAA, "weight of the heuristic", symbol="epsilon"),
        Slider("Weight of the heuristic", "Base control",
            "Above 1 the search heads straighter for the goal: it finds a motion sooner, but a worse one.",
            (0.5, 3.0, 0.1))] = 1.0  # fmt: skip
    cell: Annotated[float, Number("m", STAA, "position cell of the closed list")] = 0.05
    heading_bins: Annotated[int, Number("", STAA, "heading bins of the closed list")] = 31
    speed_bins: Annotated[
        int,
        Number(
            "", OWN, "speed bins, and yaw rate bins, of the closed list: a driving node differs from a standing one"
        ),
    ] = 4
    grid_weight: Annotated[float,
        Number("s", STAA, "cost of a node at an obstacle, with either penalty; 1 s over 0.25 m costs 6 s per trial at "
               "a table"),
        Slider("Proximity penalty", "Base control", "Extra time charged to a node right beside an obstacle.",
            (0.0, 2.0, 0.05), paper=1.0)] = 0.3  # fmt: skip
    grid_range: Annotated[float, Number("m", OWN, "clearance below which the clearance penalty grows from 0 to 1"),
        Slider("Range of the penalty", "Base control",
            "The penalty starts at this clearance and grows as the clearance shrinks.",
            (0.04, 0.4, 0.01))] = 0.12  # fmt: skip
    prediction: Annotated[float,
        Number("s", STAA, "prediction time of moving obstacles: 1 s in STAA*, 0 in the paper"),
        Slider("Prediction of moving obstacles", "Base control",
            "How long the local search expects them to keep moving as they do; 0 treats them as standing.",
            (0.0, 2.0, 0.1), paper=0.0)] = 0.0  # fmt: skip
    moving_weight: Annotated[float,
        Number("s", STAA, "cost of a node at a predicted moving obstacle, falling to 0 at 1 m; 1 s in STAA*"),
        Slider("Penalty near predicted obstacles", "Base control",
            "Extra time charged to a node at a predicted obstacle; it falls with distance and is 0 from 1 m on.",
            (0.0, 2.0, 0.1), paper=0.0)] = 0.0  # fmt: skip
    risk_weight: Annotated[float,
        Number("s", OWN, "cost of a node where a dynamic obstacle surely is; 0: they are obstacles where they are"),
        Slider("Cost of an encounter", "Base control",
            "Extra time charged to a node where somebody is expected, times the probability; 0 predicts nobody.",
            (0.0, 20.0, 0.5), paper=0.0)] = 0.0  # fmt: skip
    courtesy_weight: Annotated[float,
        Number("", OWN, "weight of time in the stopping way of an obstacle that yields; a fifth for others"),
        Slider("Courtesy", "Base control",
            "How much the time counts that others lose when the plan enters the space they need to stop.",
            (0.0, 3.0, 0.1), paper=0.0)] = 0.0  # fmt: skip
    steadiness: Annotated[float,
        Number("", OWN, "cost of changing the yaw rate: share of its time [s] at full acceleration; STAA* has none"),
        Slider("Steadiness", "Base control",
            "Extra cost of changing the yaw rate, as a share of the time it takes; more makes the base wriggle less.",
            (0.0, 0.2, 0.01), paper=0.0)] = 0.0  # fmt: skip
    penalty: Annotated[str,
        Number("", STAA, "measure of proximity. clearance: that of the footprint; grid: the map's grid at the hull "
               "corners, as in STAA*"),
        Slider("Penalty measured by", "Base control",
            "Clearance of the whole footprint, or the map's blurred grid at the corners of the hull.",
            choices=PENALTIES, paper="grid")] = "clearance"  # fmt: skip
    pass_distance: Annotated[float,
        Number("m", OWN, 'a path this near to the candidate passes it: "sufficiently close" (Paper, Sec. III-C, gives '
               'no number)'),
        Slider("Passing distance", "Base control",
            "A path that comes this near to the candidate passes it.",
            (0.05, 0.5, 0.01))] = 0.15  # fmt: skip
    pass_heading: Annotated[float, Number("rad", OWN, "largest heading error of a path that passes the candidate"),
        Slider("Passing heading", "Base control",
            "A passing path may be off the candidate's heading by this much.", (5.0, 60.0, 1.0),
            degrees=True)] = 20.0 * DEG  # fmt: skip
    goal_orientation: Annotated[bool,
        Number("", paper("III-A"), "the local search aims for the candidate's heading, too"),
        Slider("Goal orientation", "Modifications",
            "The local search aims for the candidate's heading, not only its position.",
            paper=True)] = True  # fmt: skip
    rotation_cost: Annotated[bool, Number("", paper("III-B"), "the global path pays for turning"),
        Slider("Rotation cost", "Modifications", "The global path pays for turning, as in PathRTR.",
            paper=True)] = True  # fmt: skip
    termination: Annotated[str,
        Number("", paper("III-C"), "end of the search. task: predicted end of the job; pass: as in the paper; "
               "reach_goal: as in STAA*"),
        Slider("When the search ends", "Modifications",
            "task: at the predicted end of the job; pass: as a path passes the candidate; reach_goal: at a stop there.",
            choices=TERMINATIONS, paper="pass")] = "task"  # fmt: skip
    drive_on: Annotated[bool,
        Number("", OWN, "a node with the target in reach is judged by its way to the next target"),
        Slider("Drive on to the next target", "Modifications",
            "A motion that gets the job done is judged by how it goes on to the next target.",
            paper=False)] = True  # fmt: skip
    scale_penalty: Annotated[bool, Number("", paper("III-D"), "the proximity penalty fades near the goal"),
        Slider("Fade the penalty", "Modifications",
            "The proximity penalty fades near the goal: k = max(k_min, min(t_h / k_time, 1)).",
            paper=True)] = True  # fmt: skip
    k_min: Annotated[float, Number("", paper("III-D"), "least scale k of the proximity penalty", symbol="k"),
        Slider("Penalty left at the goal", "Modifications", "Share of the proximity penalty that remains at the goal.",
            (0.0, 1.0, 0.05), paper=0.1)] = 0.1  # fmt: skip
    k_time: Annotated[float,
        Number("s", paper("III-D"), "time to the goal from which the penalty fades: k = max(0.1, min(t_h / 3, 1))"),
        Slider("Fading time", "Modifications", "How long before the goal the penalty starts to fade.",
            (0.5, 10.0, 0.5), paper=3.0)] = 3.0  # fmt: skip
    bezier: Annotated[bool,
        Number("", paper("III-E"), "nodes near the goal are judged by the time of a Bezier curve to it"),
        Slider("Bezier heuristic", "Modifications",
            "Nodes near the goal are judged by the time of a smooth curve that ends there.",
            paper=True)] = True  # fmt: skip
    bezier_offset: Annotated[float,
        Number("", paper("III-E"), "control points of the Bezier curve lie at 25 % of the distance of its ends"),
        Slider("Bezier control points", "Modifications",
            "Their distance from the ends of the curve, as a share of the straight distance.", (0.05, 0.5, 0.05),
            paper=0.25)] = 0.25  # fmt: skip
    margin: Annotated[float, Number("m", OWN, "clearance that every node keeps from obstacles"),
        Slider("Clearance of the local plan", "Safety", "Free space that every node of the local search keeps.",
            (0.03, 0.05, 0.01))] = 0.05  # fmt: skip
    margin_floor: Annotated[
        float,
        Number(
            "m", OWN, "clearance to which a robot inside the margin may come while it leaves: else it would be stuck"
        ),
    ] = 0.01
    margin_cost: Annotated[float, Number("s", OWN, "largest cost of a node for being inside the margin")] = 3.0
    brake_depth: Annotated[
        int, Number("", OWN, "nodes up to this depth of the search must be able to stop without a collision")
    ] = 2
    growth_margin: Annotated[float,
        Number("m", OWN, "for global paths obstacles grow by g, half the base's width and this much"),
        Slider("Clearance of the global path", "Safety",
            "For the global path, obstacles grow by half the width of the base plus this.",
            (0.03, 0.2, 0.01))] = 0.08  # fmt: skip

    def __post_init__(self) -> None:
        if self.termination not in TERMINATIONS:
            raise ValueError(f"termination {self.termination!r}: use one of {TERMINATIONS}")
        if self.penalty not in PENALTIES:
            raise ValueError(f"penalty {self.penalty!r}: use one of {PENALTIES}")
        if self.notches < 3 or self.notches % 2 == 0:
            raise ValueError(f"notches {self.notches}: need an odd number of at least 3, so that 0 is one of them")
        if self.node_duration <= 0.0 or self.cell <= 0.0 or self.growth_margin <= 0.0 or self.local_radius <= 0.0:
            raise ValueError("node_duration, cell, growth_margin and local_radius must be positive")
        if min(self.prediction, self.moving_weight, self.risk_weight, self.courtesy_weight, self.steadiness) < 0.0:
            raise ValueError("prediction, steadiness and the weights of others must not be negative")


def growth(footprint: Footprint, p: StaaParameters) -> float:
    """Growth g [m] of obstacles that leaves open the ways along which the base can drive, 0.33 m for Frankie.

    Half of the width, plus room for the margin of the search, errors of localisation and simplified outlines.
    """
    return 0.5 * footprint.width + p.growth_margin


def longest_node(robot: RobotProfile) -> float:
    """The longest duration [s] of a node of any search, 2.8 s for Frankie.

    A node is tested in its middle and at its end: between two tests the base drives its own length at most, so that
    the footprint there covers the way.
    """
    return max(PERIOD, 2.0 * robot.footprint.length / robot.base.full_speed)


def fitted(p: StaaParameters, robot: RobotProfile) -> StaaParameters:
    """The parameters of the local search for a robot; for Frankie they are unchanged.

    The local region has room for the base to stop from full speed.
    """
    body, limits = robot.footprint, robot.base
    return dataclasses.replace(
        p,
        node_duration=max(PERIOD, min(p.node_duration, longest_node(robot))),
        local_radius=max(p.local_radius, limits.stopping_way + 2.0 * body.outer),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class ReachParameters:
    """Reach of the arm, and the time that a job takes in reach (own, from measured passes of the arm)."""

    r_min: Annotated[float, Number("m", OWN, "least horizontal distance from arm mount to object")] = 0.35
    r_max_pick: Annotated[
        float, Number("m", OWN, "largest distance from mount to object for a pick; measured: 0.78 at 0.5 m/s fails")
    ] = 0.77
    r_max_place: Annotated[
        float,
        Number(
            "m",
            OWN,
            "largest distance from mount to the bin's centre; measured: the cube is let go up to 0.115 m nearer",
        ),
    ] = 0.88
    azimuth_max: Annotated[
        float,
        Number(
            "rad", OWN, "largest azimuth of the object about the mount, either way: joint 1 turns 2.9, not all round"
        ),
    ] = 2.6
    relative_speed: Annotated[
        float, Number("m/s", OWN, "largest speed of the object past the base: joint 1 (2.175 rad/s) does 0.76 at r_min")
    ] = 0.8
    dwell_pick: Annotated[
        float, Number("s", OWN, "uninterrupted time in reach that a pick needs: 0.5 s approach and 0.8 s closing")
    ] = 1.3
    dwell_place: Annotated[
        float, Number("s", OWN, "uninterrupted time in reach that a place needs: 0.3 s approach and 0.2 s opening")
    ] = 0.5
    plan_slack: Annotated[
        float, Number("m", OWN, "narrows the reach in plans, twice off the rings: poses are known to 1 cm")
    ] = 0.02
    plan_speed: Annotated[float, Number("", OWN, "share of relative_speed that plans allow")] = 0.95

    def r_max(self, kind: str) -> float:
        """Largest distance [m] from arm mount to target for a "pick" or "place"."""
        return self.r_max_pick if kind == "pick" else self.r_max_place

    def passing_speed(self, forward_speed: float) -> float:
        """Speed [m/s] at which plans pass a target, for a base with this largest speed."""
        return min(forward_speed, self.plan_speed * self.relative_speed)

    def dwell(self, kind: str) -> float:
        """Uninterrupted time in reach [s] of a whole "pick" or "place"."""
        return self.dwell_pick if kind == "pick" else self.dwell_place


@dataclasses.dataclass(frozen=True, kw_only=True)
class CommitmentParameters:
    """Limits within which a kept plan is still followed, and the speed below which a lattice may be needed."""

    late: Annotated[
        float, Number("s", OWN, "a job may end this much after its plan, the target in reach: poses are known to 1 cm")
    ] = 0.1
    moved: Annotated[float, Number("m", OWN, "motion of the target after which a kept plan is dropped")] = 0.1
    follows: Annotated[
        float,
        Number(
            "m, rad", OWN, "deviation from a plan that drops it: localisation is off by 0.06 m and 0.04 rad at most"
        ),
    ] = 0.15
    follows_speed: Annotated[
        float,
        Number(
            "", OWN, "deviation from a plan's speed or yaw rate that drops it, as a share of the largest; usually 2 %"
        ),
    ] = 0.06
    creeps: Annotated[
        float,
        Number(
            "", OWN, "share of the top speed below which a robot whose plan does not arrive may be in a tight place"
        ),
    ] = 0.3


@dataclasses.dataclass(frozen=True, kw_only=True)
class ForesightParameters:
    """Dynamic obstacles that do not yield, the costs of meeting them, and the search for a way among them."""

    quick: Annotated[
        float,
        Number(
            "m/s",
            OWN,
            "speed above which a dynamic obstacle is not expected to yield: it needs more than a metre to stop",
        ),
    ] = 0.6
    taken: Annotated[float, Number("", OWN, "probability from which a place counts as taken, and is waited for")] = 0.3
    doubt: Annotated[
        float, Number("s", OWN, "cost of a place that is surely taken on arrival; half for the one chosen before")
    ] = 2.0
    longer: Annotated[
        float,
        Number("", OWN, "factor on the node duration in the search among dynamic obstacles, which looks 6 s ahead"),
    ] = 2.0
    width: Annotated[int, Number("", OWN, "nodes per layer that the search among dynamic obstacles expands")] = 60


@dataclasses.dataclass(frozen=True, kw_only=True)
class EvasionParameters:
    """When and how a method moves out of the way of dynamic obstacles (`planning/evasion.py`)."""

    horizon: Annotated[float, Number("s", OWN, "prediction horizon of an evasion")] = 3.0
    room: Annotated[float, Number("m", OWN, "room given to a dynamic obstacle now; it grows with time")] = 0.10
    least: Annotated[
        float, Number("s", OWN, "time in the room of dynamic obstacles, weighted by depth, that begins an evasion")
    ] = 0.15
    stays_out: Annotated[
        float, Number("s", OWN, "time in the room of dynamic obstacles from which an evasion is kept up")
    ] = 0.02
    engaged: Annotated[
        float,
        Number(
            "s",
            OWN,
            "time in the room of dynamic obstacles that begins an evasion while the arm is at an object: about a touch",
        ),
    ] = 0.6
    gain: Annotated[float, Number("s", OWN, "an evasion must be better than the plan by this")] = 0.1
    first: Annotated[float, Number("s", OWN, "duration of the first of an evasion's two twists")] = 1.0
    travel: Annotated[float, Number("s/m", OWN, "cost of the way of an evasion: no farther than needed")] = 0.03


@dataclasses.dataclass(frozen=True, kw_only=True)
class PlanningParameters:
    """All parameters of base placement and base control."""

    placement: PlacementParameters = PlacementParameters()
    staa: StaaParameters = StaaParameters()
    reach: ReachParameters = ReachParameters()
    commitment: CommitmentParameters = CommitmentParameters()
    foresight: ForesightParameters = ForesightParameters()
    evasion: EvasionParameters = EvasionParameters()


LEAST_ROOM = 0.02  # [m] least room round the footprint at candidates and along global paths


class Room(NamedTuple):
    """Room that plans keep: growth of obstacles for global paths, margin of the search, clearance of candidates [m]."""

    growth: float
    margin: float
    clearance: float


def room_for(parameters: PlanningParameters, footprint: Footprint, tightness: float) -> Room:
    """The room of a period; ``tightness`` 0: as in the parameters, 1 (for a robot that finds no way): the least."""
    staa, placement = parameters.staa, parameters.placement
    wide = growth(footprint, staa)
    least = Room(min(wide, 0.5 * footprint.width + LEAST_ROOM), min(staa.margin, staa.margin_floor), LEAST_ROOM)
    most = Room(wide, staa.margin, placement.clearance)
    return Room(*(a + tightness * (b - a) for a, b in zip(most, least, strict=True)))
