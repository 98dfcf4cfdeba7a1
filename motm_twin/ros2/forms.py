"""The bridge's topics in two forms of ROS 2 over Zenoh (zenoh-bridge-ros2dds, rmw_zenoh), and their liveliness tokens.

Formats: rmw_zenoh `docs/design.md` and `liveliness_utils.cpp`; zenoh-plugin-ros2dds `liveliness_mgt.rs`; type hashes of
messages, which rmw_zenoh puts into its keys since Iron: REP 2016, "RIHS01".
"""

import hashlib
import json
import re
import struct
import time
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import zenoh
import zenoh.ext

from motm_twin.bus.connection import direct
from motm_twin.ros2.cdr import DEFINITIONS, NONE, SEQUENCE, Field, Message, dds_name, encode, fields

UNSUPPORTED = "TypeHashNotSupported"  # written by rmw_zenoh of Humble, which has no hashes
_BASIC = {
    "int8": 2, "uint8": 3, "int16": 4, "uint16": 5, "int32": 6, "uint32": 7, "int64": 8, "uint64": 9,
    "float32": 10, "float64": 11, "bool": 15, "string": 17,
}  # fmt: skip
_NESTED, _ARRAY, _SEQUENCE = 1, 48, 144
BRIDGE, RMW = "bridge", "rmw"
FORMS = (BRIDGE, RMW)
DISTROS = ("humble", "jazzy")
PUBLISHER, SUBSCRIBER = "MP", "MS"
MAX_DOMAIN = 232  # ROS_DOMAIN_ID
_RMW_DEPTH = 42  # default depth of rmw_zenoh, which its tokens leave out
_PREFIX = re.compile(r"/([A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*/?)?\Z")


class Topic(NamedTuple):
    """One topic. All are reliable, which every subscriber accepts; latched ones are transient local."""

    name: str
    message: str
    depth: int = 10
    latched: bool = False


JOINT_STATES = Topic("joint_states", "sensor_msgs/msg/JointState")
ODOM = Topic("odom", "nav_msgs/msg/Odometry")
TF = Topic("tf", "tf2_msgs/msg/TFMessage", depth=100)
TF_STATIC = Topic("tf_static", "tf2_msgs/msg/TFMessage", depth=1, latched=True)
SCAN = Topic("scan", "sensor_msgs/msg/LaserScan")
MAP = Topic("map", "nav_msgs/msg/OccupancyGrid", depth=1, latched=True)
PLAN = Topic("plan", "nav_msgs/msg/Path")
LOCAL_PLAN = Topic("local_plan", "nav_msgs/msg/Path")
MARKERS = Topic("markers", "visualization_msgs/msg/MarkerArray")
ROBOT_DESCRIPTION = Topic("robot_description", "std_msgs/msg/String", depth=1, latched=True)
CLOCK = Topic("clock", "rosgraph_msgs/msg/Clock", depth=1)
PUBLISHED = (
    JOINT_STATES, ODOM, TF, TF_STATIC, SCAN, MAP, PLAN, LOCAL_PLAN, MARKERS, ROBOT_DESCRIPTION, CLOCK,
)  # fmt: skip
CMD_VEL = Topic("cmd_vel", "geometry_msgs/msg/Twist", depth=1)
GOAL_POSE = Topic("goal_pose", "geometry_msgs/msg/PoseStamped", depth=1)
INITIAL_POSE = Topic("initialpose", "geometry_msgs/msg/PoseWithCovarianceStamped", depth=1)
ACCEPTED = (CMD_VEL, GOAL_POSE, INITIAL_POSE)


@cache
def type_hash(message: str) -> str:
    """``RIHS01_`` and the SHA-256 of the message's description with everything it refers to."""
    described = {
        "type_description": _described(message),
        "referenced_type_descriptions": [_described(name) for name in sorted(_referred(message))],
    }
    text = json.dumps(described, separators=(", ", ": "))
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def _referred(message: str) -> set[str]:
    found: set[str] = set()
    for field in fields(message):
        if field.base in DEFINITIONS:
            found |= {field.base} | _referred(field.base)
    return found


def _described(message: str) -> dict:
    return {"type_name": message, "fields": [{"name": f.name, "type": _type(f)} for f in fields(message)]}


def _type(field: Field) -> dict:
    nested = field.base in DEFINITIONS
    offset = {NONE: 0, SEQUENCE: _SEQUENCE}.get(field.count, _ARRAY)
    return {
        "type_id": (_NESTED if nested else _BASIC[field.base]) + offset,
        "capacity": max(field.count, 0),
        "string_capacity": 0,
        "nested_type_name": field.base if nested else "",
    }


def check_prefix(prefix: str) -> str:
    """The namespace without a slash at its end; raises ValueError for one that ROS 2 does not allow."""
    if not _PREFIX.match(prefix):
        raise ValueError(
            f"prefix {prefix!r}: write /, or names of letters, digits and '_' such as /robot1 or /lab/robot1"
        )
    return prefix.rstrip("/")


class BridgeForm:
    """Form of a program that is reached through zenoh-bridge-ros2dds: the topic is the key."""

    def __init__(self, zid: str, *, prefix: str = "/", distro: str = "jazzy") -> None:
        """``zid``: of the Zenoh session."""
        self._zid, self._prefix, self._hashes = zid, check_prefix(prefix), _has_hashes(distro)

    def key(self, topic: Topic) -> str:
        """Key of a topic's data: the topic without its first slash."""
        return f"{self._prefix}/{topic.name}".lstrip("/")

    def own_tokens(self) -> list[str]:
        """Liveliness tokens of this program, which appears as another bridge."""
        return [f"@/{self._zid}/@ros2_lv"]

    def token(self, topic: Topic, kind: str, number: int) -> str:
        """Liveliness token of a publisher or subscriber; ``number`` is unique in this program.

        Bridges make a route from it, so that the topic is listed before anybody subscribes.
        """
        key, message = self.key(topic).replace("/", "§"), topic.message.replace("/", "§")
        qos = f":1:{int(topic.latched)}:0,{topic.depth}"  # no key; reliable; durability; keep last
        user_data = f":typehash={type_hash(topic.message)};" if self._hashes else ""
        return f"@/{self._zid}/@ros2_lv/{kind}/{key}/{message}/{qos}{user_data}"

    def attachment(self, token: str, sequence: int, nanoseconds: int) -> None:
        """This form has no attachment."""


