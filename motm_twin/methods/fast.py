"""`fast`: the paper's rule that keeps to its plans, and goes round what moves only when it is near."""

import msgspec

from motm_twin.control.method import BaseChoices, Materials, Method
from motm_twin.model.known import KnownWorld
from motm_twin.model.state import HasState
from motm_twin.perception.movers import MoverParameters, standing
from motm_twin.perception.still_map import StandingMap, StillMap
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.types import BaseProblem


class WithoutFarMovers:
    """The map without dynamic obstacles that are far away: they will be elsewhere when the robot comes there."""

    def __init__(self, known: KnownWorld) -> None:
        self._movers = MoverParameters()
        self.standing = StandingMap(known)
        self.still = StillMap(known, self._movers)  # without the near ones, too

    def of(self, problem: BaseProblem) -> BaseProblem:
        """The problem in that map; the same one when nothing moves far away."""
        world = problem.world
        far = world.movers[world.movers[:, 5] == 0.0]
        without = self.standing.without(world, standing(world, far, self._movers))
        return problem if without is world else msgspec.structs.replace(problem, world=without)

    def memory(self) -> dict[str, HasState]:
        """Both maps."""
        return {"standing": self.standing, "still": self.still}


def every_ring(materials: Materials) -> EveryRing:
    """Candidates on all rings; where none is viable, the robot waits beside what moves."""
    view = materials.view
    return EveryRing(view.still if isinstance(view, WithoutFarMovers) else None)


FAST = Method(
    name="fast",
    title="MotM, fast",
    summary="The paper's method, which keeps to its plans, considers all rings, and leaves out what moves far away.",
    source="own",
    chosen=(
        "A plan is kept, period after period, until one is found that is cheaper than what is left of it: a search "
        "that starts anew finds another plan of about the same cost each time, and between obstacles the robot "
        "followed none of them. Nothing that costs as much as what is left of a plan is looked at. Candidates on all "
        "rings of 0.6 to 0.8 m, not on the smallest that has a viable one; "
        "what the base loses by passing more slowly where the arm reaches for a shorter time counts, and the chosen "
        "one stays while it is free at all. What has moved in the last 2 s is an obstacle of placement and driving "
        "from 2.0 m on, until it is 2.6 m away; until then it will have moved on. Where what moves leaves a target no "
        "candidate, the robot waits beside the one that it can be at soonest; the free place closest to the target is "
        "often on the other side of the table. A robot that creeps while its plans do not arrive, since something is "
        "nearer to the axle than a corner of the footprint, cannot turn on the spot as PathRTR does everywhere: round "
        "it the costs of the search are those of a lattice (16 headings, 0.1 m) on which the footprint is free. Not "
        "where something moves within 1.5 m, which will be gone before the robot is out. "
        "The control points of the Bezier curves are at 10 % of the distance. Every node of the search tries 5 x 5 "
        "accelerations, not 7 x 7, for half the computing: no slower where trials can tell. "
        "Of plans that take about as long it takes the steadier one: 2 % of the time of yaw acceleration are added to "
        "its cost, and one of the five ends straight ahead. "
        "Tried and no better: to expect what moves on its course in the search, with the global path round where the "
        "robot would meet it (both then wait for each other); to place the base where something near drives now; to "
        "wait beside a place that something moving has taken when all others are 4 s farther (exp2, seeds 0 to 49: "
        "2.1 s longer, +- 3.3); instead of waiting to go where the arm reaches from another heading, if that is no "
        "farther (exp2, seeds 0 to 9: 1.1 s longer); to count the way from the next target to the one after it, too "
        "(Experiment 1, seeds 0 to 49: 0.2 s longer, +- 0.4); that lattice wherever the robot cannot turn on the spot"
        " (1a, seeds 100 to 149: 2.1 s longer, +- 0.7), under way too (the same: 1.4 s, +- 1.4), or beside what moves"
        " (exp2, seeds 100 to 149: 1.5 s longer, of chance); ten times as many expansions (there, no shorter); a "
        "heuristic with a weight of 1.2 (0.8 s longer, +- 0.3)."
    ),
    parameters={"bezier_offset": 0.1, "notches": 5, "steadiness": 0.02},
    planner=BaseChoices(view=WithoutFarMovers, candidates=every_ring, commitment=KeepPlans),
)
