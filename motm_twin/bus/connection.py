"""Keys on Zenoh, and sessions with an explicit configuration: nothing is reachable unless requested.

Keys of one twin are below ``motm/<twin>/``; those of an external robot are below ``plant/``.

Zenoh's defaults listen on all interfaces and discover others by multicast; here a session listens on the given
address only, discovers nobody, and accepts messages of a bounded size. The configuration is `zenoh.json5` beside this
module, unless the environment variable MOTM_ZENOH_CONFIG names another file, made by `motm-twin security` for
connections between machines (docs/security.md).
"""

import contextlib
import errno
import json
import math
import os
import random
import re
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import zenoh

from motm_twin.bus.private_folder import announce, forget, guard, known_at, own_credentials, to_come

PREFIX = "motm"
DEFAULT_TWIN = "frankie"
DEFAULT_PORT = 7447  # Zenoh's own
_NAME = re.compile(r"[A-Za-z0-9_-]{1,40}\Z")


class Keys:
    """Key expressions of the twin with the given name."""

    def __init__(self, twin: str = DEFAULT_TWIN) -> None:
        if not is_name(twin):
            raise ValueError(f"twin name {twin!r}: use 1 to 40 letters, digits, '_' or '-'")
        self.twin = twin
        root = self._root = f"{PREFIX}/{twin}"
        self.tick = f"{root}/tick"  # JSON, every period
        self.grid = f"{root}/grid"  # raw bytes with an attachment, on change
        self.scene = f"{root}/scene"  # JSON with an attachment, on change; answers queries
        self.status = f"{root}/status"  # JSON, on change and twice a second; answers queries
        self.robot = f"{root}/robot"  # JSON at 50 Hz: base, joints, gripper, frames
        self.scan = f"{root}/scan"  # JSON, every new sweep of the lidar
        self.observations = f"{root}/observations"  # JSON, every period of an external robot: what reruns it
        self.event = f"{root}/event"  # JSON, reliable and numbered; answers queries with its history
        self.metrics = f"{root}/metrics"  # JSON, once a second
        self.session = f"{root}/session"  # JSON of the run so far; answers queries only
        self.schemas = f"{root}/schema/**"  # JSON Schema of every message; answers queries only
        self.alive = f"{root}/alive"  # liveliness token
        self.commands = f"{root}/cmd/**"
        self.own = (
            *(self.tick, self.grid, self.scene, self.status, self.robot, self.scan, self.event, self.metrics),
            *(self.observations, self.session, self.schemas, self.alive, self.commands),
        )  # only the server publishes here

    def schema(self, name: str) -> str:
        """Key to query for the schema of this name."""
        return f"{self._root}/schema/{name}"

    def command(self, name: str) -> str:
        """Key that the command of this name is sent to."""
        return f"{self._root}/cmd/{name}"

    def command_in(self, key: str) -> str:
        """The name of the command that is sent to this key, one of `commands`."""
        return key.removeprefix(f"{self._root}/cmd/")


def is_name(text: str) -> bool:
    """True when a twin may have this name."""
    return _NAME.match(text) is not None


def spoken_on(heard: Any, key: str) -> bool:
    """True when the sample or query was sent to exactly this key.

    A message sent to a wildcard reaches every matching key, past the access control of each.
    """
    return str(heard.key_expr) == key


class PlantKeys:
    """Key expressions of the robot of one twin. Direction: from the robot (>), to the robot (<), question (?)."""

    def __init__(self, twin: str = DEFAULT_TWIN) -> None:
        Keys(twin)  # checks the name
        self.twin = twin
        root = f"{PREFIX}/{twin}/plant"
        self.root = root
        self.alive = f"{root}/alive"  # > liveliness token
        self.info = f"{root}/info"  # ? Info
        self.state = f"{root}/state"  # > RobotState, 100 Hz
        self.scan = f"{root}/scan"  # > ScanData, every sweep
        self.detections = f"{root}/detections"  # > DetectionList, every frame of the camera
        self.command = f"{root}/command"  # < RobotCommand, 100 Hz
        self.clock = f"{root}/clock"  # > ClockReached, shared clock only
        self.grant = f"{root}/grant"  # < ClockGrant, shared clock only
        self.truth = f"{root}/truth"  # > TruthData, 20 Hz; simulated robots only
        self.reset = f"{root}/reset"  # ? ResetRequest -> PlantAnswer
        self.edit = f"{root}/edit"  # ? EditRequest -> PlantAnswer
        self.tasks = f"{root}/tasks"  # ? TaskNotice -> PlantAnswer

    @property
    def from_twin(self) -> tuple[str, ...]:
        """Keys on which only the twin publishes."""
        return self.command, self.grant

    @property
    def queried_by_twin(self) -> tuple[str, ...]:
        """Keys that only the twin queries."""
        return self.reset, self.edit, self.tasks


SHIPPED = Path(__file__).with_name("zenoh.json5")
VARIABLE = "MOTM_ZENOH_CONFIG"
_AUTH = "transport/auth/usrpwd"
_ENDPOINT = re.compile(
    r"((tcp|udp|tls|quic|ws)/[^?#\s]+:\d{1,5}|(unixsock-stream|unixpipe|vsock|serial)/[^?#\s]+)([?#].*)?"
)


class ConfigError(ValueError):
    """A configuration file or an endpoint that can not be used; the message says why."""


