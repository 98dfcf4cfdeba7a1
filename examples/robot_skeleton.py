"""The smallest robot that motm-twin can drive: plain zenoh and JSON, nothing of motm_twin. See docs/external_robot.md.

    motm-twin serve exp1 --plant zenoh &
    python examples/robot_skeleton.py tcp/127.0.0.1:7447

Replace `Drives` with your robot, and `wall` with your lidar. Here the joints follow immediately, the base never slips,
and the lidar sees a round wall 10 m away. With --shared the twin decides how fast time passes.
"""

import argparse
import itertools
import json
import math
import os
import queue
import random
import signal
import sys
import tempfile
import threading
import time
import uuid
from pathlib import Path

import zenoh

parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
parser.add_argument("endpoint", nargs="?", default="tcp/127.0.0.1:7447")
parser.add_argument("twin", nargs="?", default="frankie")
parser.add_argument("--shared", action="store_true", help="time passes when the twin grants it")
options = parser.parse_args()
ENDPOINT = options.endpoint
VERSION, LIFE, STEP = "motm.plant/1", uuid.uuid4().hex, 0.01
KEY, BASE = f"motm/{options.twin}/plant/", {"version": VERSION, "life": LIFE}
BORN = time.monotonic()  # [s] when stamps are 0
ARRIVED: queue.SimpleQueue[tuple[float, dict]] = queue.SimpleQueue()  # commands and grants, in order
STOP = threading.Event()  # an exception could come anywhere, and be lost there


class Drives:
    """Placeholder for the real base, arm and gripper."""

    pose, q, width = [0.0, 0.0, 0.0], [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], 0.08

    def move(self, twist: list[float], rates: list[float], gripper: str, dt: float) -> None:
        """Move for dt [s] with a base twist [m/s, rad/s] and joint rates [rad/s]."""
        x, y, heading = self.pose
        way = twist[0] * dt
        self.pose = [x + way * math.cos(heading), y + way * math.sin(heading), heading + twist[1] * dt]
        self.q = [angle + rate * dt for angle, rate in zip(self.q, rates, strict=True)]
        self.width = 0.08 if gripper == "open" else 0.0


def on_message(sample: zenoh.Sample) -> None:
    """Take a command or a grant; messages sent to a wildcard are not from the twin."""
    if str(sample.key_expr) in (KEY + "command", KEY + "grant"):
        ARRIVED.put((time.monotonic() - BORN, json.loads(sample.payload.to_bytes())))


def main() -> None:
    """Run the robot until Ctrl-C."""
    # `motm-twin serve` leaves this file, with the password, for other programs of the same user.
    own = Path(tempfile.gettempdir(), f"motm-twin-{os.getuid()}", f"zenoh-{ENDPOINT.rsplit(':')[-1]}.json5")
    config = zenoh.Config.from_file(str(own)) if own.exists() else zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
    config.insert_json5("scouting/multicast/enabled", "false")
    info = BASE | {"name": "skeleton", "clock": "shared" if options.shared else "real", "step": STEP, "can": []}
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: (STOP.set(), ARRIVED.put((0.0, {"until": math.inf}))))
    # One subscriber for both keys: two would have a thread each, and a grant could overtake the command before it.
    # `with` undeclares everything at the end; otherwise the threads keep the program from ending.
    with (
        zenoh.open(config) as session,
        session.declare_subscriber(KEY + "*", on_message, allowed_origin=zenoh.Locality.REMOTE),
        session.declare_queryable(KEY + "info", lambda query: query.reply(KEY + "info", json.dumps(info))),
        session.liveliness().declare_token(KEY + "alive"),
    ):
        drive(session)


def drive(session: zenoh.Session) -> None:
    """Execute the commands that arrive, and publish states and scans."""
    drives, waiting, until, last = Drives(), [], 0.0, {}
    acting: dict = {"act_at": -math.inf, "seq": -1, "gripper": "open", "lifetime": 0.0}

    def say(**messages: dict) -> None:
        last.update(messages)
        for name, message in messages.items():
            session.put(KEY + name, json.dumps(BASE | message))

    for seq in itertools.takewhile(lambda _: not STOP.is_set(), itertools.count()):
        now, new = seq * STEP, []
        while options.shared and until < now - 0.5 * STEP:
            _, message = ARRIVED.get()
            if "until" not in message:
                new.append((now - STEP, message))
            elif message["until"] < now - 0.5 * STEP:
                say(**last)  # asked again: the answer was lost, or has not arrived yet
            else:
                until = message["until"]
        if not options.shared:
            time.sleep(max(0.0, BORN + now - time.monotonic()))
            new = [(at, message) for at, message in (ARRIVED.get() for _ in range(ARRIVED.qsize())) if "seq" in message]
        waiting += [command for _, command in new if command["life"] == LIFE and command["version"] == VERSION]
        due = [command for command in waiting if command["act_at"] <= now and command["seq"] > acting["seq"]]
        acting = max([acting, *due], key=lambda command: command["seq"])
        waiting = [command for command in waiting if command["act_at"] > now]
        fresh = now - acting["act_at"] < acting["lifetime"]  # later it has expired: stop
        twist, rates = (acting["twist"], acting["joint_velocity"]) if fresh else ([0.0, 0.0], [0.0] * 7)
        drives.move(twist, rates, acting["gripper"], STEP)
        heard = [(command["seq"], at) for at, command in new]
        if seq % 5 == 0:
            wall = [random.gauss(10.0, 0.01) for _ in range(721)]  # no return, or ranges without noise, count as faults
            scan = {"stamp": now, "pose": drives.pose, "origin": [0.0, 0.0], "angle_min": -math.pi, "range_min": 0.05,
                    "angle_step": 2 * math.pi / 720, "range_max": 15.0, "ranges": wall}  # fmt: skip
            say(scan=scan)
        state = {"seq": seq, "stamp": now, "pose": drives.pose, "odometry": drives.pose, "twist": twist, "q": drives.q,
                 "dq": rates, "gripper_width": drives.width, "gripper_moving": False, "heard": heard}  # fmt: skip
        say(state=state, **({"clock": {"stamp": now}} if options.shared else {}))


if __name__ == "__main__":
    try:
        main()
    except zenoh.ZError:
        sys.exit(f"nobody answers at {ENDPOINT}: start `motm-twin serve exp1 --plant zenoh` first, or give its address")
