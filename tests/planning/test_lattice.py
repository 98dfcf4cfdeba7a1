"""Leaving a place where the robot cannot turn on the spot."""

import math

import numpy as np
import pytest
from idealised import polygons, step_unicycle, world_of

from motm_twin.model.profile import RobotProfile
from motm_twin.planning import search_memory
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.controller import StaaController
from motm_twin.planning.cost_to_go import FAR
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.lattice import ANGLES, BLUR, CELL, HEADINGS, LENGTHS, NO_LATTICE, STEPS, cells_of, lattice_cost
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.placement import NextTargetPlacement
from motm_twin.planning.types import BasePlan, BaseProblem, SearchBudget, Target

PERIOD = 0.05
WORLD = world_of(polygons(boxes=True))  # Experiment 1a: one box stands 10 cm from the table
POCKET = (3.16, 0.89, 2.11)  # the front at the table, that box on the right
BIN = (4.25, -1.29)
MARGIN = PlanningParameters().staa.margin


class Listening(KeepPlans):
    """Keeps what the lattice was computed from."""

    def lattice(self, problem, s, world, cells, memory):
        self.given, self.found = world, super().lattice(problem, s, world, cells, memory)
        return self.found


def drive(controller: StaaController, periods: int, pose=POCKET) -> list[BasePlan]:
    """From rest towards the bin, period by period."""
    pose, twist = np.array(pose), np.zeros(2)
    placement, plans = NextTargetPlacement(RobotProfile(), PlanningParameters(), candidates=EveryRing()), []
    for k in range(periods):
        problem = BaseProblem(
            time=k * PERIOD, world=WORLD, pose=pose, twist=twist, engaged=False,
            target=Target(kind="place", name="bin", position=np.array(BIN), dwell=0.5), next_target=None,
        )  # fmt: skip
        plans.append(controller.plan(problem, placement.place(problem), SearchBudget(expansions=300)))
        pose, twist = step_unicycle(pose, twist, plans[-1].acceleration, PERIOD)
    return plans


def tight_poses(count: int) -> list[tuple[float, float, float]]:
    """Poses before the table that have 3 to 9 cm of clearance."""
    rng, field, body = np.random.default_rng(7), field_of(WORLD), body_of(RobotProfile().footprint)
    found: list[tuple[float, float, float]] = []
    while len(found) < count:
        pose = (rng.uniform(2.0, 4.8), rng.uniform(0.2, 1.2), rng.uniform(-math.pi, math.pi))
        if 0.03 < clearances(np.array([pose]), 1.0, field, body)[0] < 0.09:
            found.append(pose)
    return found


@pytest.fixture(scope="module")
def lattice() -> tuple[search_memory.LatticeCosts, search_memory.World]:
    listening = Listening()
    drive(StaaController(RobotProfile(), PlanningParameters(), commitment=listening), 2)
    assert listening.found is not NO_LATTICE
    return listening.found, listening.given


def test_searches_arrive_sooner():
    """A search of 300 expansions that knows PathRTR only does not get out of many a place for more than a second."""
    without = with_lattice = 0
    for pose in tight_poses(16):
        without += sum(
            p.status == "aborted" for p in drive(StaaController(RobotProfile(), PlanningParameters()), 40, pose)
        )
        plans = drive(StaaController(RobotProfile(), PlanningParameters(), commitment=KeepPlans()), 40, pose)
        with_lattice += sum(p.status == "aborted" for p in plans)
    assert without > 60
    assert with_lattice < 0.35 * without


def test_its_costs_are_those_of_free_ways_on_the_lattice(lattice):
    """No step on the lattice and no turn leads to one that is cheaper by more than what it takes; most by just that."""
    found, given = lattice
    rates = given.table.rates
    known = np.argwhere(found.value < FAR)
    assert len(known) > 300
    x, y = found.x + (known[:, 1] + 0.5) * CELL, found.y + (known[:, 0] + 0.5) * CELL
    poses = np.column_stack((x, y, ANGLES[known[:, 2]]))
    assert (clearances(poses, 1.0, given.field, given.body) >= MARGIN - BLUR - 1e-9).all()
    first = 0  # from which a step leads to where the robot can turn on the spot
    for j, i, k in known:
        ways = [(i + way * STEPS[k, 0], j + way * STEPS[k, 1], k, LENGTHS[k] * rate)
                for way, rate in ((1, rates.front), (-1, rates.back))]  # fmt: skip
        for c in ((k + 1) % HEADINGS, (k - 1) % HEADINGS):
            ways.append((i, j, c, abs(math.remainder(ANGLES[c] - ANGLES[k], 2.0 * math.pi)) * rates.turn))
        count = cells_of(given.body)
        inside = [way for way in ways if 0 <= way[0] < count and 0 <= way[1] < count]
        onward = min((cost + found.value[b, a, c] for a, b, c, cost in inside), default=FAR)
        assert found.value[j, i, k] <= onward + 1e-9
        first += found.value[j, i, k] < onward - 1e-9
    assert 0 < first < len(known) / 2


def test_leaving_takes_longer_than_the_straight_way(lattice):
    found, given = lattice
    x, y, heading = POCKET
    turn_rate = given.table.rates.turn
    straight = math.dist((x, y), BIN) / 0.5 - 0.8 / 0.5
    inside = lattice_cost(x, y, heading, turn_rate, found)
    assert straight + 0.5 < inside < straight + 8.0
    assert lattice_cost(x, y, heading + 2.0 * math.pi, turn_rate, found) == pytest.approx(inside)
    assert lattice_cost(x - 3.0, y, heading, turn_rate, found) == FAR  # beyond the lattice PathRTR holds
    assert lattice_cost(x - 0.4, y - 0.9, heading, turn_rate, found) == FAR  # and where it can turn on the spot


@pytest.mark.parametrize("pose", [(2.0, 0.0, 1.0), (3.6, -0.2, -2.0)])
def test_where_it_can_turn_on_the_spot_there_is_none(pose):
    listening = Listening()
    drive(StaaController(RobotProfile(), PlanningParameters(), commitment=listening), 3, pose=pose)
    assert listening.found is NO_LATTICE
