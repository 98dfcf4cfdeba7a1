"""Shared by all parts of the page: its visitors, the view, and the way from a widget to the twin.

One 3D scene is drawn for everybody, as the driver has arranged it; each visitor has a panel and a camera. Any number
of visitors may watch; only the driver, who holds the twin's lease, can change anything; every callback is checked here.
"""

import asyncio
import math
import queue
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import msgspec
import viser

from motm_twin.bus import commands as to
from motm_twin.bus.client import Grid, TwinClient
from motm_twin.bus.commands import NAME_MAX, Answer, Command
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import Scene
from motm_twin.ui import colours
from motm_twin.ui.history import EventMarks, History, Playback, Span
from motm_twin.ui.what_if import OwnMethod, WhatIf

PLACES, LIDAR, STAA = "places", "lidar", "staa"


class Layer(msgspec.Struct, frozen=True):
    """A layer of the scene, which a chip of the legend shows or hides."""

    key: str
    title: str
    hint: str  # one sentence
    swatch: str  # CSS background
    shape: str  # of the swatch: area | dots | line | dashed | frame
    nodes: tuple[str, ...]  # paths of nodes, or of their parents
    on: bool = True  # initially


LAYERS = (
    Layer("grid", "Ground", "brown: what the robot takes for occupied; lighter brown: the margin around it",
          colours.ground_css(), "area", ("/map",)),
    Layer(PLACES, "Where the base could stand", "each dot is a place for the current target, its nose the heading: "
          "yellow costs little time, violet much, grey is impossible; click one to read its costs",
          colours.viridis_css(), "dots", ("/plan/candidates",)),
    Layer("there", "Way there", "way of the base to the chosen place; dashed: to the place that you clicked",
          colours.css(colours.WAY_THERE), "line", ("/plan/global_path", "/plan/inspected")),
    Layer("on", "Way on", "way from there to the next target, whose time the choice of the place counts as well; "
          "dashed: from the place that you clicked", colours.css(colours.WAY_ON), "line",
          ("/plan/next_path", "/plan/inspected_next")),
    Layer("plan", "Plan", "motion of the next seconds: silhouettes of the base, and the whole robot at its next grasp "
          "or release; light blue: the curve on which the search judges how to arrive", colours.css(colours.PLAN),
          "line", ("/plan/local_plan", "/plan/bezier", "/robot/silhouette", "/robot/arrival")),
    Layer("target", "Target", "the chosen place of the base, and where the robot believes its target to be",
          colours.css(colours.TARGET), "frame", ("/plan/goal", "/marks")),
    Layer("people", "People and Temis", "followed by the robot: number, arrow to where each will be in 1 s, ellipses "
          "of where it may be in 1 s and 2 s, and its trail; bold ring: the robot waits for it, or passes it",
          colours.css(colours.PEOPLE), "line", ("/bodies/trails", "/tracks")),
    Layer(LIDAR, "Lidar", "points that the beams of the newest sweep have hit", colours.css(colours.LIDAR), "dots",
          ("/lidar",), on=False),
    Layer(STAA, "STAA* path", "path of the unmodified STAA*, for comparison", colours.css(colours.STAA_PATH),
          "dashed", ("/plan/staa_path",), on=False),
)  # fmt: skip
OFF_AT_FIRST = frozenset(layer.key for layer in LAYERS if not layer.on)


def names_of(scene: Scene) -> dict[str, Any]:
    """Title of the scene; names, places and rim heights [m] of its bins; opening angle [deg] of the wrist camera."""
    bins = [(box.name, *box.centre, box.rim_z) for box in scene.bins]
    wrist = 2.0 * math.degrees(scene.robot.camera.half_cone) if scene.robot.has_arm else 0.0
    return {"scene": scene.title or scene.name, "bins": bins, "wrist": wrist}


