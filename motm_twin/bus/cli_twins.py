"""`motm-twin twins`."""

import math
import sys

import msgspec

from motm_twin.client.discover import BEHIND, Found, NoTwin, running_twins
from motm_twin.console import printable
from motm_twin.exit_codes import FAILED, OK


def twins(endpoint: str | None, *, as_json: bool) -> int:
    """Print who is there; the exit code."""
    try:
        found = running_twins(endpoint)
    except NoTwin as error:
        print(f"motm-twin twins: {error}", file=sys.stderr)
        return FAILED
    for twin in found:
        print(msgspec.json.encode(twin).decode() if as_json else printable(_line(twin)))
    if not found and not as_json:
        where = "on this machine" if endpoint is None else f"at {endpoint}: {BEHIND}"
        print(f"motm-twin twins: none is running {where}", file=sys.stderr)
    return OK if any(twin.alive for twin in found) else FAILED


def _line(twin: Found) -> str:
    page = f"  page: {twin.page}" if twin.page else ""
    if not twin.alive:
        return f"{twin.twin}  {twin.endpoint}{page}  does not answer"
    driver = f"  driven by {twin.driver}" if twin.driver else ""
    minutes = math.floor(twin.time / 60.0)
    return (
        f"{twin.twin}  {twin.endpoint}{page}  {twin.scene}: {twin.state} at {minutes}:{twin.time % 60.0:04.1f}{driver}"
    )
