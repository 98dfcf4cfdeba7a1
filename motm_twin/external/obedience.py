"""Commands of the twin that the robot refuses, and whether somebody else commands in the twin's name."""

from motm_twin.external.messages import RobotState

TOLD_FOR = 3.0  # [s] for which a refusal is told
_LONGEST = 200  # characters of a robot's reason


class Obedience:
    """Follows the states of one life of a robot; times [s] are monotonic and come in as arguments."""

    def __init__(self) -> None:
        self._count, self._reason = -1, ""
        self._refused_at = self._forged_at = -1e9

    def state(self, state: RobotState, received: float, newest: int) -> None:
        """Take a state into account; ``newest``: the highest number that the twin has given a command."""
        if state.refused > self._count >= 0:
            self._refused_at, self._reason = received, state.refusal
        self._count = state.refused
        if any(seq > newest for seq, _ in state.heard):
            self._forged_at = received

    def text(self, now: float) -> str:
        """The clause after a sentence about the robot; "" when it obeys."""
        said = ""
        if now - self._refused_at < TOLD_FOR:
            said = f"; it refuses commands, {self._count} so far: {self._reason[:_LONGEST]}"
        return said + ("; somebody else commands in this twin's name" if now - self._forged_at < TOLD_FOR else "")