LOOKING_BACK = "looking back: return to live or branch from here"
NOTE_TIME = 6.0  # [s] a note stays on the page
BLIND = 20.0  # [s] time that a page may take to show the scene
NOTES = 2  # at a time: they lie over the scene
WAITING = 100  # commands that may wait to be sent
ASKED = (to.Load, to.Pause, to.Play, to.Reset, to.Seed, to.Speed)  # clicks: a note tells their sender to wait
PATIENT = (*ASKED, to.HandOver, to.Inspect, to.TakeWheel)  # valid for any scene: they wait for the end of a load
LOOK = 0.1  # [s] between checks of the server's state
PROMPT, PATIENCE = 5.0, 20.0  # [s] for the twin to answer, for immediate commands and for the `PATIENT`
KEEP_WHEEL = 3.0  # [s] between renewals of the lease by actions on the page alone
Act = Callable[[Any, "Visitor"], object]


@dataclass(eq=False)
class Visitor:
    """A browser page. ``sender`` is its identity on the bus; ``name`` is shown to others, escaped."""

    client: viser.ClientHandle
    sender: str
    name: str
    gone: bool = False  # has left; sends nothing any more
    sent: float = -1e9  # [s] monotonic, of the last command
    drawn: bool = False  # its page shows the scene
    since: float = field(default_factory=time.monotonic)  # [s] monotonic
    hidden: frozenset[str] = OFF_AT_FIRST  # layers that this page does not show
    notes: list[tuple[viser.NotificationHandle, str]] = field(default_factory=list)  # may still be on the page
    _noting: threading.Lock = field(default_factory=threading.Lock)

    @property
    def looks(self) -> bool:
        """True when the page shows the scene: it has said so, or it has been open for more than `BLIND` [s]."""
        return self.drawn or time.monotonic() - self.since > BLIND

    def show(self, note: viser.NotificationHandle, text: str) -> None:
        """Add a note; an equal one and the oldest are removed, so that notes never pile up."""
        with self._noting:
            same = [entry for entry in self.notes if entry[1] == text]
            kept = [entry for entry in self.notes if entry[1] != text]
            too_many = max(0, len(kept) + 1 - NOTES)
            self.notes = [*kept[too_many:], (note, text)]
        for old, _ in same + kept[:too_many]:
            old.remove()

    def rename(self, text: str) -> None:
        """Take a name that a person has typed, cleaned for display; an empty one changes nothing."""
        self.name = clean_name(text) or self.name


@dataclass
class View:
    """The driver's choice of what is shown, for everybody."""

    picked: int | None = None  # candidate whose costs and paths are shown
    selected: str = ""  # body, cube or piece of furniture selected for the next action
    sending: str = ""  # agent that is sent to the next click on the floor
    placing: str = ""  # body just added: moved to the next click on the floor
    going: tuple[float, float] | None = None  # place [m] that a click on the floor proposes to drive to
    sent_to: str = ""  # target of the drive that was confirmed last
    at: int | None = None  # period that is shown; None: the newest

    def aim_at_nothing(self) -> None:
        """Cancel what the next click on the floor would do."""
        self.sending, self.placing, self.going = "", "", None


@dataclass(frozen=True, kw_only=True)
class Shown:
    """Content of one update of the page."""

    state: str  # of the server, or "waiting" (not seen yet) or "lost" (silent)
    status: StatusMessage | None
    scene: Scene | None
    tick: TickMessage | None  # the newest, or one of the history
    newest: TickMessage | None
    live: bool
    view: View
    grid: Grid | None = None  # in force in the shown period

    @property
    def behind(self) -> float:
        """Time [s] from the shown period to the newest one."""
        return 0.0 if self.tick is None or self.newest is None else max(0.0, self.newest.time - self.tick.time)


