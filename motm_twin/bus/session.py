"""Zenoh sessions with an explicit configuration: nothing is reachable that was not asked for.

Zenoh's own defaults listen on all interfaces and look for others by multicast; here a session listens on the given
address only, finds nobody by itself, and takes messages of a bounded size.
"""

import errno
import json
import socket

import zenoh

LOOPBACK = "127.0.0.1"
MAX_MESSAGE_BYTES = 16 * 1024 * 1024
SEND_BATCHES = 16  # of 64 kB, Zenoh's largest: a reader that stalls for some seconds still gets every tick


class PortTaken(OSError):
    """The port that was asked for belongs to somebody else."""

    def __init__(self, host: str, port: int, use: str) -> None:
        self.host, self.port = host, port
        super().__init__(errno.EADDRINUSE, f"port {port} on {host} is taken; {use}")


def require_free_port(host: str, port: int, use: str) -> None:
    """Raise PortTaken, with advice, when the TCP port can not be bound; port 0 is always free."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortTaken(host, port, use) from error


def free_port(host: str = LOOPBACK) -> int:
    """A TCP port that is free now."""
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.bind((host, 0))
        return int(probe.getsockname()[1])


def _config(listen: list[str], connect: list[str]) -> zenoh.Config:
    config = zenoh.Config()
    settings: dict[str, object] = {
        "mode": "peer",
        "listen/endpoints": listen,
        "connect/endpoints": connect,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "adminspace/enabled": False,
        "timestamping/enabled": True,
        "transport/shared_memory/enabled": False,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        "transport/link/tx/queue/size/data": SEND_BATCHES,
    }
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def open_server(port: int, host: str = LOOPBACK) -> zenoh.Session:
    """A session that listens on one TCP port and connects to nobody. Raises PortTaken."""
    require_free_port(host, port, "choose another one with --zenoh-port (0 takes any free one)")
    return zenoh.open(_config([f"tcp/{host}:{port}"], []))


def open_client(endpoint: str) -> zenoh.Session:
    """A session that connects to ``endpoint`` ("tcp/127.0.0.1:7447"), now or as soon as somebody is there."""
    return zenoh.open(_config([], [endpoint]))
