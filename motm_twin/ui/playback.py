"""Looking back: which of the last periods is shown, and playing them once more, while the twin runs on."""

import time
from typing import TYPE_CHECKING, Protocol

from motm_twin.model.period import PERIOD

if TYPE_CHECKING:
    from motm_twin.ui.history import Span


class Looking(Protocol):
    """Holds the period that is looked at; None is the newest."""

    at: int | None


class Playback:
    """Moves ``view.at`` through the history. Everybody sees the same picture."""

    def __init__(self, view: Looking) -> None:
        self._view = view
        self._speed, self._place, self._last = 0.0, 0.0, 0.0

    @property
    def playing(self) -> bool:
        """Whether the picture moves by itself."""
        return self._speed > 0.0 and self._view.at is not None

    def play(self, speed: float, span: "Span | None") -> None:
        """Go on from the shown period (from the oldest one when the newest is shown), ``speed`` times real time."""
        if span is None:
            return
        if self._view.at is None or self._view.at >= span.last:
            self._view.at = span.first
        self._speed, self._place, self._last = speed, float(self._view.at), time.monotonic()

    def pause(self) -> None:
        """Stay at the shown period."""
        self._speed = 0.0

    def live(self) -> None:
        """Back to the newest period."""
        self._speed = 0.0
        self._view.at = None

    def look(self, seconds: float, span: "Span | None") -> None:
        """Show the period that lies so far [s] before the newest; 0 is the newest."""
        self._speed = 0.0
        if span is None or seconds < PERIOD / 2:
            self._view.at = None
            return
        self._view.at = max(span.first, span.last - round(seconds / PERIOD))

    def step(self, periods: int, span: "Span | None") -> None:
        """Show a later or earlier period."""
        self._speed = 0.0
        if span is None:
            return
        at = span.last if self._view.at is None else self._view.at
        at = max(span.first, at + periods)
        self._view.at = None if at >= span.last and periods > 0 else min(at, span.last)

    def advance(self, span: "Span | None", now: float | None = None) -> None:
        """Let the picture move on; call it often. It ends where the newest period is."""
        now = time.monotonic() if now is None else now
        if not self.playing or span is None or self._view.at is None:
            self._speed = 0.0 if self._view.at is None else self._speed
            return
        self._place = max(self._place, float(span.first)) + self._speed * (now - self._last) / PERIOD
        self._last = now
        if self._place >= span.last:
            self.live()
        else:
            self._view.at = int(self._place)
