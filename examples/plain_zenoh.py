"""Everything of docs/zenoh.md with Zenoh alone, without our package: read, command, hear events."""

import argparse
import itertools
import json
import os
import secrets
import sys
import tempfile
import time
from pathlib import Path

import zenoh

DEFAULT = "tcp/127.0.0.1:7447"
parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("endpoint", nargs="?", default=DEFAULT)
parser.add_argument("twin", nargs="?", default="frankie")
options = parser.parse_args()
ENDPOINT, TWIN = options.endpoint, f"motm/{options.twin}"
SENDER = f"example-{secrets.token_hex(4)}"
numbers = itertools.count(time.time_ns() // 1000)  # rising, also when the program starts again


def open_session():
    # `motm-twin serve` leaves this file, with the password, for other programs of the same user.
    own = Path(tempfile.gettempdir(), f"motm-twin-{os.getuid()}", f"zenoh-{ENDPOINT.rsplit(':')[-1]}.json5")
    config = zenoh.Config.from_file(str(own)) if own.exists() else zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("scouting/multicast/enabled", "false")
    try:
        config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
        return zenoh.open(config)
    except zenoh.ZError:
        sys.exit(f"nobody answers at {ENDPOINT}: start `motm-twin serve` first, or give its address as {DEFAULT}")


def ask(session, key, payload=None):
    """The only answer to a query; an error of the server is an exception."""
    for reply in session.get(f"{TWIN}/{key}", payload=payload, timeout=5.0):
        if reply.ok is None:
            raise RuntimeError(reply.err.payload.to_string())
        return reply.ok
    raise TimeoutError(f"nobody answers on {TWIN}/{key}")


def ask_json(session, key):
    return json.loads(ask(session, key).payload.to_bytes())


def command(session, kind, **fields):
    """Send a command; it must arrive within two seconds on the clock of the server, and only once."""
    now = ask_json(session, "status")["server_time"]
    envelope = {
        "sender": SENDER,
        "name": "plain example",
        "seq": next(numbers),
        "expires": now + 2.0,
        "command": {"type": kind, **fields},
    }
    answer = json.loads(ask(session, f"cmd/{kind}", json.dumps(envelope)).payload.to_bytes())
    if not answer["ok"]:
        raise RuntimeError(f"{kind} was refused: {answer['reason']}")
    return answer


with open_session() as session:
    # The last value of everything is there at once.
    status = ask_json(session, "status")
    print(f"{status['scene']} {status['variant']} is {status['state']} at {status['time']:.2f} s")
    grid = ask(session, "grid")
    info = json.loads(grid.attachment.to_bytes())
    cells = grid.payload.to_bytes()
    occupied = sum(cell == 255 for cell in cells)
    print(f"grid: {info['width']} x {info['height']} cells of {info['resolution']} m, {occupied} occupied")

    # Events: subscribe first, then ask for those before; the numbers show what comes twice or is missing.
    heard = session.declare_subscriber(f"{TWIN}/event", zenoh.handlers.FifoChannel(1000))
    past = ask_json(session, "event?from=0")
    last = past["newest"]
    print(f"{len(past['events'])} events so far")

    # Commands. The first one makes this program the driver.
    command(session, "pause")
    command(session, "add_obstacle", name="example_box", x=0.5, y=-0.8, size=[0.3, 0.3, 0.4])
    command(session, "move_body", name="example_box", x=0.6, y=-0.8, held=False)
    try:
        command(session, "move_body", name="nobody", x=0.0, y=0.0)
    except RuntimeError as error:
        print(error)
    command(session, "play")

    # State: a ring of one holds the newest message only, so that a slow reader never reads old ones.
    with session.declare_subscriber(f"{TWIN}/robot", zenoh.handlers.RingChannel(1)) as robots:
        for sample in itertools.islice(robots, 10):
            robot = json.loads(sample.payload.to_bytes())
            x, y, z = robot["frames"]["panda_tcp"][:3]
            print(f"{robot['time']:.2f} s: gripper at ({x:.3f}, {y:.3f}, {z:.3f})")

    for sample in heard:
        event = json.loads(sample.payload.to_bytes())
        if event["seq"] <= last:
            continue
        print(f"#{event['seq']} {event['kind']}: {event['text']}")
        if event["kind"] == "edit" and event["other"] == "example_box":
            break

    command(session, "remove_body", name="example_box")
    command(session, "hand_over")  # others need not wait for ten seconds of silence
    heard.undeclare()
print("done")
