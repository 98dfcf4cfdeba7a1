"""What contacts and dropped objects make of a trial, of an episode for learning, and of the events that are told."""

from types import SimpleNamespace

import msgspec
import pytest

from motm_twin.bus.encode import tick_message
from motm_twin.bus.events import EventLog, EventWatch
from motm_twin.bus.messages import CutInMessage
from motm_twin.gym.env import RewardWeights, Score, reward, score_of
from motm_twin.model.plant import Contact, Truth
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.trial import failure
from motm_twin.twin import Twin


def contact(*, caused):
    return Contact(time=1.0, body="base", other="temi", depth=0.01, closing_speed=0.1, other_speed=0.0,
                   caused_by_robot=caused, duration=0.1, bodies=("base",))  # fmt: skip


@pytest.fixture(scope="module")
def truth() -> Truth:
    return SimulatedPlant(load_scene("exp1", "trial1")).truth()


def test_only_contacts_that_the_robot_caused_cost_a_reward_and_both_numbers_are_known(truth):
    tick = SimpleNamespace(tasks=())
    before = score_of(Score(), tick, truth, 0.0)
    touched = msgspec.structs.replace(truth, contacts=(contact(caused=True), contact(caused=False)))
    after = score_of(before, tick, touched, 0.0)
    assert (after.contacts, after.caused) == (2, 1)
    assert reward(RewardWeights(), before, after) == RewardWeights().contact


def test_what_was_dropped_and_not_put_right_is_known_by_its_name(truth):
    dropped = msgspec.structs.replace(truth, dropped=("cube3",))
    assert score_of(Score(), SimpleNamespace(tasks=()), dropped, 0.0).dropped == {"cube3"}
    tick = SimpleNamespace(done=True, truth=dropped, tasks=())
    assert failure(SimpleNamespace(), tick, False, 0, ()) == "dropped, and not picked up and placed again: cube3"


def test_a_cut_in_is_told_once(truth):
    told = []
    watch = EventWatch(EventLog(lambda: 0.0, told.append))
    period = tick_message(Twin(load_scene("exp1", "trial1")).advance(), run=1, server_time=0.0)
    cuts = [CutInMessage(time=0.04, agent=name, gap=0.31, stopping_way=0.56, speed=0.4) for name in ("temi1", "temi2")]

    def at(index, *cut_ins):
        score = msgspec.structs.replace(period.score, cut_ins=list(cut_ins))
        watch.tick(msgspec.structs.replace(period, index=index, time=0.05 * index, events=[], score=score))
        return [(event.other, event.text) for event in told if event.kind == "cut_in"]

    assert at(0) == []
    both = [(name, f"cut in on {name}, 0.31 m before it") for name in ("temi1", "temi2")]
    assert at(1, *cuts) == both
    assert at(2, *cuts) == both
