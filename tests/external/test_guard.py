"""Commands on the robot's side: only fresh, possible ones of one sender, each for its time."""

from typing import Any

import msgspec
import numpy as np
import pytest

from motm_twin.bus.plant_messages import VERSION, RobotCommand
from motm_twin.external.robot import MAX_BYTES, SILENCE, CommandGuard
from motm_twin.model.joint_limits import DDQ_MAX
from motm_twin.model.profile import BaseLimits

LIMITS = BaseLimits()


def payload(**changes: Any) -> bytes:
    fields: dict[str, Any] = {
        "version": VERSION, "life": "now", "sender": "twin", "seq": 1, "act_at": 1.0, "twist": [0.3, 0.1],
        "joint_velocity": [0.1] * 7, "gripper": "close",
    }  # fmt: skip
    return msgspec.json.encode(RobotCommand(**(fields | changes)))


@pytest.fixture
def guard() -> CommandGuard:
    return CommandGuard("now", LIMITS)


def test_a_command_acts_from_its_time_until_it_expires(guard: CommandGuard) -> None:
    guard.offer(payload(act_at=1.05), 1.0)
    assert guard.actuation(1.04).twist.tolist() == [0.0, 0.0]
    assert guard.actuation(1.05).twist.tolist() == [0.3, 0.1]
    assert guard.actuation(1.34).joint_velocity.tolist() == [0.1] * 7
    expired = guard.actuation(1.36)
    assert not expired.twist.any()
    assert not guard.actuation(1.37).joint_velocity.any()
    assert expired.gripper == "close"  # what is held is not let go


def test_joints_come_to_rest_together_and_no_faster_than_they_can(guard: CommandGuard) -> None:
    rates = np.array([2.0, -1.0, 0.0, 0.5, 0.1, -2.0, 0.0])
    guard.offer(payload(joint_velocity=rates.tolist(), lifetime=0.03), 1.0)
    told = np.array([guard.actuation(1.03 + 0.01 * k).joint_velocity for k in range(30)])
    shares = told[:, 0] / rates[0]
    assert shares[0] == pytest.approx(1.0)
    assert (np.diff(shares) <= 0.0).all()
    assert not told[-1].any()
    assert told == pytest.approx(np.outer(shares, rates))
    assert (np.abs(np.diff(told, axis=0)) <= DDQ_MAX * 0.01).all()


def test_a_command_that_has_expired_on_its_way_moves_no_fingers(guard: CommandGuard) -> None:
    guard.offer(payload(seq=1, act_at=1.0, gripper="close", lifetime=0.03), 1.0)
    assert guard.actuation(1.0).gripper == "close"
    guard.offer(payload(seq=2, act_at=1.1, gripper="open", lifetime=0.03), 1.2)
    assert guard.actuation(1.2).gripper == "close"
    guard.offer(payload(seq=3, act_at=1.2, gripper="open", lifetime=0.03), 1.22)
    assert guard.actuation(1.22).gripper == "open"


@pytest.mark.parametrize("act_at", [0.5, 3.0])
def test_a_command_for_another_time_is_heard_but_not_obeyed(guard: CommandGuard, act_at: float) -> None:
    guard.offer(payload(seq=7, act_at=act_at), 1.0)
    assert guard.heard() == [(7, 1.0)]  # its sender has this clock wrong, and learns it from that
    assert guard.commander == ""
    assert not guard.actuation(act_at).twist.any()


def test_commands_that_overtake_each_other_act_in_their_order(guard: CommandGuard) -> None:
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
def test_what_can_not_be_obeyed_is_refused_and_changes_nothing(guard: CommandGuard, what: str) -> None:
    guard.offer(REFUSED[what], 1.0)
    assert guard.refused == 1
    assert guard.refusal
    assert guard.commander == ""
    assert not guard.actuation(1.0).twist.any()


def test_duplicates_and_old_numbers_are_refused(guard: CommandGuard) -> None:
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.actuation(1.0)
    guard.offer(payload(seq=5, act_at=1.01), 1.01)
    guard.offer(payload(seq=4, act_at=1.01), 1.01)
    assert guard.refused == 3


def test_a_number_that_jumps_is_refused_and_keeps_nobody_out(guard: CommandGuard) -> None:
    guard.offer(payload(seq=5, act_at=1.0), 1.0)
    guard.offer(payload(seq=5 + 10**6, act_at=1.0), 1.0)
    assert "jumps by 1000000" in guard.refusal
    guard.offer(payload(seq=6, act_at=1.01, twist=[0.2, 0.0]), 1.01)
    assert guard.refused == 1
    assert guard.actuation(1.01).twist[0] == 0.2


def test_after_a_silence_numbers_begin_again(guard: CommandGuard) -> None:
    """A sender that was started again, or one that somebody else has spoken for."""
    guard.offer(payload(seq=500, act_at=1.0), 1.0)
    guard.actuation(1.0)
    later = 1.0 + SILENCE
    guard.offer(payload(seq=7, act_at=later, twist=[0.2, 0.0]), later)
    assert guard.refused == 0
    assert guard.actuation(later).twist[0] == 0.2
    guard.offer(payload(seq=10**9, act_at=2.0 * later), 2.0 * later)
    assert guard.refused == 0


def test_one_commands_until_it_is_silent(guard: CommandGuard) -> None:
    guard.offer(payload(), 1.0)
    guard.offer(payload(sender="other", act_at=1.1, twist=[-0.1, 0.0]), 1.1)
    assert (guard.commander, guard.refused) == ("twin", 1)
    later = 1.0 + SILENCE
    guard.offer(payload(sender="other", act_at=later, twist=[-0.1, 0.0]), later)
    assert guard.commander == "other"
    assert guard.actuation(later).twist[0] == pytest.approx(-0.1)


def test_random_bytes_are_never_obeyed(guard: CommandGuard) -> None:
    rng, good = np.random.default_rng(0), payload()
    for _ in range(2000):
        broken = bytearray(good)
        for place in rng.integers(0, len(good), 3):
            broken[place] = rng.integers(0, 256)
        guard.offer(bytes(broken[: rng.integers(0, len(good))]), 1.0)
    assert guard.refused == 2000
