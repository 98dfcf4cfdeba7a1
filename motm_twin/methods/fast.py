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


def keep_plans(materials: Materials) -> KeepPlans:
    """A plan is kept until a better one is found."""
    return KeepPlans(materials.parts.parameters.commitment)


FAST = Method(
    name="fast",
    title="MotM, fast",
    summary="The paper's method, which keeps to its plans, considers all rings, and leaves out what moves far away.",
    source="own",
    chosen=(
        "A plan is kept until a search finds one that is cheaper than the rest of it. Candidates lie on all rings of "
        "0.6 to 0.8 m, and the chosen one stays while it is free. Dynamic obstacles count from 2.0 m on. Where they "
        "leave a target no candidate, the robot waits beside the one that it can be at soonest. Where it creeps and "
        "cannot turn on the spot, costs come from a lattice on which the footprint is free. Every node tries 5 x 5 "
        "accelerations, for half the computing, and of plans of equal time the steadier one is taken."
    ),
    parameters={"bezier_offset": 0.1, "notches": 5, "steadiness": 0.02},
    planner=BaseChoices(view=WithoutFarMovers, candidates=every_ring, commitment=keep_plans),
)
