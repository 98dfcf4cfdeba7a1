"""The Zenoh configuration of a session: an explicit file, and the addresses that the session is opened with.

The file is `zenoh.json5` beside this module, unless the environment variable MOTM_ZENOH_CONFIG names another one, made
by `motm-twin security` for connections between machines (docs/security.md).
"""

import json
import os
import re
from collections.abc import Sequence
from pathlib import Path

import zenoh

from motm_twin.bus.private_folder import guard, known_at, own_credentials, to_come

SHIPPED = Path(__file__).with_name("zenoh.json5")
VARIABLE = "MOTM_ZENOH_CONFIG"
_AUTH = "transport/auth/usrpwd"
_ENDPOINT = re.compile(
    r"((tcp|udp|tls|quic|ws)/[^?#\s]+:\d{1,5}|(unixsock-stream|unixpipe|vsock|serial)/[^?#\s]+)([?#].*)?"
)


class ConfigError(ValueError):
    """A configuration file or an endpoint that can not be used; the message says why."""


def config_file() -> Path:
    """The file that sessions of this process read."""
    return Path(os.environ.get(VARIABLE) or SHIPPED)


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

    ``mode`` is that of the file unless it is given. On the keys ``own`` only this session speaks and answers, and only
    it queries ``asks``, whoever connects; a file with its own access control overrides this. A
    wildcard passes such a rule, so receivers ignore wildcards (`keys.spoken_on`).

    The port ``guarded``, the first of ``listen``, requires the password of this user, or
    one of those in the file. A session that connects to such a port has the password (`bus.private_folder`).
    Raises ConfigError.
    """
    for endpoint in connect:
        check_endpoint(endpoint)
    config = _read(config_file())
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
    """Settings of a session that needs the user's password: a port that asks for none takes nobody who has one."""
    own = known_at(endpoint) or {}
    if not own and json.loads(config.get_json(f"{_AUTH}/user")) is None and to_come(endpoint):
        own = own_credentials()._asdict()
    return {f"{_AUTH}/{name}": value for name, value in own.items()}


def _passwords(config: zenoh.Config) -> list[str]:
    """Lines "user:password" of those whom the file lets in."""
    name = json.loads(config.get_json(f"{_AUTH}/dictionary_file"))
    if name is None:
        return []
    try:
        return Path(name).read_text(encoding="utf-8").split()
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError(f"{name}: the passwords cannot be read: {error}") from error


def configured_endpoint() -> str | None:
    """Address of the server in the configuration file; None when it has none."""
    found = _endpoints(_read(config_file()), "connect")
    return found[0] if found else None


def _read(path: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        reason = " ".join(str(error).split(" at /")[0].split())  # Zenoh reports a mistake in several lines
        raise ConfigError(f"{path}: is no Zenoh configuration: {reason}") from error


def _endpoints(config: zenoh.Config, key: str) -> list[str]:
    """Endpoints under a key, which may be one list or one per mode."""
    found = json.loads(config.get_json(f"{key}/endpoints"))
    if isinstance(found, dict):
        found = found.get("peer") or found.get("client") or []
    return [str(item) for item in found or []]
