"""Malformed messages on the keys of a robot in another program, both ways, while it is driven."""

import json
import random
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import zenoh

from motm_twin.bench.external_trial import external_robot
from motm_twin.bench.page_serve import wait_for
from motm_twin.control.tick import Tick
from motm_twin.external.checks import NAMES
from motm_twin.external.emulator import LinkSpec
from motm_twin.external.keys import PlantKeys
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

EACH = 100  # messages in a period
UP = 120.0  # [s] for the robot to be there on a busy machine
WRONG: list[Any] = [None, True, "x", -1.5e308, 1e300, 10**40, [], [[]], {}, [1, "2"], [0.0] * 100]  # for any field


class RobotFuzzer:
    """Makes messages that must not count: of another life, cut off, mistyped, too large; random bytes.

    They are made of the robot's own, as it sends them, which `heard` takes. Repeatable by a seed, given those.
    """

    def __init__(self, seed: int) -> None:
        self._draw, self._heard = random.Random(seed), dict[str, dict[str, Any]]()
        self._life: str | None = None  # of the robot: of the first message

    def heard(self, sample: zenoh.Sample) -> None:
        """Take one of the robot's own messages; those that were made here come by, too."""
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
        """So many, each with its key."""
        told = [keys.command, keys.grant, *(getattr(keys, name) for name in NAMES)]
        makers: list[Callable[[dict[str, Any]], bytes]] = [
            self._other_life,
            self._cut_off,
            self._mistyped,
            self._random,
        ]
        for _ in range(count):
            key = self._draw.choice(told)
            like = self._heard.get(key) or next(iter(list(self._heard.values())))
            yield key, self._draw.choice(makers)(like)

    def _other_life(self, like: dict[str, Any]) -> bytes:
        """Right in itself, and of one of a few other robots."""
        return json.dumps(like | {"life": f"other {self._draw.randrange(8)}"}).encode()

    def _cut_off(self, like: dict[str, Any]) -> bytes:
        whole = json.dumps(like).encode()
        return whole[: self._draw.randrange(len(whole))]

    def _mistyped(self, like: dict[str, Any]) -> bytes:
        """The version, or the life, is no text; another field besides is wrong as well, missing, or as it was."""
        broken = dict(like)
        broken[self._draw.choice(list(like))] = self._draw.choice(WRONG)
        if self._draw.random() < 0.3:
            broken.pop(self._draw.choice(list(like)))
        return json.dumps(broken | {self._draw.choice(["version", "life"]): self._draw.choice(WRONG[3:])}).encode()

    def _random(self, like: dict[str, Any]) -> bytes:
        return self._draw.randbytes(self._draw.randint(0, 2 * len(like)))


def attack_robot(count: int, seed: int = 3) -> dict[str, float]:
    """Drive a robot in another process while so many malformed messages come, and the same run in this one without.

    Of its periods, how many differ from those of the run in one process, to the bit.
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
    return {
        "sent": float(sent),
        "unreadable": float(unreadable),
        "periods": float(periods),
        "differing": float(differing),
    }


def _same(one: Tick, other: Tick) -> bool:
    """Whether two periods saw and decided the same."""
    pairs = [
        (one.observation.pose, other.observation.pose),
        (one.observation.q, other.observation.q),
        (one.arm[-1].actuation.twist, other.arm[-1].actuation.twist),
        (one.arm[-1].actuation.joint_velocity, other.arm[-1].actuation.joint_velocity),
    ]
    return one.time == other.time and all(np.array_equal(a, b) for a, b in pairs)
