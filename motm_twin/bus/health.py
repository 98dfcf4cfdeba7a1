"""Health check, for containers: ``python -m motm_twin.bus.health`` ends with 0 when every running twin answers.

A twin is healthy when its server answers on Zenoh in a state other than error, and its page answers.
"""

import argparse
import http.client
import sys
from contextlib import closing, suppress

import msgspec

from motm_twin.bus.connection import DEFAULT_TWIN, LOOPBACK, LOOPBACK_6, Keys, answers, open_client
from motm_twin.bus.messages import StatusMessage
from motm_twin.bus.private_folder import all_running

TIMEOUT = 3.0  # [s]
HEALTH_PATH = "/healthz"


def page_answers(port: int) -> bool:
    """The page is served on this machine, by either version of IP."""
    for host in (LOOPBACK, LOOPBACK_6):
        with suppress(OSError), closing(http.client.HTTPConnection(host, port, timeout=TIMEOUT)) as connection:
            connection.request("GET", HEALTH_PATH)
            if connection.getresponse().status == http.client.OK:
                return True
    return False


def check(endpoint: str, twin: str, page_port: int | None) -> str:
    """The problem in one sentence; '' when there is none."""
    key = Keys(twin).status
    with open_client(endpoint) as session:
        answer = next(answers(session.get(key, timeout=TIMEOUT), key), None)
        if answer is None:
            return f"no twin server answers at {endpoint}"
        if msgspec.json.decode(answer.payload.to_bytes(), type=StatusMessage).state == "error":
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
