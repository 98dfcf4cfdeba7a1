"""Commands on the robot's side, bad links, clocks that differ, and where the robot will be when the next one acts."""

import msgspec
import numpy as np
import pytest

from motm_twin.bus.plant_messages import LIFETIME, VERSION, RobotCommand
from motm_twin.control.monitor import Monitor
from motm_twin.control.predictor import Motion, Predictor
from motm_twin.external.robot import MAX_BYTES, SILENCE, CommandGuard, Link, LinkSpec
from motm_twin.external.robot_link import ClockOffset, Lead
from motm_twin.model.plant import Actuation
from motm_twin.model.profile import DDQ_MAX, BaseLimits
from motm_twin.model.scene import Noise
from motm_twin.sim.plant import SimulatedPlant

LIMITS = BaseLimits()


def payload(**changes):
    fields = {
        "version": VERSION, "life": "now", "sender": "twin", "seq": 1, "act_at": 1.0, "twist": [0.3, 0.1],
        "joint_velocity": [0.1] * 7, "gripper": "close",
    }  # fmt: skip
    return msgspec.json.encode(RobotCommand(**(fields | changes)))


@pytest.fixture
def guard():
    return CommandGuard("now", LIMITS)


def test_a_command_acts_from_its_time_until_it_expires(guard):
    guard.offer(payload(act_at=1.05), 1.0)
    assert guard.actuation(1.04).twist.tolist() == [0.0, 0.0]
    assert guard.actuation(1.05).twist.tolist() == [0.3, 0.1]
    assert guard.actuation(1.34).joint_velocity.tolist() == [0.1] * 7
    expired = guard.actuation(1.36)
    assert not expired.twist.any()
    assert not guard.actuation(1.37).joint_velocity.any()
    assert expired.gripper == "close"  # what is held is not let go


def test_joints_come_to_rest_together_and_no_faster_than_they_can(guard):
    rates = np.array([2.0, -1.0, 0.0, 0.5, 0.1, -2.0, 0.0])
    guard.offer(payload(joint_velocity=rates.tolist(), lifetime=0.03), 1.0)
    told = np.array([guard.actuation(1.03 + 0.01 * k).joint_velocity for k in range(30)])
    shares = told[:, 0] / rates[0]
    assert shares[0] == pytest.approx(1.0)
    assert (np.diff(shares) <= 0.0).all()
    assert not told[-1].any()
    assert told == pytest.approx(np.outer(shares, rates))
    assert (np.abs(np.diff(told, axis=0)) <= DDQ_MAX * 0.01).all()


def test_fingers_open_as_far_as_they_were_told_also_when_the_command_has_expired(guard):
    guard.offer(payload(gripper="open", opening=0.06, lifetime=0.03), 1.0)
    assert (guard.actuation(1.0).opening, guard.actuation(1.2).opening) == (0.06, 0.06)
    guard.offer(payload(seq=2, act_at=1.3, gripper="open"), 1.3)
    assert guard.actuation(1.3).opening is None
    guard.offer(payload(seq=3, act_at=1.4, gripper="open", opening=-0.01), 1.4)
    assert "opening -0.01 m" in guard.refusal
    assert b"opening" not in payload()  # robots that do not know it understand the rest


def test_a_command_that_has_expired_on_its_way_moves_no_fingers(guard):
    guard.offer(payload(seq=1, act_at=1.0, gripper="close", lifetime=0.03), 1.0)
    assert guard.actuation(1.0).gripper == "close"
    guard.offer(payload(seq=2, act_at=1.1, gripper="open", lifetime=0.03), 1.2)
    assert guard.actuation(1.2).gripper == "close"
    guard.offer(payload(seq=3, act_at=1.2, gripper="open", lifetime=0.03), 1.22)
    assert guard.actuation(1.22).gripper == "open"


@pytest.mark.parametrize("act_at", [0.5, 3.0])
def test_a_command_for_another_time_is_heard_but_not_obeyed(guard, act_at):
    guard.offer(payload(seq=7, act_at=act_at), 1.0)
    assert guard.heard() == [(7, 1.0)]  # its sender has this clock wrong, and learns it from that
    assert guard.commander == ""
    assert not guard.actuation(act_at).twist.any()


