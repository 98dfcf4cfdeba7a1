"""The private folder of a user on this machine: running twins, secrets, and access to Zenoh ports of this user.

There is one small file per `serve`. The Zenoh password is made once and kept here. Each port that requires it has a
file beside it: the whole Zenoh configuration of a client, which programs without this package can load.
"""

import fcntl
import json
import os
import re
import secrets
import socket
import stat
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

_BYTES = 24


class Running(msgspec.Struct, frozen=True, kw_only=True):
    """Addresses of one `serve`."""

    pid: int
    twin: str
    endpoint: str  # of Zenoh
    page_port: int | None  # None: headless
    page: str = ""  # its address, with the token


def folder() -> Path:
    """The private folder, made when it is missing. Raises PermissionError when another user owns it."""
    path = Path(tempfile.gettempdir()) / f"motm-twin-{os.getuid()}"
    path.mkdir(mode=0o700, exist_ok=True)
    if path.is_symlink() or path.stat().st_uid != os.getuid():
        raise PermissionError(f"{path} belongs to somebody else")
    if path.stat().st_mode & 0o077:
        path.chmod(0o700)
    return path


def own_secret(path: Path, otherwise: str) -> str:
    """The secret in a file of the private folder, made when it is missing; nobody else can read it.

    Raises OSError, with the advice ``otherwise``.
    """
    with _one_at_a_time(path.parent):
        if found := _kept(path):
            return found
        try:  # also replaces a file that is empty, a link, or readable by others
            made = secrets.token_urlsafe(_BYTES)
            write_private(path, made.encode())
        except OSError as error:
            raise OSError(f"{path} cannot be made: {otherwise}") from error
        return made


@contextmanager
def _one_at_a_time(place: Path) -> Iterator[None]:
    """Hold the lock of a folder, against other threads and programs that use it."""
    descriptor = os.open(place, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


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


def keep_fresh() -> None:
    """Touch the private files: systems delete old files from their temporary folder."""
    with suppress(OSError):
        for path in folder().iterdir():
            with suppress(OSError):  # deleted in the meantime
                os.utime(path)


def note(running: Running) -> Path:
    """Write the file of a `serve`; the caller removes it at the end."""
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


USER = "here"
FILE = "zenoh-password"  # in the user's private folder
_OF_PORT = re.compile(r"zenoh-(\d{1,5})\.json5")  # names of `client_file`
_LOCAL = re.compile(r"tcp/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):(\d{1,5})([?#].*)?")
_LOOK = 0.5  # [s] for a listener on this machine to take a connection


class Credentials(NamedTuple):
    """User name and password of a Zenoh session."""

    user: str
    password: str


def own_credentials() -> Credentials:
    """Credentials of this user, made when they are missing. Raises OSError."""
    return Credentials(USER, own_secret(folder() / FILE, "see who owns that folder"))


def client_file(port: int) -> Path:
    """Zenoh configuration that lets a program in at a port of this user."""
    return folder() / f"zenoh-{port}.json5"


def guard(port: int, endpoint: str, others: Iterable[str] = ()) -> Path:
    """Require the password at a port; returns the file of valid passwords for its Zenoh session.

    ``others``: further lines "user:password" of that list. Raises OSError.
    """
    own = own_credentials()
    announce(port, endpoint, own)
    lines = [*(line for line in others if line.partition(":")[0] != USER), ":".join(own)]
    return write_private(folder() / f"zenoh-{port}.users", ("\n".join(lines) + "\n").encode())


def announce(port: int, endpoint: str, own: Credentials | None) -> None:
    """Write the file of a port at which this process listens; without a password the port is open. Raises OSError."""
    settings = {
        "metadata": {"pid": os.getpid()},
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"auth": {"usrpwd": dict.fromkeys(Credentials._fields) if own is None else own._asdict()}},
    }
    for path in folder().iterdir():
        found = _OF_PORT.fullmatch(path.name)
        if found is not None and _announced(other := int(found[1])) is None:  # its process is gone
            forget(other)
    write_private(client_file(port), (json.dumps(settings, indent=2) + "\n").encode())


def forget(port: int) -> bool:
    """Remove the files of a port; False when another living process of this user has announced it."""
    with suppress(OSError):  # no folder, no files
        announced = _announced(port)
        if announced is not None and announced["metadata"]["pid"] != os.getpid():
            return False
        for path in (client_file(port), folder() / f"zenoh-{port}.users"):
            path.unlink(missing_ok=True)
    return True


def known_at(endpoint: str) -> dict[str, str | None] | None:
    """User and password for a port of this user, null for an open one; None when no process of this user listens."""
    port = _local_port(endpoint)
    announced = None if port is None else _announced(port)
    return None if announced is None else announced["transport"]["auth"]["usrpwd"]


def to_come(endpoint: str) -> bool:
    """True when no program listens there yet: a twin of this user may later, and will require the password."""
    if (port := _local_port(endpoint)) is None:
        return False
    host = endpoint.removeprefix("tcp/").rpartition(":")[0].strip("[]")
    try:
        socket.create_connection((host, port), _LOOK).close()
    except (OSError, OverflowError):
        return True
    return False


def _local_port(endpoint: str) -> int | None:
    found = _LOCAL.fullmatch(endpoint)
    return None if found is None else int(found[2])


def _announced(port: int) -> dict[str, Any] | None:
    """Content of the file of a port; None when it is not ours, or its process has ended."""
    try:
        found = json.loads(client_file(port).read_bytes())
        return found if lives(found["metadata"]["pid"]) and "usrpwd" in found["transport"]["auth"] else None
    except (OSError, ValueError, LookupError, TypeError):
        return None


def write_private(path: Path, data: bytes, mode: int = 0o600) -> Path:
    """Write a file atomically; no one else can read it unless ``mode`` allows that."""
    descriptor, new = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(descriptor, "wb") as file:
        file.write(data)
        os.fchmod(descriptor, mode)
    return Path(new).replace(path)