class RmwForm:
    """Form of a ROS 2 node with RMW_IMPLEMENTATION=rmw_zenoh_cpp."""

    def __init__(self, zid: str, *, node: str, domain: int = 0, prefix: str = "/", distro: str = "jazzy") -> None:
        """``zid``: of the Zenoh session; ``node``: name in the ROS graph."""
        if not 0 <= domain <= MAX_DOMAIN:
            raise ValueError(f"domain {domain}: ROS_DOMAIN_ID is 0 to {MAX_DOMAIN}")
        self._prefix, self._hashes, self._domain = check_prefix(prefix), _has_hashes(distro), domain
        space = _mangled(self._prefix)
        self._graph, self._node = f"@ros2_lv/{domain}/{zid}/0", f"%/{space}/{node}"

    def key(self, topic: Topic) -> str:
        """Domain, topic, type and hash of the type."""
        name = f"{self._prefix}/{topic.name}".strip("/")
        return f"{self._domain}/{name}/{dds_name(topic.message)}/{self._hash(topic)}"

    def own_tokens(self) -> list[str]:
        """Liveliness token of the node."""
        return [f"{self._graph}/0/NN/{self._node}"]

    def token(self, topic: Topic, kind: str, number: int) -> str:
        """Liveliness token of one endpoint in the ROS graph."""
        name = _mangled(f"{self._prefix}/{topic.name}")
        depth = "" if topic.depth == _RMW_DEPTH else topic.depth
        qos = f":{1 if topic.latched else ''}:,{depth}:,:,:,,"  # empty fields are the defaults: reliable, keep last
        endpoint = f"{self._graph}/{number + 1}/{kind}/{self._node}"
        return f"{endpoint}/{name}/{dds_name(topic.message)}/{self._hash(topic)}/{qos}"

    def attachment(self, token: str, sequence: int, nanoseconds: int) -> bytes:
        """Sequence number, Unix time and the publisher's id, without which rmw_zenoh drops a message."""
        gid = hashlib.sha256(token.encode()).digest()[:16]  # any unique 16 bytes: receivers do not recompute them
        return struct.pack("<qqB", sequence, nanoseconds, len(gid)) + gid

    def _hash(self, topic: Topic) -> str:
        return type_hash(topic.message) if self._hashes else UNSUPPORTED


def _has_hashes(distro: str) -> bool:
    if distro not in DISTROS:
        raise ValueError(f"distro {distro!r}: choose one of {', '.join(DISTROS)}")
    return distro != "humble"


def _mangled(name: str) -> str:
    return name.replace("/", "%") or "%"


Form = BridgeForm | RmwForm


class Outlet:
    """One published topic."""

    def __init__(self, session: zenoh.Session, form: Form, topic: Topic, number: int) -> None:
        self._form, self._topic, self._sequence = form, topic, 0
        self._name = form.token(topic, PUBLISHER, number)
        if topic.latched:  # the last messages are kept for late joiners, as both forms do since 2025
            self._publisher = zenoh.ext.declare_advanced_publisher(
                session,
                form.key(topic),
                cache=zenoh.ext.CacheConfig(max_samples=topic.depth),
                sample_miss_detection=zenoh.ext.MissDetectionConfig(heartbeat=None, sporadic_heartbeat=0.5),
                publisher_detection=True,
            )
        else:
            self._publisher = session.declare_publisher(form.key(topic))
        self._token = session.liveliness().declare_token(self._name)

    def put(self, message: Message) -> None:
        """Send a message to the subscribers; a slow one misses it rather than block. Raises CdrError."""
        payload = encode(self._topic.message, message)
        self._sequence += 1
        attachment = self._form.attachment(self._name, self._sequence, time.time_ns())
        self._publisher.put(payload, attachment=attachment)

    def close(self) -> None:
        """Withdraw the topic."""
        self._token.undeclare()
        self._publisher.undeclare()


class Outlets:
    """All topics, published and accepted."""

    def __init__(self, session: zenoh.Session, form: Form, accept: Callable[[Topic, bytes], None]) -> None:
        """``accept`` is called in Zenoh's thread with the bytes of every message that comes: it must be quick."""
        liveliness = session.liveliness()
        self._tokens = [liveliness.declare_token(token) for token in form.own_tokens()]
        self._outlets = {topic: Outlet(session, form, topic, number) for number, topic in enumerate(PUBLISHED)}
        self._subscribers = []
        for number, topic in enumerate(ACCEPTED, len(PUBLISHED)):
            heard = direct(lambda sample, topic=topic: accept(topic, sample.payload.to_bytes()))
            self._subscribers.append(session.declare_subscriber(form.key(topic), heard))
            self._tokens.append(liveliness.declare_token(form.token(topic, SUBSCRIBER, number)))

    def put(self, topic: Topic, message: Message) -> None:
        """Publish a message."""
        self._outlets[topic].put(message)

    def close(self) -> None:
        """Withdraw everything."""
        for declared in (*self._tokens, *self._subscribers):
            declared.undeclare()
        for outlet in self._outlets.values():
            outlet.close()
