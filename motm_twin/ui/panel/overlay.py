"""Data for the script that lays a timeline, the legend, names and a cover over the scene.

The script (web_assets/page/overlay.js) finds what it shows in widgets that nobody sees, as JSON behind a mark, and asks
for things through one of them, as a JSON list: a number that rises, a name of `Overlay`'s table, and arguments.
"""

import json
from collections.abc import Callable
from typing import Any

import msgspec

from motm_twin.bus.commands import RemoveTask, Reset, Speed, Step
from motm_twin.bus.messages import TickMessage
from motm_twin.ui.hub import Hub, Shown, Visitor
from motm_twin.ui.legend import LAYERS, names_of
from motm_twin.ui.panel.disturb import is_free
from motm_twin.ui.panel.disturb_tab import DisturbTab
from motm_twin.ui.panel.drive_tab import SPEEDS, DriveTab
from motm_twin.ui.panel.replay_tab import ReplayTab
from motm_twin.ui.panel.why_tab import NEXT_WEIGHT, says
from motm_twin.ui.panel.widgets import Block
from motm_twin.ui.scene.scene_view import SceneView

ASK = "motm-ask"  # label of the widget that the script writes to
MARK = "<!--motm:{}-->"
EVENTS = 200  # on the timeline


class Overlay(Block):
    """One visitor's."""

    def __init__(
        self, visitor: Visitor, hub: Hub, scene: SceneView, drive: DriveTab, disturb: DisturbTab, replay: ReplayTab
    ) -> None:
        gui = visitor.client.gui
        super().__init__(gui, hub, visitor)
        self._replay, self._cameras = replay, scene.cameras
        self._legend, self._now, self._events, self._names = (gui.add_html("", visible=False) for _ in range(4))
        self._legend.content = _packed("legend", LAYERS)
        self._scene: object = None
        self._count = -1
        playback = hub.playback
        self._acts: dict[str, tuple[bool, Callable[..., object]]] = {  # for the driver only, and what is done
            "toggle": (True, lambda: replay.toggle() or drive.press()),
            "reset": (True, lambda: self.send(Reset())),
            "step": (True, self._step),
            "speed": (True, lambda name: self.send(Speed(factor=SPEEDS[name]))),
            "look": (True, lambda seconds: playback.look(float(seconds), hub.span)),
            "live": (True, playback.live),
            "branch": (True, replay.branch),
            "undo": (True, replay.undo),
            "save": (False, replay.save),
            "page": (False, replay.export),
            "picture": (False, replay.screenshot),
            "go": (True, lambda: scene.clicks.drive(visitor)),
            "stay": (True, self._stay),
            "temi": (True, lambda: disturb.add("temi")),
            "ahead": (True, self._ahead),
            "hide": (False, self._hide),
            "camera": (False, lambda name: scene.cameras.choose(visitor.client, name)),
            "turned": (False, lambda: scene.cameras.turned(visitor.client)),
            "width": (False, lambda pixels: scene.cameras.tell_width(visitor.client, pixels)),
            "drawn": (False, self._drawn),
        }
        asked = gui.add_text(ASK, "", visible=False)
        asked.on_update(self._asked)

    def _refresh(self, shown: Shown) -> None:
        hub, status, span = self.hub, shown.status, self.hub.span
        if shown.scene is not None and shown.scene is not self._scene:
            self._scene = shown.scene
            self._names.content = _packed("names", names_of(shown.scene))
        if self._count != hub.events.count:
            self._count, found = hub.events.count, hub.events.last(EVENTS)
            self._events.content = _packed("events", [(round(e.time, 2), e.kind, e.text) for e in found])
        now = {
            "state": shown.state,
            "text": "" if status is None else status.text,
            "t": None if shown.tick is None else round(shown.tick.time, 2),
            "span": None if span is None else [round(span.first_time, 2), round(span.last_time, 2)],
            "live": shown.live,
            "playing": shown.state == "playing" if shown.live else hub.playback.playing,
            "speed": next((name for name, factor in SPEEDS.items() if status and factor == status.speed), "1x"),
            "says": "" if shown.tick is None else says(shown.tick, shown.scene),
            "mine": hub.drives(self.visitor),
            "picked": shown.view.picked,
            "camera": self._cameras.mode(self.visitor.client),
            "going": shown.view.going if shown.live else None,
            "free": shown.view.going is None or is_free(shown.grid, shown.view.going),
            "sent_to": sent_to(shown.newest, shown.view.sent_to),
            "aside": None if status is None else status.aside,
        }
        self._now.content = _packed("now", now)

    async def _asked(self, event: Any) -> None:
        try:
            _, name, *more = json.loads(event.target.value)
            drives, act = self._acts[name]
        except (ValueError, KeyError, TypeError):
            return  # not from our script
        guard = self.hub.driving if drives else self.hub.watching
        await guard(lambda *_: act(*more))(event)

    def _step(self, periods: int) -> None:
        """One period back, or on: of the past, or of a twin that waits for it."""
        if periods > 0 and self.hub.view.at is None:
            self.send(Step())
        else:
            self._replay.step(int(periods))

    def _stay(self) -> None:
        """Do not drive to the proposed place; without one, undo the drive that was confirmed last."""
        view, newest = self.hub.view, None if self.shown is None else self.shown.newest
        index = drive_index(newest, view.sent_to)
        if view.going is not None:
            view.going = None
        elif index is not None and self.hub.live(self.visitor):
            self.send(RemoveTask(index=index))

    def _ahead(self) -> None:
        """Compare the run with one that does not count what comes after the next target."""
        if self.shown is not None and self.shown.newest is not None:
            self.hub.what_if.start({NEXT_WEIGHT: 0.0}, 0, self.shown.newest.run)

    def _drawn(self) -> None:
        self.visitor.drawn = True

    def _hide(self, keys: list[str]) -> None:
        self.visitor.hidden = frozenset(map(str, keys))


def sent_to(tick: TickMessage | None, target: str) -> str:
    """A sentence about the drive to this target that can be undone; "" when it has ended."""
    index = drive_index(tick, target)
    if tick is None or index is None:
        return ""
    return f"Drive to {target} {'has begun' if index == tick.task_index else 'comes next'}"


def drive_index(tick: TickMessage | None, target: str) -> int | None:
    """Number of the drive to this target that has not ended; None when there is none."""
    for index, task in enumerate([] if tick is None else tick.tasks):
        if task.kind == "drive_to" and task.target == target and task.status in ("waiting", "active"):
            return index
    return None


def _packed(mark: str, content: object) -> str:
    return MARK.format(mark) + msgspec.json.encode(content).decode()
