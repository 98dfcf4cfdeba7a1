"""What was announced to the robot from this page: a tick does not tell."""

from motm_twin.bus.messages import TickMessage

Pose = tuple[float, float, float]  # x, y [m], turn [rad]


class Told:
    """Where each announced piece of furniture stood then."""

    def __init__(self) -> None:
        self._began = -1.0
        self._poses: dict[str, Pose] = {}

    def hear(self, name: str, tick: TickMessage | None) -> None:
        """The robot was told of a piece, in this period."""
        pose = None if tick is None else _poses(tick).get(name)
        if tick is None or pose is None:
            return
        if tick.began != self._began:  # another load or reset
            self._began, self._poses = tick.began, {}
        self._poses = {**self._poses, name: pose}

    def now(self, tick: TickMessage) -> frozenset[str]:
        """The pieces that still stand where the robot was told."""
        if tick.began != self._began:
            return frozenset()
        return frozenset(name for name, pose in _poses(tick).items() if self._poses.get(name) == pose)


def _poses(tick: TickMessage) -> dict[str, Pose]:
    return {body.name: (body.position[0], body.position[1], body.yaw) for body in tick.furniture}
