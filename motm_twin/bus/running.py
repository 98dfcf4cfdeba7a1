"""Which twins this user has running on this machine: one small file per `serve`, for the health check."""

import json
import os
import tempfile
from pathlib import Path

import msgspec


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """Where one `serve` is reached."""

    pid: int
    twin: str
    endpoint: str  # of Zenoh
    page_port: int | None  # None: headless
    page: str = ""  # its address, with the token


def folder() -> Path:
    """The private folder of these files, made when it is missing. Raises PermissionError when it is not ours."""
    path = Path(tempfile.gettempdir()) / f"motm-twin-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    if path.is_symlink() or path.stat().st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to somebody else")
    return path


def note(running: Running) -> Path:
    """Write the file of a `serve`; remove it at the end."""
    path = folder() / f"{running.pid}.json"
    path.write_bytes(msgspec.json.encode(running))
    return path


def all_running() -> list[Running]:
    """Every `serve` whose process lives; files of dead ones are removed."""
    found = []
    for path in sorted(folder().glob("*.json")):
        try:
            running = msgspec.json.decode(path.read_bytes(), type=Running)
        except (OSError, msgspec.DecodeError, json.JSONDecodeError):
            continue
        if _lives(running.pid):
            found.append(running)
        else:
            path.unlink(missing_ok=True)
    return found


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
