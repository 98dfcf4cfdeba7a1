"""Goals of the hand: an object is let go over the rim of a bin, or over what was seen to lie higher in it."""

import numpy as np
import pytest

from motm_twin.control.targets import Targets, odometry_to_world
from motm_twin.model.known import known_world
from motm_twin.model.scene import Place
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.objects import ObjectTracker
from motm_twin.planning.parameters import ReachParameters
from motm_twin.sim.plant import SimulatedPlant


@pytest.mark.parametrize(
    ("height", "sd", "aside", "higher"),
    [
        (0.06, 0.005, 0.0, 0.08),  # a pile: its top counts
        (-0.04, 0.005, 0.0, 0.0),  # below the rim
        (0.06, 0.05, 0.0, 0.0),  # only believed to be somewhere in the bin
        (0.06, 0.005, 0.3, 0.0),  # beside the bin
    ],
)
def test_an_object_is_let_go_over_the_rim_or_over_what_was_seen_to_lie_higher(height, sd, aside, higher):
    scene = load_scene("shelf_run", "one_trolley")
    known = known_world(scene)
    tracker, observation = ObjectTracker(known), SimulatedPlant(scene).observe()
    targets, frame = Targets(known, tracker, ReachParameters()), odometry_to_world(observation)
    place = next(each for each in known.bins if each.name == "order_2")
    seen = np.array([place.centre[0] + aside, place.centre[1], place.rim_z + height])
    lies = known.objects[0]
    tracker.move_belief(lies.name, np.array([*seen]), observation, sd)
    assert np.allclose(frame, 0.0, atol=0.1)  # odometry begins in the world
    goal = targets.arm_goal(Place(bin="order_2"), known.objects[1].name, observation, frame)
    assert goal.position[2] == pytest.approx(place.rim_z + higher)
    assert lies.side == pytest.approx(0.04)
