"""The ROS 2 bridge as a program: ``python -m motm_twin.ros2.bridge_process --endpoint tcp/127.0.0.1:7447``."""

import argparse
import faulthandler
import sys
import time
from collections.abc import Callable

from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import LOOPBACK, ConfigError, open_member
from motm_twin.bus.keys import DEFAULT_PORT, DEFAULT_TWIN, Keys
from motm_twin.bus.processes import Reporter, leave, stop_event
from motm_twin.program import BAD_INPUT
from motm_twin.ros2.bridge import Bridge
from motm_twin.ros2.forms import BRIDGE, DISTROS, FORMS, RMW, BridgeForm, Form, RmwForm
from motm_twin.ros2.robot_model import FILES

CLOSING = 15.0  # [s] that closing may take: its peers may be gone
QUIET = 5.0  # [s] before the same sentence is repeated


def main() -> None:
    """Run until a signal or the end of the parent."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    say = Throttle(lambda text: report("ros2", text=text))
    try:
        Keys(options.twin)
        make_form(options, "0")
    except ValueError as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    report("waiting", endpoint=options.endpoint)
    try:
        twin = open_member(options.endpoint, stop=stop)
        ros = twin if options.ros_endpoint is None else open_member(options.ros_endpoint, stop=stop)
    except TimeoutError:
        leave(0)
        return
    except ConfigError as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    client = TwinClient(options.endpoint, options.twin)
    form = make_form(options, str(ros.info.zid()))
    bridge = Bridge(twin, ros, client, form, options.meshes, say)
    where = options.ros_endpoint or options.endpoint
    report("ros2", text=f"topics in the form of {_FORM_NAMES[options.form]} at {where}")
    stop.wait()
    faulthandler.dump_traceback_later(CLOSING, exit=True)  # what hangs says where, and ends
    bridge.close()
    client.close()
    for session in {id(twin): twin, id(ros): ros}.values():
        session.close()
    report("ended", sent=dict(bridge.sent), unreadable=dict(bridge.unreadable))
    leave(0)


def make_form(options: argparse.Namespace, zid: str) -> Form:
    """The form that was asked for; raises ValueError for a prefix or domain that is none."""
    if options.form == BRIDGE:
        return BridgeForm(zid, prefix=options.prefix, distro=options.distro)
    node = f"motm_twin_{options.twin}".replace("-", "_")
    return RmwForm(zid, node=node, domain=options.domain, prefix=options.prefix, distro=options.distro)


_FORM_NAMES = {BRIDGE: "zenoh-bridge-ros2dds", RMW: "rmw_zenoh"}


class Throttle:
    """Prints a sentence, and repeats it only after `QUIET` [s]."""

    def __init__(self, say: Callable[[str], None]) -> None:
        self._say = say
        self._said: dict[str, float] = {}

    def __call__(self, text: str) -> None:
        """Print it, unless it was printed just now."""
        now = time.monotonic()
        self._said = {old: at for old, at in self._said.items() if now - at < QUIET}
        if text not in self._said:
            self._said[text] = now
            self._say(text)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.ros2.bridge_process", description=__doc__)
    parser.add_argument("--endpoint", default=f"tcp/{LOOPBACK}:{DEFAULT_PORT}", help="where the twin server listens")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--form", choices=FORMS, default=BRIDGE, help="zenoh-bridge-ros2dds or rmw_zenoh")
    parser.add_argument("--ros-endpoint", help="Zenoh router of the ROS 2 side; default: the twin server itself")
    parser.add_argument("--domain", type=int, default=0, help=f"ROS_DOMAIN_ID, for {RMW}")
    parser.add_argument("--distro", choices=DISTROS, default="jazzy", help="humble has no type hashes")
    parser.add_argument("--prefix", default="/", help="namespace of the topics, such as /robot1")
    parser.add_argument("--meshes", default=FILES, help="file, primitives, or the address that web_assets is served at")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
