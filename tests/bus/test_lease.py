import pytest
from hypothesis import given
from hypothesis import strategies as st

from motm_twin.bus.commands import Refused
from motm_twin.bus.driver import SILENCE, Lease

SENDERS = ("ann", "bob", "cid")


def test_who_acts_first_drives_and_others_are_told_who():
    lease = Lease()
    lease.require("ann", 0.0)
    lease.give("ann", "Ann <3", 0.0)
    with pytest.raises(
        Refused, match=r"Ann <3 is driving: it can hand over to you, or you wait for 10 s of silence \(7 s left\)"
    ):
        lease.require("bob", 3.0)
    lease.require("ann", 9.0)
    assert lease.left(10.0) == SILENCE - 1.0


def test_silence_frees_the_wheel_and_no_earlier():
    lease = Lease()
    lease.give("ann", "", 0.0)
    assert lease.name == "ann"
    lease.expire(SILENCE - 0.001)
    assert lease.driver == "ann"
    lease.expire(SILENCE)
    assert (lease.driver, lease.name, lease.left(SILENCE)) == ("", "", 0.0)


def test_a_wheel_that_is_handed_over_belongs_to_the_other_for_the_full_time():
    lease = Lease()
    lease.give("ann", "Ann", 0.0)
    lease.give("bob", "Bob", 5.0)
    assert (lease.driver, lease.name, lease.left(5.0)) == ("bob", "Bob", SILENCE)
    with pytest.raises(Refused):
        lease.require("ann", 6.0)
    lease.give("", "", 7.0)
    assert (lease.driver, lease.left(7.0)) == ("", 0.0)


steps = st.lists(
    st.tuples(
        st.floats(0.0, 1.5 * SILENCE),
        st.sampled_from(SENDERS),
        st.sampled_from(["act", "fail", "pass", "free"]),
        st.sampled_from(SENDERS),
    ),
    max_size=40,
)


@given(steps)
def test_only_one_drives_and_nobody_loses_the_wheel_without_silence(history):
    lease, now, driver, heard = Lease(), 0.0, "", 0.0
    for wait, sender, kind, to in history:
        now += wait
        if driver and now >= heard + SILENCE:
            driver = ""
        lease.expire(now)
        assert lease.driver == driver
        allowed = driver in ("", sender)
        try:
            lease.require(sender, now)
        except Refused:
            assert not allowed
            continue
        assert allowed
        if kind == "act":
            lease.give(sender, sender.title(), now)
        elif kind in ("pass", "free"):
            lease.give(to if kind == "pass" else "", to.title(), now)
        driver, heard = {"act": sender, "pass": to, "free": "", "fail": driver}[kind], now
        assert lease.driver == driver
        assert lease.left(now) == (pytest.approx(SILENCE) if driver else 0.0)


@given(st.text(max_size=80), st.text(min_size=1, max_size=64))
def test_names_are_kept_raw_and_bounded(name, sender):
    lease = Lease()
    lease.give(sender, name, 0.0)
    assert 1 <= len(lease.name) <= 40 or not sender.strip()
    assert lease.name in (name.strip()[:40], sender[:40])
