"""The stop-then-manipulate methods of Reister et al. on this robot, and a stronger form of the best of them."""

from collections.abc import Callable
from functools import partial

from motm_twin.control.method import BaseChoices, Materials, Method, PlannerParts, Policies
from motm_twin.planning.candidates import Rule
from motm_twin.planning.types import BaseController, PlacementStrategy
from motm_twin.rivals.parking import ParkingController, StationaryParameters, standing_arm
from motm_twin.rivals.stationary_placement import FixedPoses, PoseRule, StationaryPlacement, Terms

MANIPULABILITY = Terms(current=False, onward=False)
FIXED_TERMS = Terms(current=False, onward=False, nearest_at_bins=True)
GREEDY_TERMS = Terms(current=True, onward=False)
ALL_TERMS = Terms(current=True, onward=True)
_SOURCE = "Reister, Grotz and Asfour, RA-L 2022; Paper, Sec. VI"
_STANDING = (
    "It drives with the same base controller and limits as motm, whose search ends at the pose. As soon as a stop at "
    "full deceleration would end within 0.15 m of the pose and with 90 % of its manipulability, it does so: STAA* "
    "alone creeps towards a pose. The arm is stowed until the base is told to stand, the fingers wait until it does, "
    "and it leaves when the object is lifted 3 cm or let go. A pose that is no longer free or in reach is chosen anew."
)
_MAP = (
    "Manipulability is sqrt(det(J J^T)) from inverse kinematics of this arm at the height of the object or the bin's "
    "rim: the best over joint 7, both elbows and wrists and the faces of the cube, within joint limits and clear of "
    "the table. Their measure and weights are not known to us. "
)
_COST = "A pose without manipulability costs 5 s more than the best one; ways count their seconds, weight 1."


def stationary(
    terms: Terms,
    first: Callable[[PlannerParts], PoseRule] | None = None,
    parameters: StationaryParameters | None = None,
) -> Callable[[Materials, Rule], PlacementStrategy]:
    """Placement by these terms of the cost; ``first``: poses that are wanted before all others."""

    def placement(materials: Materials, candidates: Rule) -> PlacementStrategy:
        parts = materials.parts
        return StationaryPlacement(parts, materials.graphs, terms, parameters, None if first is None else first(parts))

    return placement


def parking(
    materials: Materials, policies: Policies, *, overlap: bool = False,
    parameters: StationaryParameters | None = None,
) -> BaseController:  # fmt: skip
    """A base that stands at the pose; ``overlap``: the arm comes early."""
    return ParkingController(
        materials.parts, materials.graphs, overlap=overlap, parameters=parameters, still=materials.ahead
    )


IRM = Method(
    name="irm",
    title="IRM",
    summary="Stops at the pose with the highest manipulability, however far away it is.",
    source=_SOURCE,
    known="The pose is chosen by a manipulability metric only, without navigation costs; 192.9 s on their robot.",
    chosen=(
        "Of poses within 1 % of the best, the one that faces the target most: the heading hardly changes the measure. "
        f"{_MAP}{_STANDING}"
    ),
    planner=BaseChoices(placement=stationary(MANIPULABILITY), controller=parking),
    arm=standing_arm,
)

FIXED_SET = Method(
    name="fixed_set",
    title="Fixed set",
    summary="Stops at that of seven fixed poses round the table which has the highest manipulability.",
    source=_SOURCE,
    known="Seven fixed candidates spaced around and facing the object table, chosen among by manipulability.",
    chosen=(
        "The seven are equally spaced along a line 10 cm inside the table's edge, at right angles to the edge; their "
        "distance and first place are those with which the worst point of the line is served best. At a bin it takes "
        "the nearest of seven poses that face the bin. Where none is free and near enough, it does as irm; it measures "
        "and stops as irm does."
    ),
    planner=BaseChoices(placement=stationary(FIXED_TERMS, first=FixedPoses), controller=parking),
    arm=standing_arm,
)

GREEDY = Method(
    name="greedy",
    title="Greedy",
    summary="Stops at the pose with the best sum of manipulability and driving cost.",
    source=_SOURCE,
    known="Manipulability and the navigation cost to the candidate.",
    chosen=f"{_COST} It measures and stops as irm does.",
    planner=BaseChoices(placement=stationary(GREEDY_TERMS), controller=parking),
    arm=standing_arm,
)

SEQUENTIAL = Method(
    name="sequential",
    title="Sequential",
    summary="Stops at the pose with the best sum of manipulability and driving cost, there and on to the next target.",
    source=_SOURCE,
    known=(
        "A weighted cost of manipulability, navigation to the candidate and on to the next location; 172.3 s on their "
        "robot, of which 40 s are an allowance for grasps."
    ),
    chosen=(
        f"{_COST} The way on ends at the pose of the next target that is best by the same cost. It measures and stops "
        "as irm does."
    ),
    planner=BaseChoices(placement=stationary(ALL_TERMS), controller=parking),
    arm=standing_arm,
)

SEQUENTIAL_OVERLAP = Method(
    name="sequential_overlap",
    title="Sequential, arm early",
    summary="Like sequential, but the arm reaches out while the base arrives; the fingers close once it stands.",
    source="own, after Reister, Grotz and Asfour",
    known=(
        "The hand arrives as the base does, says the paper of Reister et al. (Sec. II); not how, nor in which times."
    ),
    chosen="The arm starts by the rule of motm, with the time until the base stands. All else is as in sequential.",
    planner=BaseChoices(placement=stationary(ALL_TERMS), controller=partial(parking, overlap=True)),
    arm=standing_arm,
)

STATIONARY = (FIXED_SET, IRM, GREEDY, SEQUENTIAL, SEQUENTIAL_OVERLAP)
