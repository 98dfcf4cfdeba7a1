"""The smallest robot that motm-twin can drive: plain zenoh and JSON, nothing of motm_twin. See docs/external_robot.md.

    motm-twin serve exp1 --plant zenoh &
    python examples/robot_skeleton.py tcp/127.0.0.1:7447

Replace `Drives` by your robot. Its joints follow at once, its base slips never, its lidar sees a round
wall 10 m away.
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
options = parser.parse_args()
ENDPOINT = options.endpoint
VERSION, LIFE, STEP = "motm.plant/1", uuid.uuid4().hex, 0.01
KEY = f"motm/{options.twin}/plant/"


class Drives:
    """Stands for the real base, arm and gripper."""

    pose, q, width = [0.0, 0.0, 0.0], [0.0, -0.785, 0.0, -2.356, 0.0, 1.571, 0.785], 0.08

    def move(self, twist: list[float], rates: list[float], gripper: str, dt: float) -> None:
        """Move for dt [s] with a base twist [m/s, rad/s] and joint rates [rad/s]."""
        x, y, heading = self.pose
        way = twist[0] * dt
        self.pose = [x + way * math.cos(heading), y + way * math.sin(heading), heading + twist[1] * dt]
        self.q = [angle + rate * dt for angle, rate in zip(self.q, rates, strict=True)]
        self.width = 0.08 if gripper == "open" else 0.0


def main() -> None:
    """Be a robot until Ctrl-C."""
    # `motm-twin serve` leaves this file, with the password, for other programs of the same user.
    own = Path(tempfile.gettempdir(), f"motm-twin-{os.getuid()}", f"zenoh-{ENDPOINT.rsplit(':')[-1]}.json5")
    config = zenoh.Config.from_file(str(own)) if own.exists() else zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([ENDPOINT]))
    config.insert_json5("scouting/multicast/enabled", "false")
    born = time.monotonic()
    base = {"version": VERSION, "life": LIFE}
    info = {**base, "name": "skeleton", "clock": "real", "step": STEP, "can": []}
    arrived: queue.SimpleQueue[tuple[float, dict]] = queue.SimpleQueue()

    stop = threading.Event()  # an exception could come anywhere, and be lost there
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())

    def on_command(sample: zenoh.Sample) -> None:
        if str(sample.key_expr) == KEY + "command":  # what was sent to a wildcard is not the twin's
            arrived.put((time.monotonic() - born, json.loads(sample.payload.to_bytes())))

    # What is declared has to be undeclared, or its threads keep the program from ending: `with` does it.
    with (
        zenoh.open(config) as session,
        session.declare_subscriber(KEY + "command", on_command),
        session.declare_queryable(KEY + "info", lambda query: query.reply(KEY + "info", json.dumps(info))),
        session.liveliness().declare_token(KEY + "alive"),
    ):
        drive(session, base, arrived, born, stop)


def drive(
    session: zenoh.Session,
    base: dict,
    arrived: queue.SimpleQueue[tuple[float, dict]],
    born: float,
    stop: threading.Event,
) -> None:
    """Obey the commands that arrive, and say what became of it. ``born``: monotonic time [s] at which stamps are 0."""
    drives, waiting = Drives(), []
    acting: dict = {"act_at": -math.inf, "seq": -1, "gripper": "open", "lifetime": 0.0}
    for seq in itertools.takewhile(lambda _: not stop.is_set(), itertools.count()):
        now = seq * STEP
        time.sleep(max(0.0, born + now - time.monotonic()))
        new = [arrived.get() for _ in range(arrived.qsize())]
        waiting += [command for _, command in new if command["life"] == LIFE and command["version"] == VERSION]
        due = [command for command in waiting if command["act_at"] <= now and command["seq"] > acting["seq"]]
        acting = max([acting, *due], key=lambda command: command["seq"])
        waiting = [command for command in waiting if command["act_at"] > now]
        fresh = now - acting["act_at"] < acting["lifetime"]  # later it has expired: stand
        twist, rates = (acting["twist"], acting["joint_velocity"]) if fresh else ([0.0, 0.0], [0.0] * 7)
        drives.move(twist, rates, acting["gripper"], STEP)
        heard = [(command["seq"], at) for at, command in new]
        state = {"seq": seq, "stamp": now, "pose": drives.pose, "odometry": drives.pose, "twist": twist, "q": drives.q,
                 "dq": rates, "gripper_width": drives.width, "gripper_moving": False, "heard": heard}  # fmt: skip
        session.put(KEY + "state", json.dumps(base | state))
        if seq % 5 == 0:
            wall = [random.gauss(10.0, 0.01) for _ in range(721)]  # a lidar that says nothing, or never changes, fails
            scan = {"stamp": now, "pose": drives.pose, "origin": [0.0, 0.0], "angle_min": -math.pi, "range_min": 0.05,
                    "angle_step": 2 * math.pi / 720, "range_max": 15.0, "ranges": wall}  # fmt: skip
            session.put(KEY + "scan", json.dumps(base | scan))


if __name__ == "__main__":
    try:
        main()
    except zenoh.ZError:
        sys.exit(f"nobody answers at {ENDPOINT}: start `motm-twin serve exp1 --plant zenoh` first, or give its address")
