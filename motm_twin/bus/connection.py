"""Zenoh sessions with an explicit configuration: nothing is reachable unless requested.

Zenoh's defaults listen on all interfaces and discover others by multicast; here a session listens on the given
address only, discovers nobody, and accepts messages of a bounded size.
"""

import contextlib
import errno
import json
import math
import random
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import zenoh

from motm_twin.bus.keys import spoken_on
from motm_twin.bus.private_folder import announce, forget
from motm_twin.bus.zenoh_config import session_config

LOOPBACK, LOOPBACK_6 = "127.0.0.1", "::1"
FREE = (20_000, 32_768)  # ports from which a free one is taken: below those of outgoing connections (Linux: 32768)
MAX_PORT = 65_535
TRIES = 50  # ports that are tried
PATIENCE = 6.0  # [s] a session of mode "client" tries this long to be let in
ATTEMPT = 0.5  # [s] limit of one attempt to connect; a stop is noticed between attempts


class PortTaken(OSError):
    """The requested port is in use."""

    def __init__(self, host: str, port: int, use: str) -> None:
        self.host, self.port = host, port
        super().__init__(errno.EADDRINUSE, f"port {port} on {host} is taken; {use}")


def require_free_port(host: str, port: int, use: str) -> None:
    """Raise PortTaken, with advice, when the TCP port is in use; port 0 is always free.

    Raises ValueError when no program could listen there: invalid port, or an address of another machine.
    """
    if not 0 <= port <= MAX_PORT:
        raise ValueError(f"port {port}: use 1 to {MAX_PORT} (0 takes any free one)")
    with socket.socket(family := _family(host), socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        if family == socket.AF_INET6:
            probe.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise PortTaken(host, port, use) from error
            if error.errno == errno.EADDRNOTAVAIL or isinstance(error, socket.gaierror):
                version, all_of_them = ("6", "::") if family == socket.AF_INET6 else ("4", "0.0.0.0")  # noqa: S104 - named
                raise ValueError(
                    f"{host} is no IPv{version} address of this machine: give one of its own, or {all_of_them} for all"
                ) from error
            raise ValueError(f"nothing can listen on port {port} of {host}: {error.strerror}; {use}") from error


def _family(host: str) -> socket.AddressFamily:
    return socket.AF_INET6 if ":" in host else socket.AF_INET


def free_port(host: str = LOOPBACK) -> int:
    """A TCP port that is free now, and that no outgoing connection will take before it is listened on.

    The operating system's own choice (port 0) is from the range of outgoing connections of any program.
    Raises PortTaken when none was found, ValueError for an address of another machine.
    """
    for port in random.SystemRandom().sample(range(*FREE), TRIES):
        with contextlib.suppress(PortTaken):
            require_free_port(host, port, "")
            if forget(port):
                return port
    raise PortTaken(host, port, f"so were {TRIES - 1} others")


def direct(callback: Callable[[Any], None]) -> zenoh.handlers.Callback:
    """A callback in Zenoh's own thread: with a thread in Python, a program that forgets to close would never end."""
    return zenoh.handlers.Callback(callback, indirect=False)


def answers(replies: Iterable[zenoh.Reply], key: str) -> Iterator[zenoh.Sample]:
    """Answers on exactly this key among the replies (`keys.spoken_on`); errors are left out."""
    return (reply.ok for reply in replies if reply.ok is not None and spoken_on(reply.ok, key))


def open_server(
    port: int, host: str = LOOPBACK, own: Sequence[str] = (), asks: Sequence[str] = (), *, open_bus: bool = False
) -> zenoh.Session:
    """A session that listens on one TCP port; only it may publish on the keys ``own`` and query ``asks``.

    Programs of this user may connect (`bus.private_folder`); with ``open_bus``, all on this machine. Raises
    ConfigError, and errors of `require_free_port`.

    It connects to nobody, unless the configuration file names a router.
    """
    require_free_port(host, port, "choose another one with --zenoh-port (0 takes any free one)")
    endpoint, guarded = f"tcp/{f'[{host}]' if ':' in host else host}:{port}", None if open_bus else port
    if open_bus:
        announce(port, endpoint, None)
    return zenoh.open(session_config(listen=[endpoint], connect=[], mode="peer", own=own, asks=asks, guarded=guarded))


def open_client(endpoint: str) -> zenoh.Session:
    """A session that connects to ``endpoint`` ("tcp/127.0.0.1:7447"), now or as soon as a server is there.

    Raises ConfigError for an invalid endpoint.

    Behind a router the configuration file must say mode "client": a router does not forward between peers. In this
    mode somebody must answer within `PATIENCE`, otherwise it raises ZError.
    """
    return _let_in(lambda: session_config(listen=[], connect=[endpoint]), PATIENCE, threading.Event())


def open_member(endpoint: str, *, wait: float | None = None, stop: threading.Event | None = None) -> zenoh.Session:
    """A session whose data, queryables and tokens the server forwards to other members.

    Waits until a server answers at ``endpoint``, for at most ``wait`` [s] (None: for ever), or until ``stop`` is set;
    then raises TimeoutError. It reconnects by itself to a restarted server, with all its declarations.
    Raises ConfigError at once for an invalid endpoint.
    """

    def config() -> zenoh.Config:
        made = session_config(listen=[], connect=[endpoint], mode="client")
        made.insert_json5("connect/timeout_ms", json.dumps(round(ATTEMPT * 1000)))
        return made

    try:
        return _let_in(config, wait, stop or threading.Event())
    except zenoh.ZError as error:
        raise TimeoutError(
            f"nobody answers at {endpoint}: is the server running there, and does it let you in?"
        ) from error


def _let_in(config: Callable[[], zenoh.Config], wait: float | None, stop: threading.Event) -> zenoh.Session:
    """A session by attempt after attempt; ``config`` is made anew for each, since it may ask for a password by then.

    Zenoh alone gives up at the first attempt, also when the other side is only busy. Raises its ZError after ``wait``
    [s] (None: never), and when ``stop`` is set.
    """
    deadline = math.inf if wait is None else time.monotonic() + wait
    while True:
        began = time.monotonic()
        try:
            return zenoh.open(config())
        except zenoh.ZError:
            now = time.monotonic()
            if stop.is_set() or now >= deadline:
                raise
        stop.wait(max(0.0, began + ATTEMPT - now))