def test_commands_that_overtake_each_other_act_in_their_order(guard):
    guard.offer(payload(seq=2, act_at=1.02, twist=[0.2, 0.0]), 1.0)
    guard.offer(payload(seq=1, act_at=1.01, twist=[0.1, 0.0]), 1.0)
    assert [guard.actuation(now).twist[0] for now in (1.01, 1.02)] == [0.1, 0.2]
    assert guard.refused == 0


REFUSED = {
    "malformed": b"{",
    "no text": b"\xff\xfe",
    "too long": b" " * (MAX_BYTES + 1),
    "number as text": payload().replace(b"0.3", b'"0.3"'),
    "infinite": payload().replace(b"0.3", b"1e999"),
    "unknown field": payload().replace(b'{"version"', b'{"more":1,"version"'),
    "version": payload(version="motm.plant/0"),
    "life": payload(life="before"),
    "sender": payload(sender=""),
    "negative number": payload(seq=-1),
    "forward speed": payload(twist=[LIMITS.forward_speed + 0.01, 0.0]),
    "reverse speed": payload(twist=[-LIMITS.reverse_speed - 0.01, 0.0]),
    "yaw rate": payload(twist=[0.0, LIMITS.yaw_rate + 0.01]),
    "joint speed": payload(joint_velocity=[10.0] + [0.0] * 6),
    "six joints": payload(joint_velocity=[0.0] * 6),
    "gripper": payload(gripper="wave"),
    "lifetime": payload(lifetime=10.0),
    "no lifetime": payload(lifetime=0.0),
    "stale": payload(act_at=0.5),
    "far ahead": payload(act_at=3.0),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_can_not_be_obeyed_is_refused_and_changes_nothing(guard, what):
    guard.offer(REFUSED[what], 1.0)
    assert guard.refused == 1
    assert guard.refusal
    assert guard.commander == ""
    assert not guard.actuation(1.0).twist.any()


def test_duplicates_and_old_numbers_are_refused(guard):
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.actuation(1.0)
    guard.offer(payload(seq=5, act_at=1.01), 1.01)
    guard.offer(payload(seq=4, act_at=1.01), 1.01)
    assert guard.refused == 3


def test_a_number_that_jumps_is_refused_and_keeps_nobody_out(guard):
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.offer(payload(seq=5 + 10**6, act_at=1.0), 1.0)
    assert "jumps by 1000000" in guard.refusal
    guard.offer(payload(seq=6, act_at=1.01, twist=[0.2, 0.0]), 1.01)
    assert guard.refused == 1
    assert guard.actuation(1.01).twist[0] == 0.2


def test_after_a_silence_numbers_begin_again(guard):
    """A sender that was started again, or one that somebody else has spoken for."""
    guard.offer(payload(seq=500, act_at=1.0), 1.0)
    guard.actuation(1.0)
    later = 1.0 + SILENCE
    guard.offer(payload(seq=7, act_at=later, twist=[0.2, 0.0]), later)
    assert guard.refused == 0
    assert guard.actuation(later).twist[0] == 0.2
    guard.offer(payload(seq=10**9, act_at=2.0 * later), 2.0 * later)
    assert guard.refused == 0


def test_one_commands_until_it_is_silent(guard):
    guard.offer(payload(), 1.0)
    guard.offer(payload(sender="other", act_at=1.1, twist=[-0.1, 0.0]), 1.1)
    assert (guard.commander, guard.refused) == ("twin", 1)
    later = 1.0 + SILENCE
    guard.offer(payload(sender="other", act_at=later, twist=[-0.1, 0.0]), later)
    assert guard.commander == "other"
    assert guard.actuation(later).twist[0] == pytest.approx(-0.1)


def test_random_bytes_are_never_obeyed(guard):
    rng, good = np.random.default_rng(0), payload()
    for _ in range(2000):
        broken = bytearray(good)
        for place in rng.integers(0, len(good), 3):
            broken[place] = rng.integers(0, 256)
        guard.offer(bytes(broken[: rng.integers(0, len(good))]), 1.0)
    assert guard.refused == 2000


def arrivals(spec):
    link = Link(spec, 0)
    got = []
    for step in range(2000):
        now = 0.01 * step
        link.send(step, now)
        got += [(item, now - 0.01 * item) for item in link.arrived(now)]
    return got


def test_a_perfect_link_gives_everything_at_once():
    assert arrivals(LinkSpec()) == [(step, 0.0) for step in range(2000)]


def test_a_bad_link_delays_loses_and_repeats_by_its_seed():
    spec = LinkSpec(latency=0.05, jitter=0.02, loss=0.05, seed=3)
    got = arrivals(spec)
    ways = [way for _, way in got]
    assert 0.03 - 1e-9 <= min(ways)
    assert max(ways) <= 0.08 + 1e-9  # a step later at most
    assert 0.03 < 1.0 - len(got) / 2000 < 0.08
    assert [item for item, _ in got] != sorted(item for item, _ in got)
    assert got == arrivals(spec)
    assert got != arrivals(LinkSpec(latency=0.05, jitter=0.02, loss=0.05, seed=4))


def test_in_an_outage_nothing_arrives_in_both_directions_once_in_every_while():
    spec = LinkSpec(outage=0.25, every=2.0, seed=3)
    there = [[], []]
    for direction in (0, 1):
        link = Link(spec, direction)
        for step in range(2000):
            link.send(step, 0.01 * step)
            there[direction] += link.arrived(0.01 * step)
    assert there[0] == there[1]
    lost = sorted(set(range(2000)) - set(there[0]))
    assert [sum(step // 200 == k for step in lost) for k in range(10)] == pytest.approx([25] * 10, abs=1)
    begins = [min(step for step in lost if step // 200 == k) % 200 for k in range(10)]
    assert len(set(begins)) > 5


def test_a_link_that_can_not_be_is_refused():
    with pytest.raises(ValueError, match="jitter <= latency"):
        LinkSpec(latency=0.01, jitter=0.02)
    with pytest.raises(ValueError, match="outage <= every"):
        LinkSpec(outage=3.0, every=2.0)


def test_the_offset_of_two_clocks_is_found_within_half_the_shortest_way():
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
def test_a_clock_that_jumps_is_found_again_at_once(jump):
    clock = ClockOffset()
    for step in range(200):
        now, offset = 0.01 * step, 10.0 + (jump if step >= 100 else 0.0)
        clock.state(now - 0.05 + offset, now)
        clock.command(now - 0.1, now - 0.05 + offset, now)
    assert clock.offset == pytest.approx(10.0 + jump, abs=0.03)


def test_the_lead_covers_the_way_and_falls_slowly():
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


def test_without_a_delay_the_prediction_is_what_was_measured(scene):
    predictor = Predictor(scene.robot, LIFETIME)
    now = motion(SimulatedPlant(scene))
    predictor.sent(0.0, Actuation(twist=np.ones(2), joint_velocity=np.ones(7), gripper="close"))
    assert predictor.predict(now, 0.0) is now


def test_a_prediction_of_120_ms_is_where_the_simulated_robot_comes_to(scene):
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
def test_the_arm_slows_and_stands_too_when_the_state_is_old(scene, age, share):
    seen = msgspec.structs.replace(SimulatedPlant(scene).observe(), age=age)
    asked = Actuation(twist=np.zeros(2), joint_velocity=np.full(7, 0.1), gripper="open")
    told = Monitor(scene.robot).check(asked, seen, 0.01, scan_stamp=seen.scan.stamp if seen.scan else seen.time)
    assert told.actuation.joint_velocity == pytest.approx(0.1 * share)
    assert ("state of the robot" in told.reason) == (share < 1.0)


def motion(plant):
    seen = plant.observe()
    return Motion(
        stamp=seen.time, pose=seen.pose, odometry=seen.odometry, twist=seen.twist, q=seen.q, dq=seen.dq,
        gripper_moving=seen.gripper_moving,
    )  # fmt: skip