class Hub:
    """Connects the widgets of all visitors to the twin."""

    def __init__(self, client: TwinClient, own_method: OwnMethod | None = None) -> None:
        """``own_method``: a method that is not shipped, for comparisons."""
        self.client, self.view = client, View()
        self.history: History | None = None  # set by the viewer
        self.what_if = WhatIf(client.session, own_method=own_method)
        self.playback, self.events = Playback(self.view), EventMarks()
        self._asking: dict[str, Visitor] = {}
        self._speaking = threading.Lock()
        self._visitors: dict[int, Visitor] = {}
        self._queue: queue.Queue[tuple[Visitor | None, Command]] = queue.Queue(maxsize=WAITING)
        self._stop = threading.Event()
        self._sender = threading.Thread(target=self._send_queued, name="commands", daemon=True)
        self._sender.start()

    def stop(self) -> None:
        """End the sending thread, and the comparison that is computed for the page."""
        self.what_if.stop()
        self._stop.set()
        self._sender.join(1.0)

    @property
    def span(self) -> Span | None:
        """Range of periods to look back at: those kept here that the twin can also branch from."""
        span, status = None if self.history is None else self.history.span, self.client.status()
        if span is None or status is None:
            return span
        first = min(max(span.first, status.oldest), span.last)
        return span._replace(first=first, first_time=span.first_time + (first - span.first) * PERIOD)

    # visitors and their notes

    @property
    def visitors(self) -> list[Visitor]:
        """Visitors whose pages are open now."""
        return list(self._visitors.values())

    def enter(self, client: viser.ClientHandle) -> Visitor:
        """A new visitor."""
        number = client.client_id
        visitor = Visitor(client, f"{self.client.sender}.{number}", f"Visitor {number + 1}")
        self._visitors[number] = visitor
        return visitor

    def leave(self, client: viser.ClientHandle) -> Visitor | None:
        """Forget a visitor who left, with its requests; if it drove, its lease ends."""
        visitor = self._visitors.pop(client.client_id, None)
        if visitor is None:
            return None
        visitor.gone = True
        self._asking.pop(visitor.sender, None)
        if self.is_driver(visitor):
            self.view.at = None
            self.view.aim_at_nothing()
            self.send(visitor, to.HandOver())
        return visitor

    def tell(self, visitor: Visitor | None, text: str, title: str = "", colour: str = "orange") -> None:
        """A note on one page, or on all."""
        for reader in self.visitors if visitor is None else [visitor]:
            if reader.gone:
                continue
            note = reader.client.add_notification(
                title or "Note", text, auto_close_seconds=NOTE_TIME, color=colour  # type: ignore[arg-type]
            )  # fmt: skip
            reader.show(note, text)

    def tell_error(self, visitor: Visitor | None, error: Exception, title: str) -> None:
        """A note about the error that is being handled, and its trace in the log."""
        traceback.print_exc()
        self.tell(visitor, f"{type(error).__name__}: {error}", title, "red")

    # the driver's lease

    def drives(self, visitor: Visitor) -> bool:
        """True for the driver, and for everybody while nobody drives."""
        status = self.client.status()
        return status is None or status.driver in ("", visitor.sender)

    def is_driver(self, visitor: Visitor) -> bool:
        """True for the visitor who drives."""
        status = self.client.status()
        return status is not None and status.driver == visitor.sender

    def refusal(self, visitor: Visitor) -> str:
        """Reason why this visitor may not change anything now; "" if they may."""
        status = self.client.status()
        if status is not None and not self.drives(visitor):
            return f"{status.driver_name} is driving"
        return "" if self.view.at is None else LOOKING_BACK

    def live(self, visitor: Visitor) -> bool:
        """True while the newest period is shown; else the visitor is told that the past cannot be changed."""
        if self.view.at is not None:
            self.tell(visitor, LOOKING_BACK)
        return self.view.at is None

    def ask(self, visitor: Visitor) -> None:
        """Ask the driver to hand over."""
        status = self.client.status()
        self._asking[visitor.sender] = visitor
        if status is None or not status.driver:
            return
        driver = next((other for other in self.visitors if other.sender == status.driver), None)
        if driver is not None:
            self.tell(driver, f"{visitor.name} asks for the wheel: the button on top of the panel hands it over")
        else:
            self.tell(visitor, f"{status.driver_name} drives from elsewhere; the wheel is free after 10 s of silence")

    def asks(self, visitor: Visitor) -> bool:
        """True while this visitor waits for a hand-over."""
        return visitor.sender in self._asking

    def asker(self) -> Visitor | None:
        """The visitor who has waited longest for a hand-over; None without one."""
        status = self.client.status()
        if status is None or not status.driver:
            self._asking.clear()
        else:
            self._asking.pop(status.driver, None)
        return next(iter(list(self._asking.values())), None)

    def keep_wheel(self, visitor: Visitor) -> None:
        """Take a free lease for an active visitor, or renew it for actions that change only the page."""
        quiet = time.monotonic() - visitor.sent > KEEP_WHEEL
        if quiet and self.client.alive and not visitor.gone:
            self.send(visitor, to.TakeWheel())

    # commands

    def send(self, visitor: Visitor | None, command: Command) -> None:
        """Queue a command; the visitor is told of a refusal."""
        if visitor is not None:
            visitor.sent = time.monotonic()
        try:
            self._queue.put_nowait((visitor, command))
        except queue.Full:
            self.tell(visitor, "too many commands at once")

    def command(self, visitor: Visitor | None, command: Command) -> Answer:
        """Send a command and wait for the answer; the visitor is told of a refusal. Blocks: not for Viser's thread.

        A loading server answers nothing: commands that hold for any scene wait until it is done.
        """
        timeout = PATIENCE if isinstance(command, PATIENT) else PROMPT
        if isinstance(command, PATIENT):
            if self.loading() and isinstance(command, ASKED):
                self.tell(visitor, "the twin is still loading: this comes next")
            while self.loading() and not self._stop.wait(LOOK):
                pass
        with self._speaking:  # no commands for a visitor whose lease was given back
            if visitor is None:
                answer = self.client.command(command, timeout)
            elif visitor.gone and not isinstance(command, to.HandOver):
                return Answer(ok=False, reason=f"{visitor.name} is gone")
            else:
                visitor.sent = time.monotonic()
                answer = self.client.command(command, timeout, sender=visitor.sender, name=visitor.name)
        if not answer.ok:
            self.tell(visitor, self.loading() or answer.reason)
        return answer

    def loading(self) -> str:
        """A sentence about the scene that the server is loading; "" when it is not."""
        status = self.client.status()
        if status is None or status.state != "loading" or not self.client.alive:
            return ""
        return f"still {status.text or 'loading'}: try again when it runs"

    def shows(self, layer: str) -> bool:
        """True while a page shows this layer."""
        return any(layer not in visitor.hidden for visitor in self.visitors)

    def inspect(self) -> None:
        """Ask the twin for the paths behind the clicked candidate and, when shown, the STAA* path."""
        picked = -1 if self.view.picked is None else self.view.picked
        self.send(None, to.Inspect(candidate=picked, staa_path=self.shows(STAA)))

    def _send_queued(self) -> None:
        while not self._stop.is_set():
            try:
                visitor, command = self._queue.get(timeout=0.2)
            except queue.Empty:
                continue
            try:
                self.command(visitor, command)
            except Exception as error:
                self.tell_error(visitor, error, "Not sent")
                time.sleep(0.1)

    # callbacks

    def watching(self, act: Act) -> Callable:
        """Wrap a callback ``act(event, visitor)`` that any visitor may trigger; its errors are shown on the page."""

        async def callback(event: Any) -> None:
            visitor = self._visitors.get(getattr(event, "client_id", None))  # type: ignore[arg-type]
            if visitor is None:
                return  # the value was set by this program, or the visitor has left
            try:
                result = act(event, visitor)
                if asyncio.iscoroutine(result):
                    await result
            except Exception as error:
                self.tell_error(visitor, error, "This did not work")

        return callback

    def driving(self, act: Act) -> Callable:
        """Wrap a callback only for the driver; others are told who drives."""

        def checked(event: Any, visitor: Visitor) -> object:
            if not self.drives(visitor):
                self.tell(visitor, self.refusal(visitor), "Only looking")
                return None
            result = act(event, visitor)
            self.keep_wheel(visitor)
            return result

        return self.watching(checked)


def clean_name(text: str) -> str:
    """A person's name for display: printable, one line, at most `NAME_MAX` characters; "" for none.

    Characters that change the direction of writing count as not printable.
    """
    words = "".join(letter if letter.isprintable() else " " for letter in text).split()
    return " ".join(words)[:NAME_MAX].strip()
