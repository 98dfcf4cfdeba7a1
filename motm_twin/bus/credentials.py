"""Access to a Zenoh port of this user, for programs that have the user's password.

The password is made once, and kept in the user's private folder. Each port that asks for it has a file beside it: the
whole Zenoh configuration of a client, which programs without this package load as it is.
"""

import json
import os
import re
import socket
import tempfile
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from motm_twin.bus.private_folder import folder, lives, own_secret

USER = "here"
FILE = "zenoh-password"  # in the user's private folder
_LOCAL = re.compile(r"tcp/(127\.\d+\.\d+\.\d+|localhost|\[::1\]):(\d{1,5})([?#].*)?")
_LOOK = 0.5  # [s] for a listener on this machine to take a connection


class Credentials(NamedTuple):
    """User name and password of a Zenoh session."""

    user: str
    password: str


def own_credentials() -> Credentials:
    """Those of this user, made when they are missing. Raises OSError."""
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
    return _write(folder() / f"zenoh-{port}.users", "\n".join(lines) + "\n")


def announce(port: int, endpoint: str, own: Credentials | None) -> None:
    """Write the file of a port at which this process listens; without a password the port is open. Raises OSError."""
    settings = {
        "metadata": {"pid": os.getpid()},
        "mode": "client",
        "connect": {"endpoints": [endpoint]},
        "scouting": {"multicast": {"enabled": False}, "gossip": {"enabled": False}},
        "transport": {"auth": {"usrpwd": dict.fromkeys(Credentials._fields) if own is None else own._asdict()}},
    }
    for path in folder().glob("zenoh-*.json5"):
        if _announced(other := int(path.stem.removeprefix("zenoh-"))) is None:  # its process is gone
            forget(other)
    _write(client_file(port), json.dumps(settings, indent=2) + "\n")


def forget(port: int) -> None:
    """Remove the files of a port at which nobody else of this user listens."""
    with suppress(OSError):  # no folder, no files
        announced = _announced(port)
        if announced is None or announced["metadata"]["pid"] == os.getpid():
            for path in (client_file(port), folder() / f"zenoh-{port}.users"):
                path.unlink(missing_ok=True)


def known_at(endpoint: str) -> dict[str, str | None] | None:
    """User and password, or neither, for a port of this user; None: no process of this user listens there."""
    port = _local_port(endpoint)
    announced = None if port is None else _announced(port)
    return None if announced is None else announced["transport"]["auth"]["usrpwd"]


def to_come(endpoint: str) -> bool:
    """True when nobody listens there yet: a twin of this user may, and will ask for the password."""
    port = _local_port(endpoint)
    return port is not None and not _somebody_listens(endpoint, port)


def _local_port(endpoint: str) -> int | None:
    found = _LOCAL.fullmatch(endpoint)
    return None if found is None else int(found[2])


def _announced(port: int) -> dict[str, Any] | None:
    """The file of a port; None when the process that wrote it is gone."""
    try:
        found = json.loads(client_file(port).read_bytes())
    except (OSError, ValueError):
        return None
    return found if lives(found["metadata"]["pid"]) else None


def _somebody_listens(endpoint: str, port: int) -> bool:
    host = endpoint.removeprefix("tcp/").rpartition(":")[0].strip("[]")
    try:
        socket.create_connection((host, port), _LOOK).close()
    except (OSError, OverflowError):
        return False
    return True


def _write(path: Path, text: str) -> Path:
    """Write atomically, never readable by others."""
    descriptor, new = tempfile.mkstemp(dir=path.parent)
    with os.fdopen(descriptor, "w", encoding="utf-8") as file:
        file.write(text)
    return Path(new).replace(path)
