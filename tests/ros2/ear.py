"""A served twin with both forms of the bridge, and a program that listens to it and reads with rosbags."""

import time
from collections import defaultdict

import msgspec
import zenoh
from rosbags.typesys import Stores, get_typestore
from running import real_server
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import open_member
from motm_twin.bus.messages import RobotStateMessage, ScanMessage, TickMessage
from motm_twin.planning.types import SearchBudget
from motm_twin.ros2.bridge_process import Bridge
from motm_twin.ros2.forms import PUBLISHED, BridgeForm, RmwForm
from motm_twin.ros2.robot_model import PRIMITIVES
from motm_twin.twin import Twin

JAZZY = get_typestore(Stores.ROS2_JAZZY)
HUMBLE = get_typestore(Stores.ROS2_HUMBLE)


def direct(callback):
    return zenoh.handlers.Callback(callback, indirect=False)


class Served:
    """Twin server, two bridges, and sessions to listen with."""

    def __enter__(self):
        by_the_clock = {"budget": SearchBudget(seconds=0.02), "clock": time.perf_counter}
        self.server = real_server(make_twin=lambda scene, method: Twin(scene, method=method, **by_the_clock))
        self.server.start()
        self.session = open_member(self.server.endpoint)
        self.client = TwinClient(self.server.endpoint, sender="ros2")  # speaks for the same person as the bridges
        self.refused = []
        self._members = {name: open_member(self.server.endpoint) for name in ("bridge", "rmw")}
        self.zids = {name: str(member.info.zid()) for name, member in self._members.items()}
        self.forms = {
            "bridge": BridgeForm(self.zids["bridge"]),
            "rmw": RmwForm(self.zids["rmw"], node="motm_twin", domain=7),
        }
        self.bridges = {
            name: Bridge(member, member, self.client, self.forms[name], PRIMITIVES, self.refused.append)
            for name, member in self._members.items()
        }
        until(lambda: self.tick is not None and self.client.scene() is not None, "the twin never ran", 240.0)
        return self

    def __exit__(self, *_):
        for bridge in self.bridges.values():
            bridge.close()
        self.client.close()
        for session in (self.session, *self._members.values()):
            session.close()
        self.server.close()

    @property
    def tick(self):
        return self.client.tick()

    def say(self, key, payload):
        """As a twin server of another version would: nobody else can speak on its keys."""
        self.server._session.put(key, payload)

    def publish(self, form, topic, payload):
        """As a ROS 2 program would."""
        self.session.put(self.forms[form].key(topic), payload)


class Ear:
    """Listens to all topics of one form, and to the twin itself."""

    def __init__(self, served, form):
        self.form, self.heard, self.attached = served.forms[form], defaultdict(list), {}
        self.robot, self.scan, self.ticks, self.grids = {}, {}, {}, {}
        keys = served.client.keys
        self._subscribers = [
            served.session.declare_subscriber(self.form.key(topic), direct(lambda s, t=topic: self._take(t, s)))
            for topic in PUBLISHED
        ]
        native = ((keys.robot, RobotStateMessage, self.robot, "time"), (keys.scan, ScanMessage, self.scan, "stamp"),
                  (keys.tick, TickMessage, self.ticks, "time"))  # fmt: skip
        for key, kind, kept, name in native:
            decode = msgspec.json.Decoder(kind).decode
            self._subscribers.append(served.session.declare_subscriber(key, direct(self._keeper(decode, kept, name))))
        self._subscribers.append(served.session.declare_subscriber(keys.grid, direct(self._keep_grid)))

    def __enter__(self):
        return self

    def __exit__(self, *_):
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def wait(self, topic, count=1):
        """The newest ``count`` messages of a topic, oldest first, once there are as many."""
        until(lambda: len(self.heard[topic]) >= count, f"{topic.name} never came")
        return [JAZZY.deserialize_cdr(payload, topic.message) for payload in self.heard[topic][-count:]]

    def _take(self, topic, sample):
        self.heard[topic].append(sample.payload.to_bytes())
        self.attached[topic] = None if sample.attachment is None else sample.attachment.to_bytes()

    @staticmethod
    def _keeper(decode, kept, name):
        def keep(sample):
            message = decode(sample.payload.to_bytes())
            kept[round(getattr(message, name), 6)] = message

        return keep

    def _keep_grid(self, sample):
        info = msgspec.json.decode(sample.attachment.to_bytes())
        self.grids[round(info["stamp"], 6)] = (info, sample.payload.to_bytes())


def at(stamp):
    """The time [s] of a stamp."""
    return round(stamp.sec + 1e-9 * stamp.nanosec, 6)
