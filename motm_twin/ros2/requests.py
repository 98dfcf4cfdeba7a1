"""Requests of ROS 2 programs as commands of the twin: cmd_vel, goal pose, initial pose."""

import math
import threading
import time
from collections.abc import Callable

import zenoh

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Command, Drive, DriveToPoint, PushRobot
from motm_twin.model.geometry import wrap_angle
from motm_twin.ros2.cdr import CdrError, Message, decode
from motm_twin.ros2.convert import MAP, yaw_of
from motm_twin.ros2.forms import CMD_VEL, GOAL_POSE, INITIAL_POSE, Topic

SENDER, NAME = "ros2", "ROS 2"
BETWEEN = 0.05  # [s] between two drive commands: one a period; of what comes faster the newest counts
ANSWER = 0.5  # [s] to wait for the twin's answer
MAX_BYTES = 4096  # of a message that is accepted here; they have some hundred


class Requests:
    """Keeps the newest message of each topic, and forwards it from its own thread."""

    def __init__(self, client: TwinClient, refuse: Callable[..., None]) -> None:
        """``refuse`` is told (topic, text, unreadable=) why a message has no effect, or is none."""
        self._client, self._refuse = client, refuse
        self._newest: dict[Topic, bytes] = {}
        self._changed, self._closed = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="from ROS 2", daemon=True)
        self._thread.start()

    def put(self, topic: Topic, payload: bytes) -> None:
        """A message has come; quick, and from any thread."""
        with self._changed:
            self._newest[topic] = payload[: MAX_BYTES + 1]
            self._changed.notify()

    def close(self) -> None:
        """End the thread."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._newest or self._closed)
                if self._closed:
                    return
                taken, self._newest = self._newest, {}
            began = time.monotonic()
            for topic, payload in taken.items():
                self._send(topic, payload)
            with self._changed:
                self._changed.wait_for(lambda: self._closed, began + BETWEEN - time.monotonic())

    def _send(self, topic: Topic, payload: bytes) -> None:
        try:
            if len(payload) > MAX_BYTES:
                raise CdrError(f"more than {MAX_BYTES} bytes")
            message = decode(topic.message, payload)
        except CdrError as error:
            self._refuse(topic, str(error), unreadable=True)
            return
        try:
            command = self._command(topic, message)
            answer = self._client.command(command, ANSWER, sender=SENDER, name=NAME)
        except (ValueError, zenoh.ZError) as error:
            self._refuse(topic, str(error), unreadable=False)
            return
        if not answer.ok:
            self._refuse(topic, answer.reason, unreadable=False)

    def _command(self, topic: Topic, message: Message) -> Command:
        """The command for a message; raises ValueError when it is not possible now."""
        if topic is CMD_VEL:
            return self._drive(message)
        if topic is GOAL_POSE:
            x, y, yaw = _pose_on_map(message["header"], message["pose"])
            return DriveToPoint(x=x, y=y, heading=yaw)
        assert topic is INITIAL_POSE
        return self._put_there(*_pose_on_map(message["header"], message["pose"]["pose"]))

    def _drive(self, twist: Message) -> Command:
        status = self._client.status()
        if status is not None and status.state not in ("playing", "done") and not status.held:
            raise ValueError(f"the twin is {status.state}: it is driven by hand only while time runs; play it first")
        v, w = twist["linear"]["x"], twist["angular"]["z"]
        if not (math.isfinite(v) and math.isfinite(w)):
            raise ValueError(f"a twist of {v:g} m/s and {w:g} rad/s: it has to be finite")
        return Drive(v=v, w=w)

    def _put_there(self, x: float, y: float, yaw: float) -> Command:
        """Initial pose: a simulated robot is always localised, so it is moved there."""
        tick, status = self._client.tick(), self._client.status()
        if tick is None or status is None:
            raise ValueError("no scene is running")
        if status.plant != "simulated":
            raise ValueError("an external robot can not be put elsewhere: it localises itself")
        true_x, true_y, heading = tick.robot.true_pose
        return PushRobot(dx=x - true_x, dy=y - true_y, turn=wrap_angle(yaw - heading))


def _pose_on_map(header: Message, pose: Message) -> tuple[float, float, float]:
    """x, y and heading; raises ValueError for another frame or numbers that are none."""
    frame = header["frame_id"].lstrip("/")
    if frame not in ("", MAP):
        raise ValueError(f"a pose in the frame {frame[:40]!r}: give it in {MAP!r} (RViz: the fixed frame)")
    x, y, yaw = pose["position"]["x"], pose["position"]["y"], yaw_of(pose["orientation"])
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"the point ({x:g}, {y:g}) is not finite")
    return x, y, yaw
