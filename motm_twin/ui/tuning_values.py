"""The values on one visitor's sliders, what the twin has, and what is still to be sent."""

import contextlib
import time
from collections.abc import Callable, Mapping

from motm_twin.bus.commands import SetParameter
from motm_twin.bus.messages import StatusMessage
from motm_twin.control.tuning import PARAMETERS, PRESETS, Parameter, check
from motm_twin.model.edits import ParameterValue

INTERVAL = 0.2  # [s] between two sendings; the last value wins
SHIPPED = "As shipped"  # of `PRESETS`
HOLD = 1.5  # [s] after a person has moved a slider, it is not set from outside

Values = dict[str, ParameterValue]
DEFAULTS: Values = {entry.name: entry.default for entry in PARAMETERS}


class TuningValues:
    """Between the widgets of one visitor and the twin; ``now`` is a monotonic clock."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self.shipped: Values = dict(DEFAULTS)  # with the method that drives
        self.wanted: Values = dict(DEFAULTS)  # as the widgets show them
        self.running: Values = {}  # as the twin has them, where they are not the defaults
        self.apart = False  # the widgets are for a comparison only
        self._pending: dict[str, ParameterValue | None] = {}
        self._touched: dict[str, float] = {}
        self._sent = -1e9

    def ship(self, shipped: Values) -> list[str]:
        """Take what the method that drives was shipped with; the names of which that has become another."""
        changed = [name for name, value in shipped.items() if value != self.shipped[name]]
        self.shipped = shipped
        return changed

    def move(self, name: str, value: ParameterValue) -> None:
        """A person has moved a widget."""
        self.wanted[name] = value
        self._touched[name] = self._now()
        if not self.apart:
            self._pending[name] = value

    def reset(self, names: list[str], values: Values | None = None) -> None:
        """Set these back to how they were shipped, or to the values that are given, one for each."""
        for name in names:
            value = (self.shipped if values is None else values)[name]
            if not value == self.wanted[name] == self._run(name):
                self.move(name, value)

    def preset(self, name: str) -> Values:
        """All that one of `PRESETS` sets: what the paper did has the defaults besides, whatever drives."""
        return self.shipped if name == SHIPPED else {**DEFAULTS, **PRESETS[name]}

    def due(self) -> list[SetParameter]:
        """What is to be sent now: at most every `INTERVAL`, each parameter once."""
        if not self._pending or self._now() - self._sent < INTERVAL:
            return []
        self._sent = self._now()
        pending, self._pending = self._pending, {}
        return [SetParameter(name=name, value=value) for name, value in pending.items()]

    def follow(self, running: Mapping[str, ParameterValue]) -> list[str]:
        """Take what the twin has; the names whose widgets must change, because somebody else moved them."""
        self.running = dict(running)
        if self.apart:
            return []
        changed = []
        for entry in PARAMETERS:
            value = self._run(entry.name)
            if value != self.wanted[entry.name] and self._free(entry.name):
                self.wanted[entry.name] = value
                changed.append(entry.name)
        return changed

    def part(self, apart: bool) -> None:
        """Let the widgets be for a comparison only, or the twin's again: then they go back to what it has."""
        self.apart = apart
        self._pending.clear()
        self._touched.clear()

    def changed(self) -> Values:
        """The widgets that are not as shipped."""
        return {name: value for name, value in self.wanted.items() if value != self.shipped[name]}

    def compared(self) -> Values:
        """The whole of what a comparison sets: what is not as shipped here, or in the running twin."""
        return {
            name: value
            for name, value in self.wanted.items()
            if self.shipped[name] != value or self.shipped[name] != self._run(name)
        }

    def differs(self) -> bool:
        """Whether the widgets say something else than the twin has."""
        return any(value != self._run(name) for name, value in self.wanted.items())

    def _run(self, name: str) -> ParameterValue:
        """What the twin has."""
        return self.running.get(name, DEFAULTS[name])

    def _free(self, name: str) -> bool:
        return name not in self._pending and self._now() - self._touched.get(name, -1e9) > HOLD


def shipped_with(status: StatusMessage) -> Values:
    """What the method that drives was shipped with; what this page has no name or room for is left out."""
    own = next((choice.parameters for choice in status.methods if choice.name == status.method), {})
    values = dict(DEFAULTS)
    for name, value in own.items():
        with contextlib.suppress(ValueError):
            values[name] = check(name, value)
    return values


def title(entry: Parameter, changed: bool) -> str:
    """The label of a parameter, with a dot when it is changed."""
    symbol = f"  {entry.symbol}" if entry.symbol else ""
    unit = f" [{entry.unit}]" if entry.unit else ""
    return f"{'● ' if changed else ''}{entry.title}{symbol}{unit}"


def hint(entry: Parameter, shipped: ParameterValue) -> str:
    """What a parameter means, where it comes from, and the values it had."""
    words = [entry.help]
    if entry.paper is not None:
        words.append(f"Paper: {_shown(entry.paper)}.")
    words.append(f"As shipped with the method that drives: {_shown(shipped)}. Source: {entry.source}.")
    return " ".join(words)


def marks(entry: Parameter, shipped: ParameterValue) -> tuple[tuple[float, str], ...]:
    """Marks of a slider: the paper's value, and the shipped one when it is another."""
    low, high = entry.low, entry.high
    found = []
    if isinstance(entry.paper, float) and low <= entry.paper <= high:
        found.append((entry.paper, f"paper {entry.paper:g}"))
    if isinstance(shipped, float) and all(shipped != value for value, _ in found):
        near = any(abs(shipped - value) < 0.3 * (high - low) for value, _ in found)
        found.append((shipped, "" if near else f"shipped {shipped:g}"))
    return tuple(sorted(found))


def _shown(value: ParameterValue) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:g}"
