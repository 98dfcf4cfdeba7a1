"""The ROS 2 bridge as a program: ``python -m motm_twin.ros2.bridge_process --endpoint tcp/127.0.0.1:7447``."""

import argparse
import faulthandler
import math
import sys
import threading
import time
from collections import Counter, deque
from collections.abc import Callable
from typing import Any

import zenoh

from motm_twin.bus.client import TwinClient, decode_grid_info, decode_robot, decode_scan, decode_tick
from motm_twin.bus.commands import Command, Drive, DriveToPoint, PushRobot
from motm_twin.bus.connection import (
    DEFAULT_PORT,
    DEFAULT_TWIN,
    LOOPBACK,
    ConfigError,
    Keys,
    answers,
    direct,
    open_member,
)
from motm_twin.model import bounds
from motm_twin.model.geometry import wrap_angle
from motm_twin.model.scene import Scene
from motm_twin.processes import Reporter, await_stop, leave, stop_event
from motm_twin.program import BAD_INPUT
from motm_twin.ros2 import convert
from motm_twin.ros2 import forms as topics
from motm_twin.ros2.cdr import CdrError, Message, decode
from motm_twin.ros2.convert import MAP, Markers, yaw_of
from motm_twin.ros2.forms import (
    BRIDGE,
    CMD_VEL,
    DISTROS,
    FORMS,
    GOAL_POSE,
    INITIAL_POSE,
    RMW,
    BridgeForm,
    Form,
    Outlets,
    RmwForm,
    Topic,
)
from motm_twin.ros2.robot_model import FILES, RobotModel

SENDER, NAME = "ros2", "ROS 2"
BETWEEN = 0.05  # [s] between two commands: one a period; of messages that come faster, the newest counts
COMMANDED = 0.5  # [s] to wait for the twin's answer
MAX_BYTES = 4096  # of an accepted message; real ones have a few hundred


class Requests:
    """Keeps the newest message of each topic, and forwards it from its own thread."""

    def __init__(self, client: TwinClient, refuse: Callable[..., None]) -> None:
        """``refuse`` is called with (topic, text, unreadable=) when a message has no effect or cannot be read."""
        self._client, self._refuse = client, refuse
        self._newest: dict[Topic, bytes] = {}
        self._changed, self._closed = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="from ROS 2", daemon=True)
        self._thread.start()

    def put(self, topic: Topic, payload: bytes) -> None:
        """Take a message that has arrived; returns at once, and may be called from any thread."""
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
            answer = self._client.command(command, COMMANDED, sender=SENDER, name=NAME)
        except (ValueError, zenoh.ZError) as error:
            self._refuse(topic, str(error), unreadable=False)
            return
        if not answer.ok:
            self._refuse(topic, answer.reason, unreadable=False)

    def _command(self, topic: Topic, message: Message) -> Command:
        """The command for a message; raises ValueError when it is impossible now."""
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
        """The push to an initial pose: a simulated robot is always localised. Raises ValueError if impossible."""
        tick, status = self._client.tick(), self._client.status()
        if tick is None or status is None:
            raise ValueError("no scene is running")
        if status.plant != "simulated":
            raise ValueError("an external robot can not be put elsewhere: it localises itself")
        true_x, true_y, heading = tick.robot.true_pose
        push = PushRobot(dx=x - true_x, dy=y - true_y, turn=wrap_angle(yaw - heading))
        if problem := bounds.problem(push):
            raise ValueError(f"the simulated robot is pushed to the pose; {problem}: push it there in several steps")
        return push


def _pose_on_map(header: Message, pose: Message) -> tuple[float, float, float]:
    """x, y and heading; raises ValueError for another frame or numbers that are not finite."""
    frame = header["frame_id"].lstrip("/")
    if frame not in ("", MAP):
        raise ValueError(f"a pose in the frame {frame[:40]!r}: give it in {MAP!r} (RViz: the fixed frame)")
    x, y, yaw = pose["position"]["x"], pose["position"]["y"], yaw_of(pose["orientation"])
    if not (math.isfinite(x) and math.isfinite(y)):
        raise ValueError(f"the point ({x:g}, {y:g}) is not finite")
    return x, y, yaw


WAITING = 100  # messages of the twin that may wait; a bridge that cannot keep up drops the oldest
LOOK = 0.1  # [s] between checks for a new scene while no message comes
MARKERS_EVERY = 2  # periods
ANSWER = 1.0  # [s] to wait for an answer of the twin

Report = Callable[[str], None]


