"""Leaving an overlap: the quickest motion during which nothing gets deeper into the footprint."""

import math

import msgspec
import numpy as np
import pytest

from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.collision import body_of, clearances, field_of
from motm_twin.planning.controller import StaaController
from motm_twin.planning.escape import depth_of, find_escape, overlapping_cells, ways_to_room
from motm_twin.planning.parameters import PlanningParameters
from motm_twin.planning.types import BaseProblem, Placement, PlanStatus, SearchBudget, Target

PROFILE = RobotProfile()
BODY = body_of(PROFILE.footprint)


def world_of(*faces):
    """A map whose occupied cells are faces (x_low, y_low, x_high, y_high) [m], as a lidar sees them."""
    centres = np.arange(-3.0, 3.0, 0.05) + 0.025
    x, y = np.meshgrid(centres, centres)
    occupied = np.zeros(x.shape, np.uint8)
    for low_x, low_y, high_x, high_y in faces:
        occupied[(x >= low_x) & (x <= high_x) & (y >= low_y) & (y <= high_y)] = 1
    points = np.column_stack((x[occupied > 0], y[occupied > 0]))
    away = np.full(x.shape, np.inf)
    for px, py in points:
        away = np.minimum(away, np.hypot(x - px, y - py))
    distance = np.maximum(0.0, away - 0.025).astype(np.float32)
    return WorldMap(
        stamp=0.0, resolution=0.05, origin=np.array([-3.0, -3.0]), occupied=occupied, distance=distance,
        proximity=np.zeros_like(distance), polygons=(), seen_points=points, seen_static=np.zeros(len(points), bool),
    )  # fmt: skip


@pytest.mark.parametrize(("face", "way"), [(0.3, -1.0), (0.2, -1.0), (0.1, -1.0), (-0.2, 1.0)])
def test_the_base_leaves_a_face_by_the_side_from_which_it_came(face, way):
    world = world_of((face, -0.6, face + 0.04, 0.6))
    found = find_escape(world, np.zeros(3), BODY, PROFILE.base)
    assert found is not None
    assert found.clear
    assert math.copysign(1.0, found.twist[0]) == way
    cells = overlapping_cells(world, found.poses[-1], BODY)
    assert depth_of(cells, found.poses[-1], BODY) <= 0.0


def test_a_base_that_cannot_reverse_turns_or_stands():
    limits = msgspec.structs.replace(PROFILE.base, reverse_speed=0.0)
    found = find_escape(world_of((0.3, 0.20, 0.34, 0.24)), np.zeros(3), BODY, limits)
    assert found is not None  # one corner: it turns away from it
    assert found.twist[0] == 0.0
    assert found.twist[1] < 0.0
    assert find_escape(world_of((0.3, -0.6, 0.34, 0.6)), np.zeros(3), BODY, limits) is None


def test_between_two_faces_nothing_makes_the_overlap_smaller():
    world = world_of((0.3, -0.6, 0.34, 0.6), (-0.34, -0.6, -0.3, 0.6))
    assert find_escape(world, np.zeros(3), BODY, PROFILE.base) is None


def test_a_base_with_little_room_behind_it_backs_off_as_far_as_that():
    """Only arcs of a whole body's length counted: a base stood for 50 s with a door post 5 mm before its corner."""
    here = np.zeros(3)
    field = field_of(world_of((0.37, -0.6, 0.41, 0.6), (-0.56, -0.6, -0.51, 0.6)))
    floor = PlanningParameters().staa.margin_floor
    ways = ways_to_room(here, field, BODY, PROFILE.base, floor)
    assert ways
    room = clearances(ways[0].poses, 1.0, field, BODY)
    assert room[-1] == room.max() > room[0] + 0.02
    assert room.min() >= min(floor, room[0] - 1e-3)


def test_a_plan_of_a_base_that_overlaps_something_leaves_it_whatever_the_target_is():
    world = world_of((0.1, -0.6, 0.14, 0.6))
    controller = StaaController(PROFILE, PlanningParameters())
    goal = np.array([2.0, 0.0, 0.0])
    one = np.ones(1)
    placement = Placement(
        mode="drive", radius=0.0, poses=goal[None], cost_current=one, cost_next=one, cost=one, rejected=("",), chosen=0,
        goal=goal, goal_has_heading=False, why=Reason(kind=Kind.DRIVE), next_goal=None,
    )  # fmt: skip
    target = Target(kind="drive", name="goal", position=goal[:2])
    problem = BaseProblem(
        time=0.0, world=world, pose=np.zeros(3), twist=np.zeros(2), target=target, next_target=None, engaged=False
    )
    plan = controller.plan(problem, placement, SearchBudget(expansions=50))
    assert plan.status == PlanStatus.ESCAPING
    assert plan.acceleration[0] < 0.0
    assert "overlaps" in plan.reason
