"""The Gymnasium environment: what Gymnasium asks of one, and that it is the loop, seeded, safe and copied as ever."""

import ast
import re
from pathlib import Path

import msgspec
import numpy as np
import pytest

gymnasium = pytest.importorskip("gymnasium")

from gymnasium.utils.env_checker import check_env  # noqa: E402

from motm_twin.gym import ENVIRONMENTS, Expert, MotmEnv, RewardWeights  # noqa: E402
from motm_twin.gym.env import Score, reward  # noqa: E402
from motm_twin.gym.observation import ObservationReader  # noqa: E402
from motm_twin.model.edits import AddObstacle, InjectFault  # noqa: E402
from motm_twin.model.faults import KINDS  # noqa: E402
from motm_twin.twin import Twin  # noqa: E402

ROOT = Path(__file__).resolve().parents[2]
FULL_AHEAD = np.array([1.0, 0.0], dtype=np.float32)


def begun(seed=0, **arguments):
    """An environment of trial 1, unless said, after its reset."""
    env = MotmEnv(**{"variant": "trial1", **arguments})
    env.reset(seed=seed)
    return env


def zeros(env):
    return np.zeros(env.action_space.shape, dtype=np.float32)


def equal(one, other):
    return all(np.array_equal(one[name], other[name]) for name in one)


@pytest.mark.parametrize("name", ["motm/Exp1Base-v0", "motm/Exp2WholeBody-v0"])
@pytest.mark.filterwarnings("error::UserWarning")
def test_gymnasium_s_checker_finds_nothing(name):
    check_env(gymnasium.make(name, render_mode="rgb_array").unwrapped)


def test_every_registered_environment_is_made():
    for name in ENVIRONMENTS:
        assert gymnasium.make(name).action_space.shape in ((2,), (10,))


@pytest.mark.parametrize("actions", ["base", "whole_body"])
def test_the_same_seed_and_actions_give_the_same_run_bit_for_bit(actions):
    env = MotmEnv(actions=actions)
    runs = []
    for _ in range(2):
        env.reset(seed=5)
        env.action_space.seed(1)
        steps = [env.step(env.action_space.sample()) for _ in range(30)]
        runs.append((steps, env.twin.state_hash()))
    assert runs[0][1] == runs[1][1]
    for one, other in zip(runs[0][0], runs[1][0], strict=True):
        assert equal(one[0], other[0]) and one[1:] == other[1:]


def test_the_seed_is_that_of_the_scene_and_others_are_drawn_from_it():
    env, other = MotmEnv(), MotmEnv()
    assert env.reset(seed=7)[1]["seed"] == other.reset(seed=7)[1]["seed"] == 7
    assert env.twin.scene.variant == "random"
    drawn = env.reset()[1]["seed"]
    assert drawn == other.reset()[1]["seed"] != 7
    assert env.reset(options={"variant": "trial3"})[1]["variant"] == "trial3"


@pytest.mark.parametrize("name", ["motm/Exp2Base-v0", "motm/Exp2WholeBody-v0"])
def test_an_agent_that_does_nothing_does_no_harm(name):
    env = gymnasium.make(name).unwrapped
    env.reset(seed=1)
    start = env.view.observation.pose
    for _ in range(100):
        observed, _, terminated, truncated, info = env.step(zeros(env))
        assert observed in env.observation_space
    assert not terminated and not truncated
    assert info["contacts"] == info["picks"] == info["drops"] == 0
    assert np.hypot(*(env.view.observation.pose - start)[:2]) < 0.1


def driven_at_a_crate(**arguments):
    """Full speed ahead: the reasons given for slowing down, and the environment after 6 s."""
    env = begun(**arguments)
    env.twin.post(AddObstacle(name="crate", shape="box", x=1.5, y=0.0, heading=0.0, size=(0.5, 0.8, 0.6)))
    infos = [env.step(FULL_AHEAD)[4] for _ in range(120)]
    return {info["stop_reason"] for info in infos}, env, infos[-1]


def test_what_is_observed_under_any_fault_is_within_the_space():
    """A beam that was nan made a whole sector nan."""
    env = begun(seed=1)
    for kind in KINDS:
        env.twin.post(InjectFault(fault=kind, seconds=0.1))
        for _ in range(4):
            observed, *_ = env.step(zeros(env))
            assert env.observation_space.contains(observed), kind


