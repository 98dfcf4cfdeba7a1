"""Malformed messages, repeatable by a seed: commands and queries of a twin, and the keys of an external robot.

None can be valid by chance: mutated messages have expired long ago.
"""

import json
import random
import string
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import zenoh

from motm_twin.bus.commands import COMMAND_NAMES, MAX_COMMAND_BYTES, MAX_NAME
from motm_twin.bus.connection import Keys, PlantKeys
from motm_twin.control.tick import Tick
from motm_twin.external.robot import LinkSpec
from motm_twin.external.robot_link import NAMES
from motm_twin.model.scene_file import load_scene
from motm_twin.perf.processes import external_robot, wait_for
from motm_twin.twin import Twin

LONG_AGO = 1.0  # [s] so far in the past that a few changed characters never make it a valid time
SOON = 30.0  # [s] from now until a fresh envelope expires
BIG = 4_000_000  # bytes

# A valid command of every type; an unknown scene, body or task would be another reason to refuse it.
EXAMPLES: dict[str, dict[str, Any]] = {
    "play": {},
    "audience": {"pages": 2},
    "pause": {},
    "step": {"count": 3},
    "reset": {},
    "speed": {"factor": 2.0},
    "load": {"scene": "exp1", "variant": "trial2", "seed": 3},
    "seed": {"seed": 3},
    "drive_to": {"x": 1.5, "y": -0.5, "heading": 0.1},
    "save": {"name": "mine"},
    "record": {"action": "start", "name": "mine"},
    "branch": {"index": 0},
    "undo_branch": {},
    "inspect": {"candidate": 3, "staa_path": True},
    "take_wheel": {},
    "hand_over": {"to": "somebody", "name": "Somebody"},
    "add_obstacle": {"name": "crate", "shape": "box", "x": 1.0, "y": -0.6, "heading": 0.0, "size": [0.3, 0.3, 0.5]},
    "move_body": {"name": "table", "x": 1.0, "y": -0.6, "heading": 0.2, "held": False},
    "release_body": {"name": "table", "velocity": [0.5, 0.0]},
    "freeze_body": {"name": "table", "frozen": True},
    "send_agent": {"name": "temi1", "x": 1.0, "y": 0.0},
    "set_behaviour": {"name": "temi1", "behaviour": "blind"},
    "remove_body": {"name": "cabinet"},
    "move_object": {"name": "cube1", "x": 3.0, "y": 1.5},
    "push_robot": {"dx": 0.1, "dy": 0.0, "turn": 0.1},
    "inject_fault": {"fault": "lidar_off", "seconds": 2.0, "delay": 0.1},
    "insert_task": {"tasks": [{"type": "drive_to", "point": [1.0, 0.0]}], "index": 0},
    "remove_task": {"index": 11},
    "move_task": {"index": 2, "to": 4},
    "set_parameter": {"name": "xi", "value": 0.7},
    "announce": {"name": "table"},
    "drive": {"v": 0.3, "w": 0.1},
}

INTEGER = "@@integer@@"  # stands for an integer that is too long for Python to print
WRONG: list[Any] = [
    *(None, True, "x", "", -1.5e308, 1e300, -(10**400), INTEGER, [], [[]], {}, {"a": 1}, [1, "2"], "\u0000")
]
HUGE = ["1e999", "-1e999", "NaN", "Infinity", "1" * 400, "-" + "9" * 5000, "1e", "0x10", "01"]


@dataclass(frozen=True)
class Message:
    """One malformed message."""

    how: str  # the kind of its fault
    kind: str  # "command", "query" (of another key), "put", "delete" or "raw" (bytes on the TCP port)
    key: str
    payload: bytes = b""
    parameters: str = ""


