"""Changed parameters as a person writes them: ``--set next_weight=0 --set bezier=off``."""

import contextlib
import math
from collections.abc import Iterable

from motm_twin.control.tuning import check, parameter
from motm_twin.model.edits import ParameterValue
from motm_twin.sessions.session import Session, SessionError

PERIODS_PER_SECOND = 20
_SWITCH = {"true": True, "on": True, "yes": True, "false": False, "off": False, "no": False}

Changes = dict[str, ParameterValue]


def parse_changes(texts: Iterable[str]) -> Changes:
    """Names and checked values of ``name=value`` texts. Raises SessionError with what is allowed."""
    changes: Changes = {}
    for text in texts:
        name, sign, value = text.partition("=")
        if not sign:
            raise SessionError(f"--set {text[:80]}: write name=value, for instance next_weight=0.5")
        if name.strip() in changes:
            raise SessionError(f"--set {text[:80]}: {name.strip()} is set twice, once is enough")
        try:
            changes[name.strip()] = _value(name.strip(), value.strip())
        except ValueError as error:
            raise SessionError(f"--set {text[:80]}: {error}") from error
    if not changes:
        raise SessionError("nothing is changed: give at least one --set name=value")
    return changes


def start_period(session: Session, seconds: float) -> int:
    """The period that begins at this time of the session. Raises SessionError when it has none."""
    recorded = session.periods / PERIODS_PER_SECOND
    if not (math.isfinite(seconds) and 0.0 <= seconds <= recorded):
        raise SessionError(f"--from {seconds:g}: the session has 0 to {recorded:g} s, choose a time in it")
    return round(seconds * PERIODS_PER_SECOND)


def _value(name: str, text: str) -> ParameterValue:
    entry = parameter(name)
    value: ParameterValue = text
    if entry.kind == "switch":
        value = _SWITCH.get(text.lower(), text)
    elif entry.kind == "number":
        with contextlib.suppress(ValueError):  # what is no number is refused by `check`, which knows the range
            value = float(text)
    return check(name, value)
