"""The arm keeps a posture from which it can do the next job."""

import numpy as np

from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin


def test_the_arm_does_not_twist_between_jobs():
    """Release at full stretch, then swing to the next cube: joints 3 and 5 must not wander to their limits.

    From there the hand reaches the cube only lying on its side, and no sight of the cube ever comes. What helps: a
    posture cost that keeps joints 3 and 5 near zero (joints 1, 2, 4, 6, 7 reach every top-down pose), references for
    transit and carry in cylinder coordinates about the arm's axis, and a way out by joint space when nothing moves.
    """
    twin = Twin(load_scene("exp1a", "trial1", 0))
    worst = np.zeros(7)
    while twin.index < 600:
        tick = twin.advance()
        worst = np.maximum(worst, np.abs(tick.observation.q))
        if tick.truth.picks == 2 and tick.arm[-1].phase == "carry":
            break
    assert worst[2] < 1.5, f"joint 3 turned to {worst[2]:.2f} rad"
    assert worst[4] < 1.5, f"joint 5 turned to {worst[4]:.2f} rad"
    assert tick.truth.picks == 2