class Bridge:
    """One twin in one ROS 2 graph, never blocking the control loop."""

    def __init__(
        self, twin: zenoh.Session, ros: zenoh.Session, client: TwinClient, form: Form, meshes: str, report: Report
    ) -> None:
        """``twin`` and ``ros`` may be one session; ``report`` is called with a sentence for each refusal."""
        self.sent: Counter[str] = Counter()  # messages by topic
        self.unreadable: Counter[str] = Counter()  # malformed messages, by key or topic
        self._client, self._meshes, self._report = client, meshes, report
        self._scene: Scene | None = None
        self._model: RobotModel | None = None
        self._markers = Markers()
        self._waiting: deque[tuple[Callable[..., None], str, tuple[bytes, ...]]] = deque(maxlen=WAITING)
        self._told: set[str] = set()  # keys on which the twin has published
        self._come, self._closed = threading.Event(), False
        self._requests = Requests(client, self._refuse)
        self._outlets = Outlets(ros, form, self._requests.put)
        self._twin, self._keys = twin, Keys(client.keys.twin)
        keys = self._keys
        self._subscribers = [
            twin.declare_subscriber(keys.robot, self._direct(self._robot)),
            twin.declare_subscriber(keys.scan, self._direct(self._scan)),
        ]
        self._leave = [
            client.on_tick(lambda payload: self._tell(self._tick, keys.tick, payload)),
            client.on_grid(lambda cells, info: self._tell(self._grid, keys.grid, cells, info)),
        ]
        self._thread = threading.Thread(target=self._run, name="to ROS 2", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Withdraw everything; the sessions and the client stay open."""
        self._closed = True
        self._come.set()
        self._thread.join()
        self._requests.close()
        for forget in self._leave:
            forget()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._outlets.close()

    def _direct(self, handle: Callable[..., None]) -> zenoh.handlers.Callback:
        def take(sample: zenoh.Sample) -> None:
            key = str(sample.key_expr)
            if "*" not in key:  # otherwise it is not from the twin
                self._tell(handle, key, sample.payload.to_bytes())

        return direct(take)

    def _tell(self, handle: Callable[..., None], key: str, *payloads: bytes) -> None:
        """Queue a published message; answers to earlier queries of its key are outdated now."""
        self._told.add(key)
        self._put(handle, key, *payloads)

    def _put(self, handle: Callable[..., None], key: str, *payloads: bytes) -> None:
        self._waiting.append((handle, key, payloads))
        self._come.set()

    def _run(self) -> None:
        while not self._closed:
            self._come.wait(LOOK)
            self._come.clear()
            self._follow_scene()
            while self._waiting and not self._closed:
                handle, key, payloads = self._waiting.popleft()
                try:
                    handle(*payloads)
                except Exception as error:  # one bad message must not stop the next
                    self.unreadable[key] += 1
                    self._report(f"{key}: {type(error).__name__}: {error}")

    def _publish(self, topic: topics.Topic, message: dict[str, Any]) -> None:
        self._outlets.put(topic, message)
        self.sent[topic.name] += 1

    def _follow_scene(self) -> None:
        """Follow the loading of another scene; publish the robot's description if it is another robot."""
        scene = self._client.scene()
        if scene is None or scene is self._scene:
            return
        before, self._scene = self._scene, scene
        self._markers.show(scene)
        if before is None:
            self._ask_for_the_last()
        if before is not None and before.robot == scene.robot:
            return
        self._model = RobotModel(scene.robot, self._meshes)
        self._publish(topics.ROBOT_DESCRIPTION, {"data": self._model.urdf})
        self._publish(topics.TF_STATIC, convert.tf_message(self._model.static(), 0.0))

    def _ask_for_the_last(self) -> None:
        """Query the last values: a paused twin publishes nothing."""
        keys = self._keys
        handlers = {keys.robot: self._robot, keys.scan: self._scan, keys.tick: self._tick, keys.grid: self._grid}
        for key, handle in handlers.items():
            for answer in answers(self._twin.get(key, timeout=ANSWER), key):
                if key not in self._told:
                    attached = answer.attachment
                    self._put(handle, key, answer.payload.to_bytes(), *([attached.to_bytes()] if attached else []))

    def _robot(self, payload: bytes) -> None:
        robot = decode_robot(payload)
        self._publish(topics.CLOCK, convert.clock(robot.time))
        self._publish(topics.ODOM, convert.odometry(robot))
        if self._model is not None:
            self._publish(topics.JOINT_STATES, convert.joint_states(robot, self._model))
            self._publish(topics.TF, convert.transforms(robot, self._model))

    def _scan(self, payload: bytes) -> None:
        scan = decode_scan(payload)
        if self._scene is not None:
            self._publish(topics.SCAN, convert.laser_scan(scan, self._scene.robot.lidar.rate))

    def _grid(self, cells: bytes, attachment: bytes) -> None:
        self._publish(topics.MAP, convert.occupancy_grid(decode_grid_info(attachment), cells))

    def _tick(self, payload: bytes) -> None:
        tick = decode_tick(payload)
        if not self._client.of_scene(tick):
            return
        self._publish(topics.PLAN, convert.plan_path(tick.plan.global_path, tick.time))
        self._publish(topics.LOCAL_PLAN, convert.local_path(tick.plan, tick.time))
        if tick.index % MARKERS_EVERY == 0 or tick.preview or not self.sent[topics.MARKERS.name]:
            self._publish(topics.MARKERS, self._markers.array(tick))

    def _refuse(self, topic: topics.Topic, text: str, *, unreadable: bool) -> None:
        if unreadable:
            self.unreadable[topic.name] += 1
        self._report(f"{topic.name}: {text}")


CLOSING = 15.0  # [s] limit of closing: its peers may be gone
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
    await_stop(stop)
    faulthandler.dump_traceback_later(CLOSING, exit=True)  # if closing hangs: print the stacks, and exit
    bridge.close()
    client.close()
    for session in {id(twin): twin, id(ros): ros}.values():
        session.close()
    report("ended", sent=dict(bridge.sent), unreadable=dict(bridge.unreadable))
    leave(0)


def make_form(options: argparse.Namespace, zid: str) -> Form:
    """The requested form; raises ValueError for an invalid prefix or domain."""
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
