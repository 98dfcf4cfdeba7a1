"""JSON Schemas of what twin and robot say to each other: ``python -m motm_twin.external.schemas`` writes the files."""

from pathlib import Path
from typing import Any

import msgspec

from motm_twin.bus.schemas import schema_of
from motm_twin.external.messages import (
    VERSION,
    ClockGrant,
    ClockReached,
    DetectionList,
    EditRequest,
    Info,
    PlantAnswer,
    ResetRequest,
    RobotCommand,
    RobotState,
    ScanData,
    TaskNotice,
    TruthData,
)

FOLDER = Path(__file__).parents[2] / "docs" / "schemas" / "plant"
KINDS: dict[str, type[msgspec.Struct]] = {
    "info": Info,
    "state": RobotState,
    "scan": ScanData,
    "detections": DetectionList,
    "command": RobotCommand,
    "clock": ClockReached,
    "grant": ClockGrant,
    "truth": TruthData,
    "reset": ResetRequest,
    "edit": EditRequest,
    "tasks": TaskNotice,
    "answer": PlantAnswer,
}


def plant_schema(name: str) -> dict[str, Any]:
    """The schema of the message of a key below ``plant/``, or of the ``answer`` to a request."""
    return schema_of(KINDS[name], f"{VERSION}/{name}")


def text(name: str) -> str:
    """The file of a schema."""
    return msgspec.json.format(msgspec.json.encode(plant_schema(name)), indent=2).decode() + "\n"


def path(name: str) -> Path:
    """Where it is kept, in its version."""
    return FOLDER / f"{name}.{VERSION.rsplit('/', 1)[-1]}.json"


def main() -> None:
    """Write all files."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in KINDS:
        path(name).write_text(text(name), encoding="utf-8")


if __name__ == "__main__":
    main()
