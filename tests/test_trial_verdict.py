"""What contacts and dropped objects make of a trial, of an episode for learning, and of the events that are told."""

from types import SimpleNamespace

import msgspec
import pytest

from motm_twin.gym.reward import RewardWeights, Score, reward, score_of
from motm_twin.model.plant import Contact, Truth
from motm_twin.model.scene_file import load_scene
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.trial import failure


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
