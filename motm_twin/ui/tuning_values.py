"""The values on one visitor's sliders, what the twin has, and what is still to be sent."""

import time
from collections.abc import Callable, Mapping

from motm_twin.bus.commands import SetParameter
from motm_twin.control.tuning import PARAMETERS, Parameter, parameter
from motm_twin.model.edits import ParameterValue

INTERVAL = 0.2  # [s] between two sendings; the last value wins
HOLD = 1.5  # [s] after a person has moved a slider, it is not set from outside

Values = dict[str, ParameterValue]


class TuningValues:
    """Between the widgets of one visitor and the twin; ``now`` is a monotonic clock."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self.wanted: Values = {entry.name: entry.default for entry in PARAMETERS}  # as the widgets show them
        self.running: Values = {}  # as the twin has them, changed ones only
        self.apart = False  # the widgets are for a comparison only
        self._pending: dict[str, ParameterValue | None] = {}
        self._touched: dict[str, float] = {}
        self._sent = -1e9

    def move(self, name: str, value: ParameterValue) -> None:
        """A person has moved a widget."""
        self.wanted[name] = value
        self._touched[name] = self._now()
        if not self.apart:
            self._pending[name] = value

    def reset(self, names: list[str], values: Mapping[str, ParameterValue] | None = None) -> None:
        """Set these back to how they were shipped, or to the values that are given."""
        for name in names:
            value = (values or {}).get(name, parameter(name).default)
            if self.wanted[name] != value or name in self.running:
                self.move(name, value)

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
            value = running.get(entry.name, entry.default)
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
        return {e.name: self.wanted[e.name] for e in PARAMETERS if self.wanted[e.name] != e.default}

    def compared(self) -> Values:
        """The whole of what a comparison sets: what is not as shipped here, or in the running twin."""
        values = self.changed()
        for name in self.running:
            values.setdefault(name, self.wanted.get(name, self.running[name]))
        return values

    def differs(self) -> bool:
        """Whether the widgets say something else than the twin has."""
        return any(self.wanted[e.name] != self.running.get(e.name, e.default) for e in PARAMETERS)

    def _free(self, name: str) -> bool:
        return name not in self._pending and self._now() - self._touched.get(name, -1e9) > HOLD


def title(entry: Parameter, changed: bool) -> str:
    """The label of a parameter, with a dot when it is changed."""
    symbol = f"  {entry.symbol}" if entry.symbol else ""
    unit = f" [{entry.unit}]" if entry.unit else ""
    return f"{'● ' if changed else ''}{entry.title}{symbol}{unit}"


def hint(entry: Parameter) -> str:
    """What a parameter means, where it comes from, and the values it had."""
    words = [entry.help]
    if entry.paper is not None:
        words.append(f"Paper: {_shown(entry.paper)}.")
    words.append(f"As shipped: {_shown(entry.default)}. Source: {entry.source}.")
    return " ".join(words)


def marks(entry: Parameter) -> tuple[tuple[float, str], ...]:
    """Marks of a slider: the paper's value, and the shipped one when it is another."""
    low, high = entry.low, entry.high
    found = []
    if isinstance(entry.paper, float) and low <= entry.paper <= high:
        found.append((entry.paper, f"paper {entry.paper:g}"))
    if isinstance(entry.default, float) and all(entry.default != value for value, _ in found):
        near = any(abs(entry.default - value) < 0.3 * (high - low) for value, _ in found)
        found.append((entry.default, "" if near else f"shipped {entry.default:g}"))
    return tuple(sorted(found))


def _shown(value: ParameterValue) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:g}"
