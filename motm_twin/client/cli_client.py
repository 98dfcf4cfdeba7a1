"""`motm-twin watch | send | twins`: the keys and commands of a running twin from the shell."""

from typing import Annotated

import tyro
from tyro.conf import Positional

Flag = Annotated[bool, tyro.conf.FlagCreatePairsOff]


def watch(
    key: Positional[str] = "tick",
    /,
    once: Flag = False,
    json: Annotated[Flag, tyro.conf.arg(name="json")] = False,
    field: Annotated[str | None, tyro.conf.arg(metavar="PATH")] = None,
    endpoint: str | None = None,
    twin: str | None = None,
) -> int:
    """Print what a running twin publishes, one line each, until Ctrl-C: the newest state, and every event.

    Exit code 0: ended; 1: no twin answers; 2: bad input.

    Args:
        key: One of tick, robot, scan, grid, event, metrics, status, scene.
        once: Only the newest value.
        json: The messages themselves, as JSON.
        field: Only one field, as JSON; its path with dots: robot.pose.0.
        endpoint: Address of the twin server; without it, where MOTM_ZENOH_CONFIG leads, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.client.watch import watch as watch_key

    return watch_key(key, once=once, as_json=json, field=field, endpoint=endpoint, twin=twin)


def send(
    command: Annotated[Positional[str], tyro.conf.arg(metavar="COMMAND")],
    fields: Annotated[Positional[tuple[str, ...]], tyro.conf.arg(metavar="NAME=VALUE")] = (),
    /,
    json: Annotated[str | None, tyro.conf.arg(name="json", metavar="{...}")] = None,
    timeout: float = 2.0,
    endpoint: str | None = None,
    twin: str | None = None,
) -> int:
    """Send a command to a running twin, print its answer as JSON, and leave the wheel to others.

    Exit code 0: done; 1: refused, or no twin answers; 2: bad input.

    Args:
        command: Name of the command, such as play or add_obstacle; docs/zenoh.md lists them.
        fields: Fields of the command: name=crate x=1.0 y=-0.5 size=0.3,0.3,0.4
        json: Fields as JSON instead.
        timeout: Time to wait for the answer, in seconds.
        endpoint: Address of the twin server; without it, where MOTM_ZENOH_CONFIG leads, or the twin on this machine.
        twin: Name of the twin.
    """
    from motm_twin.client.send import send as send_command

    return send_command(command, list(fields), json=json, timeout=timeout, endpoint=endpoint, twin=twin)


def twins(endpoint: str | None = None, json: Annotated[Flag, tyro.conf.arg(name="json")] = False) -> int:
    """List the twins that run on this machine, or behind an endpoint (or where MOTM_ZENOH_CONFIG leads).

    Exit code 0: there is one that answers; 1: there is none.

    Args:
        endpoint: Address of a twin server or router.
        json: As JSON, one line each.
    """
    from motm_twin.client.discover import twins as list_twins

    return list_twins(endpoint, as_json=json)