class Fuzzer:
    """Makes malformed messages for one twin; ``now``: the server's clock [s]."""

    def __init__(self, twin: str, seed: int, now: Callable[[], float]) -> None:
        self._keys = keys = Keys(twin)
        self._draw, self._now, self._seq = random.Random(seed), now, 2**40
        self._state = [key for key in keys.own if "*" not in key]
        self._others = [*self._state, keys.schemas, f"{keys.tick}/x", f"motm/{twin}/nothing", f"motm/{twin}/*", "**"]
        self._makers: dict[Callable[[], Message], int] = {  # with weights of their frequency
            self._random_bytes: 20, self._truncated: 12, self._mutated: 20, self._wrong_field: 20,
            self._wrong_number: 6, self._wrong_envelope: 6, self._deep: 4, self._wrong_key: 6, self._oversized: 3,
            self._other_encoding: 4, self._late: 5, self._query: 10, self._put: 8, self._raw: 2,
        }  # fmt: skip

    def messages(self, count: int) -> Iterator[Message]:
        """``count`` messages of all kinds, in random order."""
        makers, weights = list(self._makers), list(self._makers.values())
        for _ in range(count):
            yield self._draw.choices(makers, weights)[0]()

    def envelope(self, name: str, expires: float | None = None, **fields: Any) -> dict[str, Any]:
        """A valid envelope of a command, fresh unless ``expires`` is given; ``fields`` replace those of the command."""
        self._seq += 1
        return {
            "sender": "fuzz",
            "seq": self._seq,
            "expires": self._now() + SOON if expires is None else expires,
            "command": {"type": name, **EXAMPLES[name], **fields},
        }

    def _name(self) -> str:
        return self._draw.choice(COMMAND_NAMES)

    def _command(self, how: str, name: str, payload: bytes | Any) -> Message:
        data = payload if isinstance(payload, bytes) else json.dumps(payload).encode()
        return Message(how, "command", self._keys.command(name), data)

    def _bytes(self, longest: int = 2000) -> bytes:
        return self._draw.randbytes(self._draw.randint(0, longest))

    def _random_bytes(self) -> Message:
        return self._command("random bytes", self._name(), self._bytes())

    def _truncated(self) -> Message:
        name = self._name()
        whole = json.dumps(self.envelope(name)).encode()
        return self._command("cut off", name, whole[: self._draw.randrange(len(whole))])

    def _mutated(self) -> Message:
        """An envelope that expired long ago, with some bytes changed, missing, doubled or swapped."""
        name = self._name()
        data = bytearray(json.dumps(self.envelope(name, LONG_AGO)).encode())
        for _ in range(self._draw.randint(1, 3)):
            at, way = self._draw.randrange(len(data)), self._draw.randrange(4)
            if way == 0:
                data[at] = self._draw.randrange(256)
            elif way == 1:
                del data[at]
            elif way == 2:
                data[at:at] = data[at : at + self._draw.randint(1, 20)]
            else:
                other = self._draw.randrange(len(data))
                data[at], data[other] = data[other], data[at]
        return self._command("mutated", name, bytes(data))

    def _wrong_field(self) -> Message:
        """A fresh envelope of a command with an unknown field, or with a field of a wrong type or size."""
        name = self._draw.choice([name for name, fields in EXAMPLES.items() if fields])
        field = self._draw.choice(list(EXAMPLES[name]))
        wrong = self._draw.choice(self._draw.choice([_wrong_values(name, field), [...]]))
        envelope = self.envelope(name)
        if wrong is ...:
            envelope["command"]["unknown"] = 1
        else:
            envelope["command"][field] = wrong
        return self._command("wrong field", name, _dump(envelope))

    def _wrong_number(self) -> Message:
        """An envelope or command with a number that JSON or the server's types cannot represent."""
        name = self._draw.choice(["speed", "step", "push_robot", "drive", "seed", "branch"])
        envelope = self.envelope(name)
        place = self._draw.choice([envelope, envelope["command"]])
        field = self._draw.choice([key for key, value in place.items() if isinstance(value, (int, float))])
        text = _dump(envelope).replace(
            f'"{field}": {json.dumps(place[field])}'.encode(), f'"{field}": {self._draw.choice(HUGE)}'.encode()
        )
        return self._command("wrong number", name, text)

    def _wrong_envelope(self) -> Message:
        name = self._name()
        envelope = self.envelope(name)
        field = self._draw.choice(["sender", "seq", "expires", "command", "name"])
        wrong: dict[str, list[Any]] = {
            "sender": [None, 1, "", "x" * (MAX_NAME + 1), "a\nb", "\u202e", []],
            "seq": [None, -1, 2**63, 10**400, 1.5, "1", True, []],
            "expires": [None, 0.0, -1e300, 1e300, self._now() + 1e4, "soon", []],
            "command": [None, [], {}, "play", {"type": "no such"}, {"type": None}, {"type": ["play"]}],
            "name": [None, 1, "x" * 100, "a\x00", []],
        }
        envelope[field] = self._draw.choice(wrong[field])
        return self._command("wrong envelope", name, _dump(envelope))

    def _deep(self) -> Message:
        name, depth = self._name(), self._draw.choice([100, 2000, 20_000])
        opened, closed = self._draw.choice([(b"[", b"]"), (b'{"command":', b"}"), (b'{"a":[', b"]}")])
        depth = min(depth, MAX_COMMAND_BYTES // (len(opened) + len(closed)) - 1)
        inner = opened * depth + b"1" + closed * depth
        if self._draw.random() < 0.5:
            return self._command("deep", name, inner)
        whole = _dump(self.envelope(name))
        return self._command("deep", name, whole[:-2] + b', "deep": ' + inner[: MAX_COMMAND_BYTES - 2000] + b"}}")

    def _wrong_key(self) -> Message:
        """A valid command on the key of another command, on an unknown key, or on a pattern of keys."""
        name = self._name()
        other = self._draw.choice([other for other in COMMAND_NAMES if other != name])
        key = self._draw.choice([other, f"{name}/x", "nothing", "*", "**", f"x/{name}", "x" * 300, "ключ", f"{name}.x"])
        return self._command("wrong key", key, self.envelope(name))

    def _oversized(self) -> Message:
        name, size = self._name(), self._draw.choice([MAX_COMMAND_BYTES, 2 * MAX_COMMAND_BYTES, BIG])
        if size == BIG and self._draw.random() < 0.9:
            size = MAX_COMMAND_BYTES
        return self._command("oversized", name, _dump(self.envelope(name)) + b" " * size)

    def _other_encoding(self) -> Message:
        name, whole = self._name(), json.dumps(self.envelope("play"))
        text = self._draw.choice([whole.encode("utf-16"), whole.encode("utf-32"), whole.encode("utf-7")[1:]])
        return self._command(
            "encoding", name, self._draw.choice([text, b"\xff\xfe" + whole.encode(), b"\x85\xa6sender"])
        )

    def _late(self) -> Message:
        name = self._name()
        return self._command("expired", name, self.envelope(name, self._now() - self._draw.choice([0.001, 1.0, 1e6])))

    def _query(self) -> Message:
        """A query of another key, with unexpected parameters and payload."""
        word = "".join(self._draw.choices(string.printable, k=self._draw.randint(0, 40)))
        parameters = self._draw.choice(["", "from=", "from=-1", f"from={'9' * 60}", "from=1e3", "from=0;from=1", word])
        return Message("query", "query", self._draw.choice(self._others), self._bytes(200), parameters)

    def _put(self) -> Message:
        """A value or deletion on a key that only the twin publishes, or on a key of a command."""
        key = self._draw.choice([*self._state, self._keys.command(self._name())])
        kind = "delete" if self._draw.random() < 0.1 else "put"
        return Message("put", kind, key, self._bytes() if kind == "put" else b"")

    def _raw(self) -> Message:
        """Random bytes on the TCP port; some begin with a length as Zenoh's frames do."""
        data = self._bytes(500)
        if self._draw.random() < 0.5:
            data = len(data).to_bytes(2, "little") + data
        return Message("raw", "raw", "", data)


def _wrong_values(name: str, field: str) -> list[Any]:
    """The values of `WRONG` that are not allowed for a field."""
    right = EXAMPLES[name][field]
    allowed: list[Any] = []
    if isinstance(right, str):
        allowed = ["x", ""]  # an unknown name: only the twin refuses it
    if isinstance(right, bool):
        allowed = [True]
    if (name, field) in {("load", "variant"), ("load", "seed"), ("drive_to", "heading"), ("move_body", "heading")}:
        allowed = [*allowed, None]
    if name in ("set_parameter", "insert_task"):
        allowed = [*allowed, None, True, "x", "", []]
    return [value for value in WRONG if not any(value is other or value == other for other in allowed)]


def _dump(value: Any) -> bytes:
    return json.dumps(value).replace(f'"{INTEGER}"', "1" + 5000 * "0").encode()


EACH = 100  # messages in a period
UP = 120.0  # [s] until the robot has started on a busy machine
# wrong values of any field
WRONG_FIELDS: list[Any] = [None, True, "x", -1.5e308, 1e300, 10**40, [], [[]], {}, [1, "2"], [0.0] * 100]


class RobotFuzzer:
    """Makes messages that must be ignored: of another life, cut off, mistyped, too large; random bytes.

    They are made from the robot's own messages, which `heard` collects. Repeatable by the seed for equal messages.
    """

    def __init__(self, seed: int) -> None:
        self._draw, self._heard = random.Random(seed), dict[str, dict[str, Any]]()
        self._life: str | None = None  # the robot's life, from its first message

    def heard(self, sample: zenoh.Sample) -> None:
        """Keep a message of the robot; the malformed ones arrive here, too, and are skipped."""
        try:
            message = json.loads(sample.payload.to_bytes())
        except ValueError:
            return
        if not isinstance(message, dict) or not isinstance(message.get("version"), str):
            return
        self._life = self._life or message.get("life")
        if message.get("life") == self._life:
            self._heard[str(sample.key_expr)] = message

    def messages(self, count: int, keys: PlantKeys) -> Iterator[tuple[str, bytes]]:
        """``count`` keys and payloads."""
        topics = [keys.command, keys.grant, *(getattr(keys, name) for name in NAMES)]
        makers = (self._other_life, self._cut_off, self._mistyped, self._random)
        for _ in range(count):
            key = self._draw.choice(topics)
            like = self._heard.get(key) or next(iter(list(self._heard.values())))
            yield key, self._draw.choice(makers)(like)

    def _other_life(self, like: dict[str, Any]) -> bytes:
        """A valid message of one of a few other lives."""
        return json.dumps(like | {"life": f"other {self._draw.randrange(8)}"}).encode()

    def _cut_off(self, like: dict[str, Any]) -> bytes:
        whole = json.dumps(like).encode()
        return whole[: self._draw.randrange(len(whole))]

    def _mistyped(self, like: dict[str, Any]) -> bytes:
        """A message with a version or life that is no text; another field may be wrong or missing, too."""
        broken = dict(like)
        broken[self._draw.choice(list(like))] = self._draw.choice(WRONG_FIELDS)
        if self._draw.random() < 0.3:
            broken.pop(self._draw.choice(list(like)))
        wrong = {self._draw.choice(["version", "life"]): self._draw.choice(WRONG_FIELDS[3:])}
        return json.dumps(broken | wrong).encode()

    def _random(self, like: dict[str, Any]) -> bytes:
        return self._draw.randbytes(self._draw.randint(0, 2 * len(like)))


def attack_robot(count: int, seed: int = 3) -> dict[str, float]:
    """Drive a robot in another process while ``count`` malformed messages arrive, and a simulated one here without.

    Returns counts; "differing" are periods that differ in any bit between the two runs.
    """
    scene, keys, fuzzer = load_scene("exp1"), PlantKeys(), RobotFuzzer(seed)
    inside, differing, periods, sent = Twin(scene), 0, 0, 0
    with external_robot(scene, LinkSpec()) as plant:
        session = plant.link.session
        spies = [session.declare_subscriber(getattr(keys, name), fuzzer.heard) for name in NAMES]
        outside = Twin(scene, plant=plant)
        wait_for(plant.ready, UP, "robot in another process")
        while sent < count and not inside.done:
            here, there = inside.advance(), outside.advance()
            differing, periods = differing + (not _same(here, there)), periods + 1
            for key, payload in fuzzer.messages(min(EACH, count - sent), keys):
                session.put(key, payload)
                sent += 1
        unreadable = plant.link.unreadable
        for spy in spies:
            spy.undeclare()
    counts = {"sent": sent, "unreadable": unreadable, "periods": periods, "differing": differing}
    return {name: float(count) for name, count in counts.items()}


def _same(one: Tick, other: Tick) -> bool:
    """True when observation and command of two periods are equal."""
    seen, done = (one.observation, other.observation), (one.arm[-1].actuation, other.arm[-1].actuation)
    pairs = [[getattr(tick, name) for tick in seen] for name in ("pose", "q")]
    pairs += [[getattr(tick, name) for tick in done] for name in ("twist", "joint_velocity")]
    return one.time == other.time and all(np.array_equal(*pair) for pair in pairs)
