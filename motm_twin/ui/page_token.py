"""The secret of a user's pages: who has it may look and drive. Kept in a private file: an open page stays open."""

import os

from motm_twin.bus.private_folder import folder, own_secret

VARIABLE = "MOTM_TOKEN"
FILE = "page-token"  # in the user's private folder


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
    return own_secret(folder() / FILE, "use --token or MOTM_TOKEN")
