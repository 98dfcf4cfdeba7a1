"""The Tune tab: every parameter that matters, with the paper's value marked, and comparisons with other values."""

import contextlib
import time
from collections.abc import Callable, Mapping
from functools import partial

import viser

from motm_twin.bus.commands import SetParameter
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.control.tuning import GROUPS, PARAMETERS, PRESETS, Parameter, check, parameter
from motm_twin.model.edits import ParameterValue
from motm_twin.ui import colours
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.panel.explain import method_title
from motm_twin.ui.panel.widgets import AMBER, RED, Block, card, follow, note, set_marks, table, text
from motm_twin.ui.what_if import RUNS, Outcome, State

INTERVAL = 0.2  # [s] between two messages; the last value wins
HOLD = 1.5  # [s] for which a slider that a person has moved is not set from outside
SHIPPED = "As shipped"  # of `PRESETS`
OWN = "(own)"
MOST_NAMED = 3  # parameters of a comparison that are named
WATCH = "Watch both runs"
APART = "Try in what-if only"
NOW, SHOWN, START = "from now", "from the shown moment", "from the start"
NAMES = [entry.name for entry in PARAMETERS]
_BACK = "back to how the method that drives was shipped"
_FORECAST = f"color:{AMBER};font-size:11px;line-height:1"
_COLOURS: dict[str, str] = dict(zip(RUNS, map(colours.css, colours.OTHERS), strict=True))  # as in the scene
Values = dict[str, ParameterValue]
DEFAULTS: Values = {entry.name: entry.default for entry in PARAMETERS}


class TuneTab(Block):
    """Sliders, switches and choices of one visitor."""

    def __init__(self, gui: viser.GuiApi, hub: Hub, visitor: Visitor) -> None:
        super().__init__(gui, hub, visitor)
        self._values = TuningValues()
        self._widgets: dict[str, viser.GuiInputHandle] = {}
        self._summary = gui.add_html("")
        self._preset = self.choice("Preset", (*PRESETS, OWN), self._use, hint="sets everything at once")
        self.row(("Reset everything",), lambda _: self._reset(NAMES), hint=_BACK)
        self.parts = [WhatIfBlock(gui, hub, visitor, self._values, self._show)]
        for number, group in enumerate(GROUPS):
            entries = [entry for entry in PARAMETERS if entry.group == group]
            if entries:
                self._group(group, entries, opened=number == 0)

    def _refresh(self, shown: Shown) -> None:
        method, status = "", shown.status
        if status is not None:
            method = method_title(status, status.method)
            self._ship(status)
            for command in self._values.due():
                self.send(command)
            self._show(self._values.follow(status.parameters))
        self._summary.content = summary(self._values, method, live=shown.live)
        follow(self._preset, next((name for name in PRESETS if self._values.preset(name) == self._values.chosen), OWN))

    def _group(self, group: str, entries: list[Parameter], *, opened: bool) -> None:
        with self.gui.add_folder(group, expand_by_default=opened):
            self.gui.add_html('<div class="motm-stacked"></div>')
            for entry in entries:
                self._widgets[entry.name] = self.driven(self._widget(entry), partial(self._move, entry))
            self.row(("Reset these",), lambda _: self._reset([entry.name for entry in entries]), hint=_BACK)

    def _widget(self, entry: Parameter) -> viser.GuiInputHandle:
        label, words = title(entry, False), hint(entry, entry.default)
        if entry.kind == "switch":
            return self.gui.add_checkbox(label, bool(entry.default), hint=words)
        if entry.kind == "choice":
            return self.gui.add_dropdown(label, entry.choices, initial_value=str(entry.default), hint=words)
        bounds = (entry.low, entry.high, entry.step, float(entry.default))
        return self.gui.add_slider(label, *bounds, hint=words, marks=marks(entry, entry.default))

    def _move(self, entry: Parameter, value: object) -> None:
        if isinstance(value, bool | str | int | float):
            self._values.move(entry.name, float(value) if entry.kind == "number" else value)
            self._relabel(entry.name)

    def _ship(self, status: StatusMessage) -> None:
        """Take the shipped values of the driving method; update hints, marks and labels to them."""
        names = self._values.ship(shipped_with(status))
        for name in names:
            entry, shipped = parameter(name), self._values.shipped[name]
            self._widgets[name].hint = hint(entry, shipped)
            if entry.kind == "number":
                set_marks(self._widgets[name], marks(entry, shipped))
        self._show(names)

    def _reset(self, names: list[str], values: "Values | None" = None) -> None:
        self._values.reset(names, values)
        self._show(names)

    def _use(self, preset: str) -> None:
        if preset in PRESETS:
            self._reset(NAMES, self._values.preset(preset))

    def _show(self, names: list[str]) -> None:
        for name in names:
            self._widgets[name].value = self._values.chosen[name]
            self._relabel(name)

    def _relabel(self, name: str) -> None:
        values = self._values
        self._widgets[name].label = title(parameter(name), values.chosen[name] != values.shipped[name])