def test_the_pose_is_the_one_that_the_robot_believes_and_looking_changes_nothing():
    """Targets were observed beside their places once localisation had jumped."""
    env = begun(seed=1)
    for _ in range(40):
        env.step(zeros(env))
    env.twin.post(InjectFault(fault="pose_jump", seconds=4.0, amount=0.5))
    for _ in range(40):
        env.step(zeros(env))
    before = env.twin.state_hash()
    believed, reported = env.twin.loop.believed(), env.twin.plant.observe()
    assert env.twin.state_hash() == before
    np.testing.assert_array_equal(env.view.observation.pose, believed.pose)
    true = env.twin.plant.truth().pose
    assert np.hypot(*(reported.pose - true)[:2]) > 0.4 and np.hypot(*(believed.pose - true)[:2]) < 0.1


def test_beams_that_say_nothing_are_no_return_and_hide_none_of_their_sector():
    env = begun()
    scan, reader = env.twin.plant.observe().scan, ObservationReader(env.twin.loop.known.robot, 4)
    ranges = np.full_like(scan.ranges, np.inf)
    ranges[:2], ranges[-2:] = (np.nan, 3.0), (-1.0, 0.5 * scan.range_min)
    nearest = reader._ranges(msgspec.structs.replace(scan, ranges=ranges))
    assert nearest.tolist() == [3.0, *3 * [scan.range_max]]


def test_the_monitor_brakes_a_base_that_is_driven_at_an_obstacle():
    reasons, env, _ = driven_at_a_crate()
    assert any(reason.startswith("braking from 0.4") for reason in reasons)
    assert env.view.tick.truth.contacts == ()


def test_a_guarded_base_stops_before_an_obstacle():
    _, env, info = driven_at_a_crate(guard=True)
    assert info["contacts"] == 0
    assert 0.7 < env.view.observation.pose[0] < 0.9


@pytest.mark.parametrize("actions", ["base", "whole_body"])
def test_a_snapshot_goes_on_as_the_run_did(actions):
    env = begun(4, actions=actions, variant="trial2")
    env.action_space.seed(2)
    for _ in range(10):
        env.step(env.action_space.sample())
    there, ahead = env.snapshot(), [env.action_space.sample() for _ in range(15)]
    first = [env.step(action) for action in ahead]
    env.restore(there)
    again = [env.step(action) for action in ahead]
    for one, other in zip(first, again, strict=True):
        assert equal(one[0], other[0]) and one[1:] == other[1:]
    env.reset(seed=5)
    with pytest.raises(ValueError, match="another scene or seed"):
        env.restore(there)


@pytest.mark.slow
def test_the_shipped_method_as_an_expert_picks_what_it_picks_by_itself():
    ticks = []
    env = begun(on_tick=ticks.append)
    expert, info = Expert(env), {"picks": 0}
    while info["picks"] < 1 and len(ticks) < 400:
        *_, info = env.step(expert.action())
    twin, alone = Twin(env.twin.scene), []
    while not (alone and alone[-1].events) and len(alone) < 400:
        alone.append(twin.advance())
    env.step(expert.action())
    through_env = [event for tick in ticks for event in tick.events]
    assert [event.text for event in through_env] == [event.text for event in alone[-1].events]
    assert [event.kind for event in through_env] == ["picked"]
    assert through_env[0].time == pytest.approx(alone[-1].events[0].time, abs=1.0)


@pytest.mark.slow
def test_the_shipped_method_commands_the_whole_body_to_a_pick_and_a_place():
    env = begun(actions="whole_body", weights=RewardWeights(second=0.0))
    expert, total, info = Expert(env), 0.0, {"places": 0, "time_s": 0.0}
    phases = set()
    while info["places"] < 1 and info["time_s"] < 30.0:
        _, earned, _, _, info = env.step(expert.action())
        total += earned
        phases.add(env.view.tick.arm[-1].phase)
    assert info["places"] == 1 and info["contacts"] == 0
    assert total == 20.0
    assert {"closing", "lift", "carry", "release"} <= phases
    assert env.view.observation.gripper_width > 0.04  # it let go


def test_truncated_at_the_time_limit_and_ended_by_a_contact_where_that_is_asked_for():
    env = begun(time_limit=0.2)
    ends = [env.step(zeros(env))[2:4] for _ in range(4)]
    assert ends == [(False, False)] * 3 + [(False, True)]
    env = begun(actions="whole_body", stop_on_contact=True)
    into_the_table = np.array([1.0, 0.28, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0.0, -1.0])
    terminated, total = False, 0.0
    while not terminated and env.view.observation.time < 20.0:
        _, earned, terminated, _, info = env.step(into_the_table)
        total += earned
    assert terminated and info["contacts"] >= 1 and not info["is_success"]
    assert total == pytest.approx(-20.0 * info["contacts"] - info["time_s"])


