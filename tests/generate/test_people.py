"""Crowds from a seed: the same text for the same seed, places as CrowdNav draws them."""

import math

import numpy as np
import pytest

from motm_twin.generate.people import CIRCLE, LEVELS, RADIUS, ROBOT_RADIUS, made
from motm_twin.model.scene_error import SceneError
from motm_twin.model.scene_file import load_scene


@pytest.mark.parametrize("name", ["circle:4", "square:4", "dynabarn:4"])
def test_a_seed_gives_the_same_text_and_another_seed_another_one(name):
    assert made(name) == made(name)
    assert made(name)[1].split("\n", 2)[2] != made(name.replace("4", "5"))[1].split("\n", 2)[2]


@pytest.mark.parametrize("seed", range(20))
def test_five_persons_cross_the_circle_and_keep_apart_at_start_and_goal(seed):
    scene = load_scene(f"circle:{seed}")
    assert (scene.start[:2], scene.tasks[0].point, scene.time_limit) == ((0.0, -4.0), (0.0, 4.0), 25.0)
    assert scene.robot.base.forward_speed == 1.0
    assert len(scene.agents) == 5
    places = [(scene.start[:2], RADIUS + ROBOT_RADIUS + 0.2)]
    for agent in scene.agents:
        assert (agent.behaviour, agent.radius, agent.speed, agent.sees_robot) == ("orca", 0.3, 1.0, True)
        assert np.allclose(agent.waypoints[0], -np.array(agent.start[:2]), atol=1e-4)
        assert abs(math.hypot(*agent.start[:2]) - CIRCLE) <= math.hypot(0.5, 0.5)
        assert all(math.dist(agent.start[:2], place) >= gap - 1e-3 for place, gap in places)
        places.append((agent.start[:2], 2.0 * RADIUS + 0.2))


def test_the_invisible_robot_is_a_variant_with_the_same_ways():
    seen, unseen = load_scene("circle:7", "visible"), load_scene("circle:7", "invisible")
    assert [agent.start for agent in seen.agents] == [agent.start for agent in unseen.agents]
    assert not any(agent.sees_robot for agent in unseen.agents)


@pytest.mark.parametrize("seed", range(5))
def test_persons_of_the_square_go_from_one_half_to_the_other(seed):
    for agent in load_scene(f"square:{seed}").agents:
        (x, y), (goal_x, goal_y) = agent.start[:2], agent.waypoints[0]
        assert x * goal_x <= 0.0
        assert max(map(abs, (x, y, goal_x, goal_y))) <= 5.0


@pytest.mark.parametrize("level", LEVELS)
def test_cylinders_of_every_level_move_at_its_speeds_on_the_same_ways(level):
    scene, easy = load_scene("dynabarn:3", level), load_scene("dynabarn:3", "easy")
    slow, quick = LEVELS[level]
    assert all(slow <= agent.speed <= quick and agent.radius == 0.5 for agent in scene.agents)
    assert [agent.waypoints for agent in scene.agents] == [agent.waypoints for agent in easy.agents]


@pytest.mark.parametrize("name", ["circle:", "circle:x", "square:-1", "dynabarn:99999999999999999999"])
def test_what_is_no_crowd_is_refused(name):
    with pytest.raises(SceneError):
        load_scene(name)
