"""Every event once and in order: events lost on the way are fetched from the history."""

import threading
from collections import deque
from collections.abc import Callable, Iterator

import msgspec

from motm_twin.bus.client import TwinClient
from motm_twin.bus.messages import NumberedEvent

LIVE = 1000  # events kept for a slow reader; older ones are fetched from the history
LOOK = 2.0  # [s] without an event after which the history is checked for lost ones


class EventsLost(Exception):
    """Events are lost: the reader fell behind by more than the server's history. Reading can go on."""

    def __init__(self, first: int, last: int) -> None:
        self.first, self.last = first, last
        super().__init__(f"events {first} to {last} are no longer in the server's history: read events faster")


class EventReader:
    """One reader of the events of a twin; for one thread."""

    def __init__(self, client: TwinClient, since: int | None, changed: Callable[[], None] = lambda: None) -> None:
        """``since``: number of the first event wanted; None: only new ones. ``changed`` is told of every new one."""
        self._client, self._tell = client, changed
        self._live: deque[NumberedEvent] = deque(maxlen=LIVE)
        self._changed = threading.Condition()
        self._decode = msgspec.json.Decoder(NumberedEvent).decode
        client.follow(client.keys.event)  # first subscribe, then ask: nothing falls between
        self._leave = client.on_sample(client.keys.event, self._heard)
        history = client.events(0 if since is None else since)
        newest = 0 if history is None else history.newest
        self._epoch = None if history is None else history.numbered_since
        self._expected = newest + 1 if since is None else max(1, since)
        self._ready: deque[NumberedEvent] = deque(
            event for event in (history.events if history else ()) if event.seq >= self._expected
        )

    def take(self) -> list[NumberedEvent]:
        """All available events, oldest first. Queries the server for missing ones. Raises EventsLost."""
        taken: list[NumberedEvent] = []
        while True:
            while self._ready:
                taken.append(self._ready.popleft())
                self._expected = taken[-1].seq + 1
            with self._changed:
                event = self._live.popleft() if self._live else None
            if event is None:
                return taken
            if event.numbered_since != self._epoch:  # the server was started again
                self._epoch, self._expected = event.numbered_since, 1
            if event.seq == self._expected:
                self._ready.append(event)
            elif event.seq > self._expected and not self._fetch(taken):
                self._live.appendleft(event)  # no answer: later
                return taken

    def look(self) -> list[NumberedEvent]:
        """As `take`, but always queries the history: the newest event may have been lost."""
        taken = self.take()
        if not taken:
            self._fetch(taken)
        return taken or self.take()

    def wait(self, timeout: float) -> bool:
        """Wait for an event, for `timeout` [s], or until `wake`; True when there may be one."""
        with self._changed:
            return self._changed.wait_for(lambda: bool(self._live or self._ready) or self._client.closed, timeout)

    def wake(self) -> None:
        """End a `wait`."""
        with self._changed:
            self._changed.notify_all()
        self._tell()

    def __iter__(self) -> Iterator[NumberedEvent]:
        """Every event, until the twin is closed."""
        try:
            while not self._client.closed:
                yield from self.take() if self.wait(LOOK) else self.look()
        finally:
            self.close()

    def close(self) -> None:
        """Unsubscribe."""
        self._leave()

    def _heard(self, payload: bytes) -> None:
        """In Zenoh's thread."""
        event = self._decode(payload)
        with self._changed:
            self._live.append(event)
            self._changed.notify_all()
        self._tell()

    def _fetch(self, taken: list[NumberedEvent]) -> bool:
        """Put what is missing into `_ready`; False when the server does not answer."""
        if self._client.closed or (history := self._client.events(self._expected)) is None:
            return False
        if history.numbered_since != self._epoch:
            self._epoch, self._expected = history.numbered_since, 1
            return self._fetch(taken)
        self._ready.extend(history.events)
        if history.oldest > self._expected and history.newest >= self._expected:
            first, self._expected = self._expected, history.oldest
            self._ready.extendleft(reversed(taken))
            raise EventsLost(first, history.oldest - 1)
        return True
