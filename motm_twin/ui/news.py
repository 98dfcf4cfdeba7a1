"""Events that no period shows, as notes on every page: what a robot has refused, a recording that has stopped."""

from collections.abc import Callable

import msgspec

from motm_twin.bus.client import TwinClient
from motm_twin.bus.messages import NumberedEvent

TITLES = {"refused": "Not done", "recording": "Recording"}  # kinds that are told


class News:
    """Listens to the events of one twin until `stop`. ``tell`` gets a text and its title."""

    def __init__(self, client: TwinClient, tell: Callable[[str, str], None]) -> None:
        self._tell = tell
        self._decode = msgspec.json.Decoder(NumberedEvent).decode
        self._leave = client.on_sample(client.keys.event, self._take)
        client.follow(client.keys.event)

    def stop(self) -> None:
        """Listen no more."""
        self._leave()

    def _take(self, payload: bytes) -> None:
        """In Zenoh's thread: a note is only queued for the page."""
        try:
            event = self._decode(payload)
        except msgspec.MsgspecError:
            return  # of another version: the ticks say so
        if event.kind in TITLES:
            self._tell(event.text, TITLES[event.kind])