def session_config(
    *,
    listen: list[str],
    connect: list[str],
    mode: str | None = None,
    own: Sequence[str] = (),
    asks: Sequence[str] = (),
    guarded: int | None = None,
) -> zenoh.Config:
    """The file's configuration with ``listen`` added to its addresses, and ``connect`` replacing them unless empty.

    ``mode`` is that of the file unless it is given. Whoever connects, only this session may publish and answer on the
    keys ``own`` and query the keys ``asks``; a file with its own access control overrides this. A
    wildcard passes such a rule, so receivers ignore wildcards (`spoken_on`).

    The port ``guarded``, the first of ``listen``, requires the password of this user or
    one from the file. A session that connects to such a port sends the password (`bus.private_folder`).
    Raises ConfigError.
    """
    for endpoint in connect:
        check_endpoint(endpoint)
    config = _read()
    settings: dict[str, object] = {"listen/endpoints": [*listen, *_endpoints(config, "listen")]}
    if mode is not None:
        settings["mode"] = mode
    if connect:
        settings["connect/endpoints"] = connect
    if (own or asks) and not json.loads(config.get_json("access_control/enabled")):
        settings["access_control"] = _reserved(own, asks)
    try:
        if guarded is not None:
            settings[f"{_AUTH}/dictionary_file"] = str(guard(guarded, listen[0], _passwords(config)))
        elif len(connect) == 1 and not listen:
            settings |= _own_password(config, connect[0])
    except OSError as error:
        raise ConfigError(f"the password for Zenoh cannot be kept: {error}") from error
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def check_endpoint(endpoint: str) -> None:
    """Raise ConfigError unless this is an address that Zenoh can connect to."""
    if not _ENDPOINT.fullmatch(endpoint):
        raise ConfigError(f"endpoint {endpoint!r} is none of Zenoh: write it as tcp/127.0.0.1:7447")


def _reserved(own: Sequence[str], asks: Sequence[str]) -> dict[str, object]:
    """Others may subscribe to these keys, but neither publish nor answer; on ``asks`` they may only answer."""
    speak = ["put", "delete", "declare_queryable", "reply", "liveliness_token"]
    rules = [
        {"id": name, "permission": "deny", "flows": ["ingress"], "messages": messages, "key_exprs": list(keys)}
        for name, messages, keys in (
            ("only the twin speaks here", speak, own),
            ("only the twin asks here", ["query"], asks),
        )
        if keys
    ]
    return {
        "enabled": True,
        "default_permission": "allow",
        "rules": rules,
        "subjects": [{"id": "everybody"}],
        "policies": [{"rules": [rule["id"] for rule in rules], "subjects": ["everybody"]}],
    }


def _own_password(config: zenoh.Config, endpoint: str) -> dict[str, object]:
    """Settings with the user's password, if the port needs it: a port without a password rejects clients with one."""
    own = known_at(endpoint) or {}
    if not own and json.loads(config.get_json(f"{_AUTH}/user")) is None and to_come(endpoint):
        own = own_credentials()._asdict()
    return {f"{_AUTH}/{name}": value for name, value in own.items()}


def _passwords(config: zenoh.Config) -> list[str]:
    """Lines "user:password" of the users that the configuration file admits."""
    name = json.loads(config.get_json(f"{_AUTH}/dictionary_file"))
    if name is None:
        return []
    try:
        return Path(name).read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{name}: the passwords cannot be read: {error}") from error


def configured_endpoint() -> str | None:
    """Address of the server in the configuration file; None when it has none."""
    found = _endpoints(_read(), "connect")
    return found[0] if found else None


def _read() -> zenoh.Config:
    """The configuration in the file that sessions of this process read."""
    path = os.environ.get(VARIABLE) or str(SHIPPED)
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        reason = " ".join(str(error).split(" at /")[0].split())  # Zenoh reports a mistake in several lines
        raise ConfigError(f"{path}: is no Zenoh configuration: {reason}") from error


def _endpoints(config: zenoh.Config, key: str) -> list[str]:
    """Endpoints under a key, which may be one list or one per mode."""
    found = json.loads(config.get_json(f"{key}/endpoints"))
    if isinstance(found, dict):
        found = found.get("peer") or found.get("client") or []
    return [str(item) for item in found or []]


LOOPBACK, LOOPBACK_6 = "127.0.0.1", "::1"
FREE = (20_000, 32_768)  # ports from which a free one is taken: below those of outgoing connections (Linux: 32768)
MAX_PORT = 65_535
TRIES = 50  # ports that are tried
PATIENCE = 6.0  # [s] for which a session of mode "client" tries to be let in
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
    with socket.socket(family := socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM) as probe:
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


def free_port(host: str = LOOPBACK) -> int:
    """A TCP port that is free now, and that no outgoing connection will take in the meantime.

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
    """A callback in Zenoh's own thread: a Python thread would keep a program that forgets to close from ending."""
    return zenoh.handlers.Callback(callback, indirect=False)


def answers(replies: Iterable[zenoh.Reply], key: str) -> Iterator[zenoh.Sample]:
    """Answers on exactly this key among the replies (`spoken_on`); errors are left out."""
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
    return _open_with_retries(lambda: session_config(listen=[], connect=[endpoint]), PATIENCE, threading.Event())


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
        return _open_with_retries(config, wait, stop or threading.Event())
    except zenoh.ZError as error:
        raise TimeoutError(
            f"nobody answers at {endpoint}: is the server running there, and does it let you in?"
        ) from error


def _open_with_retries(config: Callable[[], zenoh.Config], wait: float | None, stop: threading.Event) -> zenoh.Session:
    """Open a session, with retries; ``config`` is built anew for each, as it may need a password by then.

    Zenoh by itself gives up after the first attempt, even when the other side is only busy. Raises its ZError after
    ``wait`` [s] (None: never), and when ``stop`` is set.
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
