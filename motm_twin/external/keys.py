"""Zenoh keys between a twin and its robot: everything lives below ``motm/<twin>/plant/``."""

from motm_twin.bus.keys import DEFAULT_TWIN, PREFIX, Keys


class PlantKeys:
    """Key expressions of the robot of one twin. Direction: from the robot (>), to the robot (<), question (?)."""

    def __init__(self, twin: str = DEFAULT_TWIN) -> None:
        Keys(twin)  # checks the name
        self.twin = twin
        root = f"{PREFIX}/{twin}/plant"
        self.root = root
        self.alive = f"{root}/alive"  # > liveliness token
        self.info = f"{root}/info"  # ? Info
        self.state = f"{root}/state"  # > RobotState, 100 Hz
        self.scan = f"{root}/scan"  # > ScanData, every sweep
        self.detections = f"{root}/detections"  # > DetectionList, every frame of the camera
        self.command = f"{root}/command"  # < RobotCommand, 100 Hz
        self.clock = f"{root}/clock"  # > ClockReached, shared clock only
        self.grant = f"{root}/grant"  # < ClockGrant, shared clock only
        self.truth = f"{root}/truth"  # > TruthData, 20 Hz; simulated robots only
        self.reset = f"{root}/reset"  # ? ResetRequest -> PlantAnswer
        self.edit = f"{root}/edit"  # ? EditRequest -> PlantAnswer
        self.tasks = f"{root}/tasks"  # ? TaskNotice -> PlantAnswer

    @property
    def told(self) -> tuple[str, ...]:
        """Those on which nobody but the twin says anything."""
        return self.command, self.grant

    @property
    def asked(self) -> tuple[str, ...]:
        """Those that nobody but the twin asks."""
        return self.reset, self.edit, self.tasks
