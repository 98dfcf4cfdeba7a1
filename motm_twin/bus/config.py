"""The Zenoh configuration of a session: an explicit file, and the addresses that the session is opened with.

The file is `zenoh.json5` beside this module, unless the environment variable MOTM_ZENOH_CONFIG names another one, made
by `motm-twin security` for connections between machines (docs/security.md).
"""

import json
import os
from pathlib import Path

import zenoh

SHIPPED = Path(__file__).with_name("zenoh.json5")
VARIABLE = "MOTM_ZENOH_CONFIG"


class ConfigError(ValueError):
    """A configuration file that can not be used; the message says why."""


def config_file() -> Path:
    """The file that sessions of this process read."""
    return Path(os.environ.get(VARIABLE) or SHIPPED)


def session_config(*, listen: list[str], connect: list[str], mode: str = "peer") -> zenoh.Config:
    """The file with these addresses: ``listen`` on top of its own, ``connect`` instead of them unless empty.

    Raises ConfigError.
    """
    config = _read(config_file())
    settings: dict[str, object] = {"mode": mode, "listen/endpoints": [*listen, *_endpoints(config, "listen")]}
    if connect:
        settings["connect/endpoints"] = connect
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def configured_endpoint() -> str | None:
    """Where the configuration file says that the server is; None when it does not."""
    found = _endpoints(_read(config_file()), "connect")
    return found[0] if found else None


def _read(path: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(str(path))
    except zenoh.ZError as error:
        reason = str(error).split(" at /")[0]
        raise ConfigError(f"{path}: is no Zenoh configuration: {reason}") from error


def _endpoints(config: zenoh.Config, key: str) -> list[str]:
    """Endpoints under a key, which may be one list or one per mode."""
    found = json.loads(config.get_json(f"{key}/endpoints"))
    if isinstance(found, dict):
        found = found.get("peer") or []
    return [item if isinstance(item, str) else str(item) for item in found or []]