def summary(values: "TuningValues", method: str = "", *, live: bool = True) -> str:
    """Number of parameters that are changed, and the runs they act on, as HTML.

    ``method``: title of the driving method; ``live``: the newest period is shown.
    """
    count = len(values.changed())
    of = f" with {text(method)}" if method else ""
    state = f"<b>{count}</b> of {len(PARAMETERS)} changed" if count else f"All as shipped{of}"
    where = "acts at once" if live else "looking back: acts on the running twin, not on what is shown"
    where = "for the comparison only" if values.apart else where
    return card(state, f' <span class="mu">&middot; {where}</span>', style="line-height:1.4;padding:2px 12px 6px 12px")


class TuningValues:
    """Parameter values between the widgets of one visitor and the twin; ``now`` is a monotonic clock."""

    def __init__(self, now: Callable[[], float] = time.monotonic) -> None:
        self._now = now
        self.shipped: Values = dict(DEFAULTS)  # with the driving method
        self.chosen: Values = dict(DEFAULTS)  # as the widgets show them
        self.running: Values = {}  # the twin's values that differ from the defaults
        self.apart = False  # the widgets are for a comparison only
        self._pending: dict[str, ParameterValue | None] = {}
        self._touched: dict[str, float] = {}
        self._sent = -1e9

    def ship(self, shipped: Values) -> list[str]:
        """Take the shipped values of the driving method; returns names whose shipped value has changed."""
        changed = [name for name, value in shipped.items() if value != self.shipped[name]]
        self.shipped = shipped
        return changed

    def move(self, name: str, value: ParameterValue) -> None:
        """Take a value that a person has set with a widget."""
        self.chosen[name] = value
        self._touched[name] = self._now()
        if not self.apart:
            self._pending[name] = value

    def reset(self, names: list[str], values: Values | None = None) -> None:
        """Set these parameters to their shipped values, or to those given in ``values``."""
        for name in names:
            value = (self.shipped if values is None else values)[name]
            if not value == self.chosen[name] == self._run(name):
                self.move(name, value)

    def preset(self, name: str) -> Values:
        """Values of one of `PRESETS`; parameters that it does not set have the defaults, whichever method drives."""
        return self.shipped if name == SHIPPED else {**DEFAULTS, **PRESETS[name]}

    def due(self) -> list[SetParameter]:
        """The commands to send now: at most every `INTERVAL`, each parameter once."""
        if not self._pending or self._now() - self._sent < INTERVAL:
            return []
        self._sent = self._now()
        pending, self._pending = self._pending, {}
        return [SetParameter(name=name, value=value) for name, value in pending.items()]

    def follow(self, running: Mapping[str, ParameterValue]) -> list[str]:
        """Take the twin's values; returns names whose widgets must follow, because somebody else moved them."""
        self.running = dict(running)
        if self.apart:
            return []
        now = self._now()
        free = [name for name in NAMES if name not in self._pending and now - self._touched.get(name, -1e9) > HOLD]
        changed = [name for name in free if self._run(name) != self.chosen[name]]
        self.chosen |= {name: self._run(name) for name in changed}
        return changed

    def part(self, apart: bool) -> None:
        """Use the widgets for a comparison only, or for the twin again; `follow` then takes the twin's values."""
        self.apart = apart
        self._pending.clear()
        self._touched.clear()

    def changed(self) -> Values:
        """Values of the widgets that differ from the shipped ones."""
        return {name: value for name, value in self.chosen.items() if value != self.shipped[name]}

    def compared(self) -> Values:
        """All values of a comparison: those that differ from the shipped ones here or in the running twin."""
        return {
            name: value for name, value in self.chosen.items() if not value == self.shipped[name] == self._run(name)
        }

    def differs(self) -> bool:
        """True when the widgets differ from the twin."""
        return any(value != self._run(name) for name, value in self.chosen.items())

    def _run(self, name: str) -> ParameterValue:
        """The value that the twin has."""
        return self.running.get(name, DEFAULTS[name])


def shipped_with(status: StatusMessage) -> Values:
    """Shipped values of the driving method, without those that are unknown to this page or out of bounds."""
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
    """Meaning, source and values of a parameter."""
    paper = "" if entry.paper is None else f"Paper: {_shown(entry.paper)}. "
    return f"{entry.help} {paper}As shipped with the method that drives: {_shown(shipped)}. Source: {entry.source}."


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


