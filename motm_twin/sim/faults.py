"""Sensors that fail for a while, as a person or a test wants it."""

from dataclasses import dataclass, field

from motm_twin.model.edits import InjectFault

LIDAR_OFF, CAMERA_OFF, CAMERA_DELAY = "lidar_off", "camera_off", "camera_delay"
SHORTEST, LONGEST = 0.05, 30.0  # [s] that a fault lasts
LONGEST_DELAY = 3.0  # [s] of the camera


@dataclass
class FaultState:
    """Faults that last, and the camera's delay."""

    until: dict[str, int] = field(default_factory=dict)  # fault: substep at which it is over
    delay: int = 0  # substeps by which the camera is late

    def active(self, fault: str) -> bool:
        """Whether a sensor fails in this way now."""
        return fault in self.until


def inject(state: FaultState, edit: InjectFault, now: int, substep: float) -> None:
    """Begin a fault at substep ``now``, or let it last from now on as the edit says."""
    state.until[edit.fault] = now + max(1, round(edit.seconds / substep))
    if edit.fault == CAMERA_DELAY:
        state.delay = round(edit.delay / substep)


def expire(state: FaultState, now: int) -> None:
    """Forget the faults that are over at substep ``now``."""
    for fault in [fault for fault, until in state.until.items() if until <= now]:
        del state.until[fault]


def phrases(state: FaultState, now: int, substep: float) -> tuple[str, ...]:
    """What fails, and for how long still: one phrase each."""
    kinds = {
        LIDAR_OFF: "lidar off",
        CAMERA_OFF: "camera off",
        CAMERA_DELAY: f"camera {state.delay * substep:.2f} s late",
    }
    return tuple(f"{kinds[fault]} for {(until - now) * substep:.1f} s" for fault, until in sorted(state.until.items()))
