"""Whether two bodies would touch if a person had not moved one of them."""

import math

import coal
import numpy as np

from motm_twin.model.exact import product, times
from motm_twin.model.geometry import Array
from motm_twin.sim.blame import Motion, explains, in_time, undone

Placed = tuple[coal.CollisionGeometry, coal.Transform3s]


class Without:
    """Measures the pair of a contact where it would be without what persons did."""

    def __init__(self) -> None:
        """Room for the answers of the distance library."""
        self._request, self._result = coal.DistanceRequest(), coal.DistanceResult()

    def persons_doing(
        self, motions: tuple[Motion, Motion], now: float, *, robot: Placed, other: Placed, closing: float
    ) -> bool:
        """Whether a contact that begins now [s] is the doing of a person who moved the other body or the robot.

        ``motions``: of the other body, and of the robot; ``closing`` [m/s]: how fast the robot comes towards the other.
        """
        of_other, of_robot = motions
        if any(in_time(now, motion.came) for motion in motions):
            return True
        pairs = [(robot, (other[0], _moved(back, other[1]))) for back in undone(of_other, now)]
        pairs += [((robot[0], _moved(back, robot[1])), other) for back in undone(of_robot, now)]
        return any(explains(self._gap(*pair), closing) for pair in pairs)

    def _gap(self, robot: Placed, other: Placed) -> float:
        self._result.clear()
        return coal.distance(*robot, *other, self._request, self._result)


def _moved(planar: Array, transform: coal.Transform3s) -> coal.Transform3s:
    """A transform after a planar one of the world."""
    c, s = math.cos(planar[2]), math.sin(planar[2])
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    shift = np.array([planar[0], planar[1], 0.0])
    return coal.Transform3s(product(turn, transform.getRotation()), times(turn, transform.getTranslation()) + shift)
