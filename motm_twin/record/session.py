"""A session: everything that repeats a run bit for bit. Kept as one JSON file."""

import msgspec

from motm_twin.model.edits import Edit, ParameterValue
from motm_twin.model.scene import Scene

SESSION_VERSION = "motm.session/1"


class LoggedEdit(msgspec.Struct, frozen=True, kw_only=True):
    """An edit, and the period at whose start it was applied."""

    index: int
    edit: Edit


class Cut(msgspec.Struct, frozen=True, kw_only=True):
    """A search that the clock ended: the period, and the expansions after which it did."""

    index: int
    expansions: int


class Session(msgspec.Struct, frozen=True, kw_only=True):
    """A run up to the end of period ``periods - 1``, and the hash of its state there."""

    version: str = SESSION_VERSION
    title: str = ""
    scene: Scene  # resolved: a later change of the scene file does not change the session
    parameters: dict[str, ParameterValue] = {}  # of `control.tuning`, set before the first period
    edits: tuple[LoggedEdit, ...] = ()
    cuts: tuple[Cut, ...] = ()
    periods: int = 0
    state_hash: str = ""
