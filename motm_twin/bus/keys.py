"""Zenoh keys of one twin, below ``motm/<twin>/``; those of an external robot are below ``plant/``."""

import re
from typing import Any

PREFIX = "motm"
DEFAULT_TWIN = "frankie"
DEFAULT_PORT = 7447  # Zenoh's own
_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")


class Keys:
    """Key expressions of the twin with the given name."""

    def __init__(self, twin: str = DEFAULT_TWIN) -> None:
        if not is_name(twin):
            raise ValueError(f"twin name {twin!r}: use 1 to 40 letters, digits, '_' or '-'")
        self.twin = twin
        root = self._root = f"{PREFIX}/{twin}"
        self.tick = f"{root}/tick"  # JSON, every period
        self.grid = f"{root}/grid"  # raw bytes with an attachment, on change
        self.scene = f"{root}/scene"  # JSON with an attachment, on change; answers queries
        self.status = f"{root}/status"  # JSON, on change and twice a second; answers queries
        self.robot = f"{root}/robot"  # JSON at 50 Hz: base, joints, gripper, frames
        self.scan = f"{root}/scan"  # JSON, every new sweep of the lidar
        self.observations = f"{root}/observations"  # JSON, every period of an external robot: what reruns it
        self.event = f"{root}/event"  # JSON, reliable and numbered; answers queries with its history
        self.metrics = f"{root}/metrics"  # JSON, once a second
        self.session = f"{root}/session"  # JSON of the run so far; answers queries only
        self.schemas = f"{root}/schema/**"  # JSON Schema of every message; answers queries only
        self.alive = f"{root}/alive"  # liveliness token
        self.commands = f"{root}/cmd/**"
        self.own = (
            *(self.tick, self.grid, self.scene, self.status, self.robot, self.scan, self.event, self.metrics),
            *(self.observations, self.session, self.schemas, self.alive, self.commands),
        )  # only the server publishes here

    def schema(self, name: str) -> str:
        """Key that the schema of this name is asked for at."""
        return f"{self._root}/schema/{name}"

    def command(self, name: str) -> str:
        """Key that the command of this name is sent to."""
        return f"{self._root}/cmd/{name}"

    def command_in(self, key: str) -> str:
        """The name of the command that is sent to this key, one of `commands`."""
        return key.removeprefix(f"{self._root}/cmd/")


def is_name(text: str) -> bool:
    """The name is allowed for a twin."""
    return _NAME.match(text) is not None


def spoken_on(heard: Any, key: str) -> bool:
    """The sample or query was sent to exactly this key.

    One sent to a wildcard reaches every matching key, past the access control of each.
    """
    return str(heard.key_expr) == key


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
    def from_twin(self) -> tuple[str, ...]:
        """Keys on which only the twin publishes."""
        return self.command, self.grant

    @property
    def queried_by_twin(self) -> tuple[str, ...]:
        """Keys that only the twin queries."""
        return self.reset, self.edit, self.tasks
