"""The private folder of a user on this machine: which twins run, one small file per `serve`, and the user's secrets."""

import json
import os
import secrets
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

import msgspec

_BYTES, _TRIES = 24, 3


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """Addresses of one `serve`."""

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
    if path.stat().st_mode & 0o077:
        path.chmod(0o700)
    return path


def own_secret(path: Path, otherwise: str) -> str:
    """The secret in a file of the private folder, made when it is missing; nobody else can read it.

    Raises OSError, with what to do ``otherwise``.
    """
    for _ in range(_TRIES):
        if found := _kept(path):
            return found
        path.unlink(missing_ok=True)  # empty, a link, or readable by others: not secret
        with tempfile.NamedTemporaryFile(dir=path.parent) as file:  # readable by the user only
            file.write(secrets.token_urlsafe(_BYTES).encode())
            file.flush()
            with suppress(FileExistsError):  # another program has just made it
                os.link(file.name, path)
    raise OSError(f"{path} cannot be made: {otherwise}")


def _kept(path: Path) -> str:
    """The secret in the file; "" without one that only the user can read."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return ""
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        private = stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
        return file.read(200).decode("ascii", "replace") if private else ""


def keep_young() -> None:
    """Touch the private files: systems clear old ones out of the folder for temporary files."""
    with suppress(OSError):
        for path in folder().iterdir():
            with suppress(OSError):  # it has just gone
                os.utime(path)


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
        if lives(running.pid):
            found.append(running)
        else:
            path.unlink(missing_ok=True)
    return found


def lives(pid: int) -> bool:
    """True when a process with this number exists."""
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True