class WhatIfBlock(Block):
    """The widgets of a comparison. ``show`` puts the values of parameters on their widgets."""

    def __init__(
        self, gui: viser.GuiApi, hub: Hub, visitor: Visitor, values: TuningValues, show: Callable[[list[str]], None]
    ) -> None:
        super().__init__(gui, hub, visitor)
        self._values, self._show = values, show
        with gui.add_folder("What if…"):
            hint = "sliders then leave the running twin as it is"
            self.driven(gui.add_checkbox(APART, False, hint=hint), self._part)
            self._from = self.choice("Changed", (START, NOW, SHOWN), initial_value=START)
            self._go = self.button("Compare", self._press, icon=viser.Icon.ARROWS_SPLIT)
            self._result = gui.add_html("")
            hint = "in the scene, from where they part"
            self._watch = self.row((WATCH,), lambda _: hub.what_if.watch(), hint=hint)
            self._watch.visible = False

    def _refresh(self, shown: Shown) -> None:
        state, watched = self.hub.what_if.state, self.hub.what_if.watched
        self._go.label = "Stop" if state.busy else "Compare" if state.phase == "idle" else "Clear the comparison"
        self._result.content = result(state, begun_since(state, shown.newest))
        self._watch.visible = state.phase in ("running", "done")
        self._watch.options = (WATCH if watched is None else f"Both runs at {watched:.0f} s",)

    def _part(self, apart: bool) -> None:
        self._values.part(apart)
        if not apart and self.shown is not None and self.shown.status is not None:
            self._show(self._values.follow(self.shown.status.parameters))

    def _press(self) -> None:
        what_if, shown, values = self.hub.what_if, self.shown, self._values
        if what_if.state.phase != "idle":
            what_if.stop()
            return
        if shown is None or shown.newest is None or shown.tick is None:
            return
        compared, words = values.compared(), ""
        if not compared:
            words = f"nothing is changed, both runs would be the same: move one of the {len(NAMES)} parameters first"
        elif self._from.value == NOW and not values.differs():
            words = (
                "the running twin has these values already, so from now on both runs would be the same: "
                f"compare {START}, or tick {APART}, and then move one"
            )
        if words:
            self.tell(words, "Nothing to compare")
            return
        start = {START: 0, NOW: shown.newest.index + 1, SHOWN: shown.tick.index}[self._from.value]
        what_if.start(compared, start, shown.newest.run)


def result(state: State, earlier: str = "") -> str:
    """State of a comparison, as HTML; ``earlier``: "branch" or "reset" when one has begun another run since."""
    if state.phase == "idle":
        return note("Both runs are computed beside the twin, with the same disturbances, and shown in the scene.")
    if state.phase == "failed":
        return note(text(state.text), RED)
    dots = (f'<span style="color:{colour}">●</span> {run}' for run, colour in _COLOURS.items())
    rows: list[tuple[str, ...]] = [("", *dots)]
    before, after = (state.outcomes.get(run) for run in RUNS)
    rows.append(("time", *(_time(state, run) for run in RUNS)))
    if before is not None and after is not None:
        rows.append(("picked", f"{before.picks}", f"{after.picks}"))
        rows.append(("placed", f"{before.places}", f"{after.places}"))
        rows.append(("contacts caused", *(f"{one.contacts} of {one.all_contacts}" for one in (before, after))))
        rows.append(("driven", f"{before.path_length:.1f} m", f"{after.path_length:.1f} m"))
        begins = (one.forecast_from_s for one in (before, after))  # in a forecast no clock cuts searches
        rows.append(("forecast", *("no" if begin is None else f"from {begin:.1f} s" for begin in begins)))
    names = [f"{parameter(name).title}: {_shown(value)}" for name, value in state.values.items()]
    what = ", ".join(names[:MOST_NAMED]) + (f", and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else "")
    changes = f'<div class="mu">changed: {text(what)}</div>' if what else ""
    of_before = f'<div style="color:{AMBER}">of the run before the {earlier}</div>' if earlier else ""
    return card(of_before, table(rows), changes, _verdict(state, before, after), style="padding:0 12px 6px")


def _time(state: State, run: str) -> str:
    outcome = state.outcomes.get(run)
    if outcome is not None:
        forecast = "" if outcome.forecast_from_s is None else f'<div style="{_FORECAST}">forecast</div>'
        return f'<b style="font-size:16px">{outcome.time_s:.1f} s</b>{forecast}'
    return f"at {state.reached[run]:.0f} s …" if run in state.reached else "…"


def _verdict(state: State, before: Outcome | None, after: Outcome | None) -> str:
    if before is None or after is None:
        words = f"the same until {state.start:.1f} s" if state.start > 0.0 else "computed from the start"
        return f'<div class="mu">{words}</div>'
    words = []
    if before.success and after.success:
        gain = round(after.time_s, 1) - round(before.time_s, 1)  # from the rounded times shown above
        guess = "" if before.forecast_from_s is after.forecast_from_s is None else " (forecast)"
        word = "as fast" if abs(gain) < 0.05 else f"{abs(gain):.1f} s {'slower' if gain > 0 else 'faster'}"
        words.append(f"changed: {word}{guess}")
    for run, outcome in zip(RUNS, (before, after), strict=True):
        if not outcome.success:
            words.append(f"{run}: {text(outcome.reason)}")
    if after.skipped:
        words.append(f"{len(after.skipped)} disturbances did not fit the changed run")
    return f'<div style="margin-top:3px"><b>{"; ".join(words)}</b></div>'


def begun_since(state: State, newest: TickMessage | None) -> str:
    """Cause of a new run since the comparison: "branch", "reset", or "" for none."""
    if newest is None or state.run < 0 or newest.run == state.run:
        return ""
    return "branch" if newest.past >= 0 else "reset"