def test_what_is_no_action_is_refused_and_what_is_too_much_is_clipped():
    env = MotmEnv(variant="trial1")
    for asked in (lambda: env.step(zeros(env)), env.snapshot, lambda: env.restore({"scene": None})):
        with pytest.raises(RuntimeError, match="reset the environment first"):
            asked()
    env.reset(seed=0)
    with pytest.raises(ValueError, match="2 finite numbers"):
        env.step(np.zeros(10))
    with pytest.raises(ValueError, match="finite"):
        env.step(np.array([np.nan, 0.0]))
    one = env.step(np.array([7.0, 0.0]))[0]
    env.reset(seed=0)
    assert equal(one, env.step(FULL_AHEAD)[0])


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"actions": "arm"}, "'base' or 'whole_body'"),
        ({"arm": "mottm"}, "motm"),
        ({"arm": "holistic"}, "base and arm together"),
        ({"arm": "open_loop"}, "no action mode"),
        ({"variant": "nosuch"}, "no variant 'nosuch'"),
        ({"render_mode": "human"}, "rgb_array"),
        ({"beams": 0}, "at least one"),
        ({"time_limit": -1.0}, "positive"),
        ({"scene": "exp9"}, "exp"),
    ],
)
def test_a_wrong_argument_is_named(wrong, said):
    with pytest.raises(ValueError, match=said):
        MotmEnv(**wrong)


@pytest.mark.parametrize(
    ("actions", "method", "said"),
    [
        ("base", "holistic", "base and arm together"),
        ("base", "open_loop", "no action mode can use it"),
        ("whole_body", "open_loop", "no action mode can use it"),
    ],
)
def test_an_expert_that_does_not_fit_is_refused(actions, method, said):
    env = begun(actions=actions)
    with pytest.raises(ValueError, match=said):
        Expert(env, method)


def test_a_scene_of_one_s_own_needs_no_variant_of_the_environment_s():
    own = ROOT / "tests" / "studies" / "half_a_metre.yaml"
    made = gymnasium.make("motm/Exp1Base-v0", scene=str(own))
    assert made.reset(seed=3)[1]["variant"] == ""
    with pytest.raises(ValueError, match="no variant 'random'"):
        MotmEnv(str(own), variant="random")
    assert MotmEnv("exp1", variant=None).reset(seed=0)[1]["variant"] == "trial1"


def test_a_wrong_option_is_named():
    with pytest.raises(ValueError, match="'variant' and 'scene'"):
        MotmEnv().reset(options={"varriant": "trial1"})


def test_each_object_counts_once():
    before = Score(picked=frozenset({"cube"}), lifts=1)
    again = Score(picked=frozenset({"cube"}), lifts=2, drops=1)
    assert reward(RewardWeights(second=0.0), before, again) == -10.0


def test_the_picture_shows_the_world_from_above():
    env = begun(render_mode="rgb_array")
    first = env.render()
    for _ in range(20):
        env.step(FULL_AHEAD)
    later = env.render()
    assert first.shape == later.shape and first.shape[1:] == (800, 3) and first.dtype == np.uint8
    changed = np.flatnonzero((first != later).any(axis=(0, 2)))
    assert changed.size and len(np.unique(first.reshape(-1, 3), axis=0)) > 10


def test_no_ground_truth_is_in_what_the_agent_observes():
    for name in ("observation.py", "actions.py"):
        nodes = ast.walk(ast.parse((ROOT / "motm_twin" / "gym" / name).read_text()))
        seen = {node.attr for node in nodes if isinstance(node, ast.Attribute)}
        assert "truth" not in seen, name


def test_the_text_lists_every_observation():
    text = (ROOT / "docs" / "gym.md").read_text()
    listed = re.findall(r"^\| `(\w+)` \| (\d+|0\.\.\d+) \|", text, re.M)
    space = MotmEnv().observation_space
    shapes = {
        name: f"0..{part.n - 1}" if isinstance(part, gymnasium.spaces.Discrete) else str(part.shape[0])
        for name, part in space.spaces.items()
    }
    assert dict(listed) == shapes
    for name in ENVIRONMENTS:
        assert name in text


def test_what_the_text_shows_runs():
    here = {}
    for block in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "gym.md").read_text(), re.S):
        exec(block, here)  # noqa: S102 - our own text
    assert here["info"]["seed"] == 7 and here["observed"] in here["env"].observation_space
