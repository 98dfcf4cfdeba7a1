"""Health check, for containers: ``python -m motm_twin.bus.health`` ends with 0 when every running twin answers.

A twin is healthy when its server answers on Zenoh in a state other than error, its time runs while it plays, and its
page answers.
"""

import argparse
import http.client
import sys
import time
from contextlib import closing, suppress

import msgspec
import zenoh

from motm_twin.bus.connection import DEFAULT_TWIN, LOOPBACK, LOOPBACK_6, Keys, answers, open_client
from motm_twin.bus.messages import StatusMessage
from motm_twin.bus.private_folder import all_running
from motm_twin.model.plant import PERIOD

TIMEOUT = 3.0  # [s]
HEALTH_PATH = "/healthz"


def page_answers(port: int) -> bool:
    """True when the page is served on this machine, over either version of IP."""
    for host in (LOOPBACK, LOOPBACK_6):
        with suppress(OSError), closing(http.client.HTTPConnection(host, port, timeout=TIMEOUT)) as connection:
            connection.request("GET", HEALTH_PATH)
            if connection.getresponse().status == http.client.OK:
                return True
    return False


def _status(session: zenoh.Session, key: str) -> StatusMessage | None:
    answer = next(answers(session.get(key, timeout=TIMEOUT), key), None)
    return None if answer is None else msgspec.json.decode(answer.payload.to_bytes(), type=StatusMessage)


def _stands(before: StatusMessage, now: StatusMessage) -> bool:
    """True when time has stood still although the twin plays and, by its text, waits for no robot."""
    waits = now.plant in ("zenoh", "mirror") and now.text
    return now.state == "playing" and not waits and (now.run, now.time) == (before.run, before.time)


def check(endpoint: str, twin: str, page_port: int | None) -> str:
    """The problem in one sentence; '' when there is none."""
    key = Keys(twin).status
    with open_client(endpoint) as session:
        status = first = _status(session, key)
        patient = time.monotonic() + TIMEOUT
        while first and status and _stands(first, status):
            if time.monotonic() > patient:
                return f"the time of the twin at {endpoint} stands, though it plays"
            time.sleep(PERIOD)
            status = _status(session, key)
        if status is None:
            return f"no twin server answers at {endpoint}"
        if status.state == "error":
            return f"the twin at {endpoint} stopped with an error"
    if page_port is not None and not page_answers(page_port):
        return f"no page answers at port {page_port}"
    return ""


def main() -> int:
    """Check the given twin, or every one that this user runs."""
    parser = argparse.ArgumentParser(prog="python -m motm_twin.bus.health", description=__doc__)
    parser.add_argument("--endpoint", help="address of the twin server; without it all that run here are checked")
    parser.add_argument("--twin", default=DEFAULT_TWIN)
    parser.add_argument("--page", type=int, help="port of the page")
    options = parser.parse_args()
    if options.endpoint:
        targets = [(options.endpoint, options.twin, options.page)]
    else:
        targets = [(item.endpoint, item.twin, item.page_port) for item in all_running()]
    problems = [problem for target in targets if (problem := check(*target))]
    if not targets:
        problems = ["no twin is running"]
    for problem in problems:
        print(f"unhealthy: {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
