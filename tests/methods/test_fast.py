"""fast: what moves far away is no obstacle, and the robot keeps to its plans."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from motm_twin.methods.registry import find_method
from motm_twin.model.edits import InjectFault, SetParameter
from motm_twin.model.known import known_world
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.perception.mapper import Mapper
from motm_twin.perception.still_map import FilteredMap, StaticMap
from motm_twin.perception.tracks import TrackParameters, stationary_points
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.twin import Twin

OPEN_FLOOR = str(Path(__file__).parents[1] / "rivals" / "open_floor.yaml")


def test_a_search_that_finds_nothing_cheaper_still_tells_of_the_way():
    """Of many nothing but the root is looked at. A period that brakes to keep the object in reach is another thing."""
    twin = Twin(load_scene("exp1", "trial1", 0), method=find_method("fast"))
    plans, short = [], []
    while len(short) <= 20 and len(plans) < 300:
        plans.append(twin.advance().plan)
        short = [plan for plan in plans if plan.expansions == 1 and plan.status != "braking"]
    assert sum(plan.status == "braking" for plan in plans) <= 1
    assert len(short) > 20
    for plan in short:
        assert plan.status == "goal" and len(plan.local_poses) > 1
        assert len(plan.global_path) > 1 and len(plan.next_path) > 1 and np.isfinite(plan.t_h)


@pytest.fixture(scope="module")
def temis():
    """The four Temis for 1.5 s: a twin, and its newest Tick."""
    twin = Twin(load_scene("exp2", "random", 0), method=find_method("fast"))
    return twin, [twin.advance() for _ in range(30)][-1]


def test_the_map_of_the_planner_has_near_movers_and_no_far_ones(temis):
    twin, tick = temis
    planner = twin.loop.planner
    far = tick.map.movers[tick.map.movers[:, 5] == 0.0]
    assert len(far)
    stands = stationary_points(tick.map, far, TrackParameters())
    seen = tick.map.seen_points[~stands]
    assert len(seen) and (np.hypot(*(seen - tick.observation.pose[:2]).T) > 1.5).all()
    world = planner.view.without_far.keep(tick.map, stands)
    assert len(world.seen_points) == stands.sum() and len(world.polygons) < len(tick.map.polygons)
    assert (world.distance >= tick.map.distance - 1e-6).all()


def test_the_still_map_has_no_mover_at_all(temis):
    _, tick = temis
    world = StaticMap(known_world(load_scene("exp2", "random", 0)), TrackParameters()).of(tick.map)
    assert len(tick.map.movers) and len(world.seen_points) < len(tick.map.seen_points)
    for x, y, *_, radius, _near in tick.map.movers:
        assert (np.hypot(*(world.seen_points - (x, y)).T) > radius).all()


def test_a_map_in_which_everything_stands_is_left_as_it_is():
    scene = load_scene("exp1", "trial1")
    known = known_world(scene)
    world = Mapper(known).update(SimulatedPlant(scene).observe())
    assert FilteredMap(known).keep(world, np.ones(len(world.seen_points), dtype=bool)) is world


def test_the_robot_keeps_to_its_plan():
    twin = Twin(load_scene(OPEN_FLOOR, "one", 0), method=find_method("fast"))
    left = [(tick.plan.status, tick.plan.local_to_go) for tick in (twin.advance() for _ in range(60))]
    falls = [b[0] - a[0] for (was, a), (now, b) in itertools.pairwise(left) if was == now == "goal"]
    assert len(falls) > 10 and np.mean(np.array(falls) < 1e-9) > 0.95


def test_a_copied_twin_goes_on_bit_for_bit(temis):
    twin, _ = temis
    copy = Twin(load_scene("exp2", "random", 0), method=find_method("fast"))
    copy.restore(twin.snapshot())
    for _ in range(3):
        assert state_hash(copy.advance().plan) == state_hash(twin.advance().plan)


@pytest.mark.parametrize(("variant", "periods"), [("trial3", 60), ("trial1", 30)])
def test_a_robot_that_was_stopped_drives_on_at_once(variant, periods):
    """It is not on its plan any more: what is left of that, to keep its speed, would be to stand."""
    twin = Twin(load_scene("exp1", variant, 0), method=find_method("fast"))
    for _ in range(periods):
        twin.advance()
    twin.post(InjectFault(fault="lidar_off", seconds=1.5))
    reasons = [twin.advance().stop_reason for _ in range(29)]
    assert reasons[-1].startswith("stopped: the newest lidar scan")
    ticks = [twin.advance() for _ in range(24)]
    stood = max(k for k, tick in enumerate(ticks) if tick.observation.twist[0] < 0.02)
    assert stood < 5, "periods of standing after the lidar is back"
    assert ticks[-1].observation.twist[0] > 0.3


BESIDE_TEMIS = 3  # periods


def twin_of(name: str) -> Twin:
    """Among four Temis."""
    return Twin(load_scene("exp2", "random", 1), method=find_method(name))


@pytest.mark.parametrize("name", ["fast", "sequential"])
def test_it_can_be_changed_during_a_run_and_a_copy_goes_on_bit_for_bit(name: str):
    twin, plain = twin_of(name), twin_of(name)
    for _ in range(40):
        twin.advance()
    plain.restore(twin.snapshot())
    twin.post(SetParameter(name="prediction", value=1.0))
    twin.post(SetParameter(name="moving_weight", value=1.0))
    assert any(state_hash(twin.advance().plan) != state_hash(plain.advance().plan) for _ in range(60))
    copy = twin_of(name)
    copy.restore(twin.snapshot())
    for _ in range(BESIDE_TEMIS):
        assert state_hash(copy.advance().plan) == state_hash(twin.advance().plan)
    for each in (twin, copy):
        each.post(SetParameter(name="prediction", value=0.0))
        each.post(SetParameter(name="moving_weight", value=None))
    for _ in range(BESIDE_TEMIS):
        assert state_hash(copy.advance().plan) == state_hash(twin.advance().plan)
    assert twin.loop.planner.ahead is None
