"""The secret of a user's pages: who has it may look and drive. Kept in a private file: an open page stays open."""

import os
import secrets
import stat
import tempfile
from contextlib import suppress
from pathlib import Path

from motm_twin.bus.running import folder

VARIABLE = "MOTM_TOKEN"
FILE = "page-token"  # in the user's private folder
_BYTES, _TRIES = 24, 3


def chosen_token(given: str | None, *, none: bool) -> str | None:
    """The token to ask for: the one that is given or in MOTM_TOKEN, else the user's own; None when ``none`` is wanted.

    Raises ValueError for both wishes at once, OSError when the user's own can not be kept.
    """
    if given is not None and none:
        raise ValueError("--token and --no-token exclude each other")
    if none:
        return None
    return given or os.environ.get(VARIABLE) or own_token()


def own_token() -> str:
    """The user's token, made when it is missing; nobody else can read it. Raises OSError."""
    path = folder() / FILE
    for _ in range(_TRIES):
        if found := _kept(path):
            return found
        path.unlink(missing_ok=True)  # empty, a link, or readable by others: nobody's secret
        with tempfile.NamedTemporaryFile(dir=path.parent) as file:  # readable by the user only
            file.write(secrets.token_urlsafe(_BYTES).encode())
            file.flush()
            with suppress(FileExistsError):  # another program has just made it
                os.link(file.name, path)
    raise OSError(f"{path} cannot be made: use --token or MOTM_TOKEN")


def _kept(path: Path) -> str:
    """The token in the file; "" when there is none that is only the user's."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
    except OSError:
        return ""
    with os.fdopen(descriptor, "rb") as file:
        status = os.fstat(descriptor)
        private = stat.S_ISREG(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & 0o077
        return file.read(200).decode("ascii", "replace") if private else ""
