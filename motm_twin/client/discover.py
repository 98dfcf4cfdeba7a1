"""Discovery of twins: those that this user runs on this machine, or those behind an endpoint."""

import time
from collections.abc import Callable
from typing import TypeVar

import msgspec
import zenoh

from motm_twin.bus.connection import PREFIX, Keys, answers, configured_endpoint, is_name, open_client
from motm_twin.bus.messages import StatusMessage
from motm_twin.bus.private_folder import all_running

TIMEOUT = 2.0  # [s]
AGAIN = 0.05  # [s] between two queries
BEHIND = 'behind a router, MOTM_ZENOH_CONFIG must say mode "client" (docs/scale.md)'
OPTIONS = "--twin or --endpoint"  # command-line options that choose a twin
T = TypeVar("T")


class NoTwin(Exception):
    """There is no twin to connect to, or more than one; the message says what to do."""


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """A twin that was found."""

    twin: str
    endpoint: str
    page_port: int | None = None  # on this machine
    page: str = ""  # its address there, with the token
    alive: bool = False  # its server answers
    state: str = ""
    scene: str = ""
    time: float = 0.0  # [s] simulated
    driver: str = ""


def running_twins(endpoint: str | None = None) -> list[Found]:
    """Every twin behind an endpoint; without one, those where MOTM_ZENOH_CONFIG leads, or of this user here.

    Raises ConfigError when that file can not be used.
    """
    endpoint = endpoint or configured_endpoint()
    if endpoint is not None:
        with opened(endpoint) as session:
            return [_asked(session, Found(twin=name, endpoint=endpoint)) for name in _alive(session)]
    found = []
    for note in all_running():
        with opened(note.endpoint) as session:
            known = Found(twin=note.twin, endpoint=note.endpoint, page_port=note.page_port, page=note.page)
            found.append(_asked(session, known))
    return found


def find(endpoint: str | None, twin: str | None, *, how: str = "twin= or endpoint=") -> tuple[str, str]:
    """Endpoint and name of the wanted twin; ``how``: options that choose one, for the error message.

    An endpoint configured in MOTM_ZENOH_CONFIG takes precedence over the twins that run on this machine. Raises NoTwin
    unless there is exactly one twin, and ConfigError when that file can not be used.
    """
    endpoint = endpoint or configured_endpoint()
    if endpoint is not None and twin is not None:
        return endpoint, twin
    if endpoint is not None:
        with opened(endpoint) as session:
            names = [(endpoint, name) for name in _alive(session)]
    else:
        names = [(note.endpoint, note.twin) for note in all_running() if twin in (None, note.twin)]
    if len(names) == 1:
        return names[0]
    where = "on this machine" if endpoint is None else f"at {endpoint}"
    called = "" if twin is None else f" called {twin!r}"
    if not names:
        advice = "start one with `motm-twin serve`, or give its endpoint" if endpoint is None else BEHIND
        raise NoTwin(f"no twin{called} is running {where}: {advice}")
    listed = ", ".join(f"{name} at {place}" for place, name in names)
    raise NoTwin(f"{len(names)} twins{called} are running {where} ({listed}): say which one with {how}")


def opened(endpoint: str) -> zenoh.Session:
    """A session with an endpoint. Raises NoTwin when it does not open at once and the configuration demands that."""
    try:
        return open_client(endpoint)
    except zenoh.ZError as error:
        raise NoTwin(f"nobody answers at {endpoint}: is the server running there, and does it let you in?") from error


def require_answer(session: zenoh.Session, twin: str, endpoint: str, *, within: float) -> None:
    """Raise NoTwin when a twin does not answer with its status ``within`` some seconds."""
    if not _asked(session, Found(twin=twin, endpoint=endpoint), within).alive:
        raise silent(twin, endpoint)


def silent(twin: str, endpoint: str) -> NoTwin:
    """Error of a twin that does not answer."""
    return NoTwin(f"no twin {twin!r} answers at {endpoint}: is it running there, and does it let you in? ({BEHIND})")


def _alive(session: zenoh.Session) -> list[str]:
    """Names of the twins that a session sees, as soon as there is one."""

    def look() -> list[str]:
        replies = session.liveliness().get(f"{PREFIX}/*/alive", timeout=TIMEOUT)
        names = {str(reply.ok.key_expr).split("/")[1] for reply in replies if reply.ok is not None}
        return sorted(name for name in names if is_name(name))  # other programs may declare tokens with any name

    return _until_connected(look) or []


def _asked(session: zenoh.Session, found: Found, within: float = TIMEOUT) -> Found:
    def ask() -> StatusMessage | None:
        key = Keys(found.twin).status
        for answer in answers(session.get(key, timeout=TIMEOUT), key):
            return msgspec.json.decode(answer.payload.to_bytes(), type=StatusMessage)
        return None

    status = _until_connected(ask, within)
    if status is None:
        return found
    return msgspec.structs.replace(
        found,
        alive=True,
        state=status.state,
        scene=" ".join(part for part in (status.scene, status.variant) if part),
        time=status.time,
        driver=status.driver_name,
    )


def _until_connected(ask: Callable[[], T], within: float = TIMEOUT) -> T:
    """Ask repeatedly until there is an answer or ``within`` [s] have passed: a session connects in the background."""
    deadline = time.monotonic() + within
    while not (answer := ask()) and time.monotonic() < deadline:
        time.sleep(AGAIN)
    return answer
