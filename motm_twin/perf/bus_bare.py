"""Zenoh and nothing else: sends given bytes at a given rate, stamped, for comparison with what a twin sends.

``python -m motm_twin.perf.bus_bare``
"""

import threading
import time

import zenoh

from motm_twin.bus.session import LOOPBACK, free_port, open_server
from motm_twin.perf.processes import serve_lines

KEY = "motm-bench/bare"


class Bare:
    """A publisher that is declared as that of the ticks is (`bus.latest`)."""

    def __init__(self) -> None:
        port = free_port()
        self.endpoint = f"tcp/{LOOPBACK}:{port}"
        self._session = open_server(port)
        self._publisher = self._session.declare_publisher(
            KEY,
            encoding=zenoh.Encoding.APPLICATION_JSON,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=zenoh.Reliability.RELIABLE,
        )
        self._stop = threading.Event()

    def send(self, payloads: list[str], period: float) -> None:
        """Send these in turn, one every ``period`` [s], until the end."""
        threading.Thread(target=self._send, args=([text.encode() for text in payloads], period), daemon=True).start()

    def _send(self, payloads: list[bytes], period: float) -> None:
        due, number = time.monotonic(), 0
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            payload = payloads[number % len(payloads)]
            self._publisher.put(payload, attachment=repr(time.monotonic()).encode())
            due, number = due + period, number + 1


def main() -> None:
    """Take part until standard input ends."""
    bare = Bare()
    serve_lines({"endpoint": bare.endpoint}, {"send": bare.send})


if __name__ == "__main__":
    main()
