"""A bad link in simulated time: messages are delayed, overtake each other or are lost; with outages.

Repeatable by its seed.
"""

import heapq
import itertools
from typing import Generic, TypeVar

import msgspec
import numpy as np

T = TypeVar("T")
EARLY = 1e-9  # [s] rounding of times


class LinkSpec(msgspec.Struct, frozen=True, kw_only=True):
    """Defects of a link, in each direction. Raises ValueError for an impossible one."""

    latency: float = 0.0  # [s]
    jitter: float = 0.0  # [s] a message takes latency +- jitter, uniform
    loss: float = 0.0  # share of messages that never arrive
    outage: float = 0.0  # [s] in which none arrives, in both directions: once in every...
    every: float = 2.0  # [s], at a random time
    seed: int = 0

    def __post_init__(self) -> None:
        if not (0.0 <= self.jitter <= self.latency <= 5.0 and 0.0 <= self.loss <= 1.0):
            raise ValueError(
                f"link of {self.latency} s latency, {self.jitter} s jitter, {self.loss} loss: "
                "need 0 <= jitter <= latency <= 5 s and a loss from 0 to 1"
            )
        if not (0.0 <= self.outage <= self.every <= 1000.0 and self.every > 0.0):
            raise ValueError(
                f"outages of {self.outage} s, one in every {self.every} s: "
                "need 0 <= outage <= every <= 1000 s, and every above 0"
            )


class Link(Generic[T]):
    """One direction of a link; times [s] come in as arguments and never fall."""

    def __init__(self, spec: LinkSpec, direction: int) -> None:
        """``direction``: tells the random numbers of two directions apart."""
        self.spec = spec
        self._rng = np.random.default_rng([spec.seed, 0x11E4, direction])
        self._number = itertools.count()
        self._under_way: list[tuple[float, int, T]] = []
        self._out_from, self._window_end = 0.0, 0.0  # [s] of the outage of now

    def send(self, item: T, now: float) -> None:
        """Give a message to the link."""
        spec = self.spec
        lost, place = self._rng.random(2)
        if lost >= spec.loss and not self._out(now):
            due = now + spec.latency + spec.jitter * (2.0 * float(place) - 1.0)
            heapq.heappush(self._under_way, (due, next(self._number), item))

    def _out(self, now: float) -> bool:
        """True when there is an outage now [s]; it is one of both directions."""
        spec = self.spec
        if not spec.outage:
            return False
        if now >= self._window_end:
            window = int(now // spec.every)
            share = float(np.random.default_rng([spec.seed, 0x0FF, window]).random())
            self._out_from = window * spec.every + share * (spec.every - spec.outage)
            self._window_end = (window + 1) * spec.every
        return self._out_from <= now < self._out_from + spec.outage

    def arrived(self, now: float) -> list[T]:
        """Messages that are there by now, in the order of arrival; each is given once."""
        items: list[T] = []
        while self._under_way and self._under_way[0][0] <= now + EARLY:
            items.append(heapq.heappop(self._under_way)[2])
        return items
