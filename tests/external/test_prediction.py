"""Bad links, clocks that differ, and where the robot will be when the next command acts."""

import msgspec
import numpy as np
import pytest

from motm_twin.bus.plant_messages import LIFETIME
from motm_twin.control.monitor import Monitor
from motm_twin.control.predictor import Motion, Predictor
from motm_twin.external.robot import Link, LinkSpec
from motm_twin.external.robot_link import ClockOffset, Lead
from motm_twin.model.plant import Actuation
from motm_twin.model.scene import Noise, Scene
from motm_twin.sim.plant import SimulatedPlant


def arrivals(spec: LinkSpec) -> list[tuple[int, float]]:
    link: Link[int] = Link(spec, 0)
    got = []
    for step in range(2000):
        now = 0.01 * step
        link.send(step, now)
        got += [(item, now - 0.01 * item) for item in link.arrived(now)]
    return got


def test_a_perfect_link_gives_everything_at_once() -> None:
    assert arrivals(LinkSpec()) == [(step, 0.0) for step in range(2000)]


def test_a_bad_link_delays_loses_and_repeats_by_its_seed() -> None:
    spec = LinkSpec(latency=0.05, jitter=0.02, loss=0.05, seed=3)
    got = arrivals(spec)
    ways = [way for _, way in got]
    assert 0.03 - 1e-9 <= min(ways)
    assert max(ways) <= 0.08 + 1e-9  # a step later at most
    assert 0.03 < 1.0 - len(got) / 2000 < 0.08
    assert [item for item, _ in got] != sorted(item for item, _ in got)
    assert got == arrivals(spec)
    assert got != arrivals(LinkSpec(latency=0.05, jitter=0.02, loss=0.05, seed=4))


def test_in_an_outage_nothing_arrives_in_both_directions_once_in_every_while() -> None:
    spec = LinkSpec(outage=0.25, every=2.0, seed=3)
    there: list[list[int]] = [[], []]
    for direction in (0, 1):
        link: Link[int] = Link(spec, direction)
        for step in range(2000):
            link.send(step, 0.01 * step)
            there[direction] += link.arrived(0.01 * step)
    assert there[0] == there[1]
    lost = sorted(set(range(2000)) - set(there[0]))
    assert [sum(step // 200 == k for step in lost) for k in range(10)] == pytest.approx([25] * 10, abs=1)
    begins = [min(step for step in lost if step // 200 == k) % 200 for k in range(10)]
    assert len(set(begins)) > 5


def test_a_link_that_can_not_be_is_refused() -> None:
    with pytest.raises(ValueError, match="jitter <= latency"):
        LinkSpec(latency=0.01, jitter=0.02)
    with pytest.raises(ValueError, match="outage <= every"):
        LinkSpec(outage=3.0, every=2.0)


def test_the_offset_of_two_clocks_is_found_within_half_the_shortest_way() -> None:
    clock, offset = ClockOffset(), 1234.5
    assert clock.offset is None
    rng = np.random.default_rng(1)
    for step in range(400):
        now = 0.01 * step
        sent, way, back = now - 0.2, 0.05 + 0.02 * rng.random(), 0.05 + 0.02 * rng.random()
        clock.state(now - back + offset, now)
        clock.command(sent, sent + way + offset, now)
    assert clock.offset == pytest.approx(offset, abs=0.005)


@pytest.mark.parametrize("jump", [-0.5, 0.5])
def test_a_clock_that_jumps_is_found_again_at_once(jump: float) -> None:
    clock = ClockOffset()
    for step in range(200):
        now, offset = 0.01 * step, 10.0 + (jump if step >= 100 else 0.0)
        clock.state(now - 0.05 + offset, now)
        clock.command(now - 0.1, now - 0.05 + offset, now)
    assert clock.offset == pytest.approx(10.0 + jump, abs=0.03)


def test_the_lead_covers_the_way_and_falls_slowly() -> None:
    lead = Lead(0.01)
    assert lead.now(0.0) == 0.0
    for seq in range(200):
        lead.sent(seq, 0.01 * seq)
        lead.heard(seq, 0.01 * seq + 0.043)
    assert lead.now(2.0) == pytest.approx(0.05)
    for seq in range(200, 400):
        lead.sent(seq, 0.01 * seq)
        lead.heard(seq, 0.01 * seq)
    assert lead.now(3.0) == pytest.approx(0.05)
    assert lead.now(4.1) == pytest.approx(0.04)
    assert lead.now(10.0) == pytest.approx(0.03)


def test_without_a_delay_the_prediction_is_what_was_measured(scene: Scene) -> None:
    predictor = Predictor(scene.robot, LIFETIME)
    now = motion(SimulatedPlant(scene))
    predictor.sent(0.0, Actuation(twist=np.ones(2), joint_velocity=np.ones(7), gripper="close"))
    assert predictor.predict(now, 0.0) is now


def test_a_prediction_of_120_ms_is_where_the_simulated_robot_comes_to(scene: Scene) -> None:
    quiet = msgspec.structs.replace(scene, noise=Noise(localisation_position_sd=0.0, localisation_heading_sd=0.0))
    plant, predictor = SimulatedPlant(quiet), Predictor(scene.robot, LIFETIME)
    rng, past, worst = np.random.default_rng(2), [], 0.0
    for step in range(300):
        now = 0.01 * step
        told = Actuation(
            twist=np.array([0.3 + 0.1 * np.sin(now), 0.5 * np.cos(now)]),
            joint_velocity=0.3 * np.sin(now + np.arange(7)) + 0.01 * rng.standard_normal(7),
            gripper="open",
        )
        predictor.sent(now, told)
        plant.command(told)
        past.append(motion(plant))
        plant.step(0.01)
        if step >= 12:
            later, there = predictor.predict(past[step - 11], now + 0.01), motion(plant)
            worst = max(worst, float(np.abs(later.pose - there.pose).max()), float(np.abs(later.q - there.q).max()))
    assert worst < 1e-3


@pytest.mark.parametrize(("age", "share"), [(0.1, 1.0), (0.2, 2.0 / 3.0), (0.25, 1.0 / 3.0), (0.4, 0.0)])
def test_the_arm_slows_and_stands_too_when_the_state_is_old(scene: Scene, age: float, share: float) -> None:
    seen = msgspec.structs.replace(SimulatedPlant(scene).observe(), age=age)
    asked = Actuation(twist=np.zeros(2), joint_velocity=np.full(7, 0.1), gripper="open")
    told = Monitor(scene.robot).check(asked, seen, 0.01, scan_stamp=seen.scan.stamp if seen.scan else seen.time)
    assert told.actuation.joint_velocity == pytest.approx(0.1 * share)
    assert ("state of the robot" in told.reason) == (share < 1.0)


def motion(plant: SimulatedPlant) -> Motion:
    seen = plant.observe()
    return Motion(
        stamp=seen.time, pose=seen.pose, odometry=seen.odometry, twist=seen.twist, q=seen.q, dq=seen.dq,
        gripper_moving=seen.gripper_moving,
    )  # fmt: skip
