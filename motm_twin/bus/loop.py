"""The twin in real time: plays, pauses and steps it, and applies commands between periods. Knows no transport."""

import difflib
import functools
import queue
import threading
import time
import traceback
from collections.abc import Callable
from typing import Protocol

import msgspec

from motm_twin.bus.commands import (
    EDITS,
    AddObstacle,
    Command,
    Load,
    MoveBody,
    Pause,
    Play,
    RemoveBody,
    Reset,
    Speed,
    Step,
)
from motm_twin.bus.commands import ReleaseBody as Release
from motm_twin.bus.encode import tick_message
from motm_twin.bus.gate import Refused
from motm_twin.bus.holds import Holds
from motm_twin.bus.messages import STATUS_VERSION, SceneChoice, StatusMessage, TickMessage
from motm_twin.bus.pacing import Pacer
from motm_twin.bus.preview import preview
from motm_twin.control.tick import Tick
from motm_twin.model.edits import WorldEdit
from motm_twin.model.scene import Scene

MAX_ADDED = 30
SETTLE_PERIODS = 40  # after the last task, so that the last cube lands and the robot comes to rest
IDLE_WAIT = 0.1  # [s] between looks at the clock while time stands


class TwinLike(Protocol):
    """What the loop needs of a twin."""

    def advance(self) -> Tick:
        """Compute one period."""
        ...

    def post(self, edit: WorldEdit) -> None:
        """Apply an edit at the start of the next period."""
        ...

    def reset(self) -> None:
        """Back to the start."""
        ...


class SceneLibrary(Protocol):
    """Scenes that may be loaded."""

    def choices(self) -> list[SceneChoice]:
        """What there is."""
        ...

    def load(self, scene: str, variant: str | None, seed: int | None) -> Scene:
        """Resolve one. Raises ValueError with a reason."""
        ...


class Sink(Protocol):
    """Where the loop's results go; called from the loop's thread."""

    def tick(self, message: TickMessage, tick: Tick, last: bool) -> None:
        """A new period; ``last`` when no other follows for now."""
        ...

    def scene(self, scene: Scene) -> None:
        """Another scene was loaded."""
        ...

    def status(self) -> None:
        """The status changed."""
        ...


Reply = Callable[[str, int], None]  # reason ("" = done), index of the last period


class TwinLoop:
    """Owns the twin; everything that touches it happens in the thread that calls `run`."""

    def __init__(
        self,
        *,
        twin_name: str,
        library: SceneLibrary,
        make_twin: Callable[[Scene], TwinLike],
        sink: Sink,
        first: Load,
        playing: bool = True,
        server_time: Callable[[], float] = time.time,
    ) -> None:
        self._twin_name, self._library, self._make_twin, self._sink = twin_name, library, make_twin, sink
        self._first, self._play_at_start, self._server_time = first, playing, server_time
        self._requests: queue.Queue[tuple[Command, Reply]] = queue.Queue(maxsize=1000)
        self._stop = threading.Event()
        self._pacer, self._holds = Pacer(), Holds()
        self._choices = library.choices()
        self._twin: TwinLike | None = None
        self._scene: Scene | None = None
        self._message: TickMessage | None = None
        self._tick: Tick | None = None
        self._pending: list[WorldEdit] = []
        self._settling = SETTLE_PERIODS
        self._state, self._text, self._run = "loading", "starting", 0

    def request(self, command: Command, reply: Reply) -> None:
        """Hand a checked command over; ``reply`` is called once, from the loop's thread. Raises Refused when full."""
        try:
            self._requests.put_nowait((command, reply))
        except queue.Full:
            raise Refused("too many commands are waiting") from None

    def stop(self) -> None:
        """Make `run` return after the current period."""
        self._stop.set()

    def status(self) -> StatusMessage:
        """The state of the server, from any thread."""
        now, scene, message = time.monotonic(), self._scene, self._message
        playing = self._state == "playing"
        return StatusMessage(
            version=STATUS_VERSION,
            twin=self._twin_name,
            run=self._run,
            server_time=self._server_time(),
            state=self._state,
            text=self._text,
            scene=scene.name if scene else self._first.scene,
            variant=scene.variant if scene else (self._first.variant or ""),
            seed=scene.seed if scene else (self._first.seed or 0),
            time=message.time if message else 0.0,
            speed=self._pacer.speed,
            actual_speed=round(self._pacer.actual_speed(now), 2) if playing else 0.0,
            capped=playing and self._pacer.capped(now),
            scenes=self._choices,
        )

    def run(self) -> None:
        """Load the first scene and run until `stop`."""
        self._guarded(lambda: self._load(self._first, self._play_at_start))
        while not self._stop.is_set():
            now = time.monotonic()
            self._take_request(self._pacer.wait(now) if self._state == "playing" else IDLE_WAIT)
            self._release_silent()
            if self._state == "playing" and self._pacer.wait(time.monotonic()) == 0.0:
                self._guarded(self._advance)

    def _take_request(self, wait: float) -> None:
        try:
            command, reply = self._requests.get(timeout=wait) if wait > 0.0 else self._requests.get_nowait()
        except queue.Empty:
            return
        while True:
            self._answer(command, reply)
            try:
                command, reply = self._requests.get_nowait()
            except queue.Empty:
                return

    def _answer(self, command: Command, reply: Reply) -> None:
        index = self._message.index if self._message else -1
        try:
            self._apply(command)
        except Refused as refusal:
            reply(str(refusal), index)
        else:
            reply("", index)

    def _apply(self, command: Command) -> None:
        match command:
            case Play():
                self._require_twin()
                if self._state == "done":
                    self._restart(True)
                else:
                    self._set_state("playing", "")
            case Pause():
                self._require_twin()
                if self._state == "playing":
                    self._set_state("paused", "")
            case Step(count=count):
                self._require_twin()
                self._step(count)
            case Reset():
                if self._twin is None:
                    raise Refused(f"no scene is running: {self._text}")
                self._restart(self._state in ("playing", "done"))
            case Speed(factor=factor):
                self._pacer.speed = factor
                self._pacer.restart()
                self._sink.status()
            case Load():
                self._load(command, self._state in ("playing", "done") or self._twin is None)
            case _ if isinstance(command, EDITS):
                self._edit(command)

    def _require_twin(self) -> TwinLike:
        if self._twin is None:
            raise Refused(f"no scene is running: {self._text}")
        if self._state == "error":
            raise Refused(f"the twin stopped with an error: {self._text}; reset or load a scene")
        return self._twin

    def _edit(self, edit: WorldEdit) -> None:
        twin = self._require_twin()
        self._check_names(edit)
        try:
            twin.post(edit)
        except ValueError as error:
            raise Refused(str(error)) from error
        self._holds.note(edit, time.monotonic())
        self._pending.append(edit)
        if self._state != "playing":
            self._show_pending()

    def _check_names(self, edit: WorldEdit) -> None:
        shown = preview(self._message, self._pending) if self._message else None
        agents = [body.name for body in shown.agents] if shown else []
        added = [body.name for body in shown.obstacles] if shown else []
        match edit:
            case AddObstacle(name=name):
                if name in agents or name in added or self._scene_has(name):
                    raise Refused(f"the name {name!r} is in use")
                if len(added) >= MAX_ADDED:
                    raise Refused(f"{MAX_ADDED} obstacles were added already; remove one first")
            case RemoveBody(name=name):
                _require_known(name, added)
            case MoveBody(name=name) | Release(name=name):
                _require_known(name, agents + added)

    def _scene_has(self, name: str) -> bool:
        scene = self._scene
        return scene is not None and any(
            name == item.name for item in (*scene.solids, *scene.objects, *scene.bins, *scene.agents)
        )

    def _release_silent(self) -> None:
        for release in self._holds.expired(time.monotonic()):
            if self._twin is not None:
                self._guarded(functools.partial(self._twin.post, release))

    def _show_pending(self) -> None:
        if self._message is not None and self._tick is not None:
            shown = preview(self._message, self._pending)
            shown = msgspec.structs.replace(shown, server_time=self._server_time())
            self._sink.tick(shown, self._tick, last=True)

    def _set_state(self, state: str, text: str) -> None:
        if (state, text) == (self._state, self._text):
            return
        if state == "playing":
            self._pacer.restart()
        self._state, self._text = state, text
        self._sink.status()

    def _load(self, command: Load, play: bool) -> None:
        try:
            scene = self._library.load(command.scene, command.variant, command.seed)
        except ValueError as error:
            raise Refused(str(error)) from error
        self._set_state("loading", f"loading {scene.name} {scene.variant}".rstrip())
        self._scene, self._twin, self._message, self._tick = scene, None, None, None
        self._sink.scene(scene)
        self._guarded(lambda: self._build(scene, play))

    def _build(self, scene: Scene, play: bool) -> None:
        self._set_state("loading", "preparing the control loop (the first start compiles it, up to half a minute)")
        self._twin = self._make_twin(scene)
        self._begin(play)

    def _restart(self, play: bool) -> None:
        self._guarded(lambda: self._reset(play))

    def _reset(self, play: bool) -> None:
        if self._twin is not None:
            self._set_state("loading", "back to the start")
            self._twin.reset()
            self._begin(play)

    def _begin(self, play: bool) -> None:
        self._run += 1
        self._pending, self._message, self._settling = [], None, SETTLE_PERIODS
        self._holds.clear()
        self._pacer.restart()
        self._advance()
        if self._state != "done":
            self._set_state("playing" if play else "paused", "")

    def _step(self, count: int) -> None:
        if self._state == "done":
            raise Refused("the run has ended: reset it first")
        self._set_state("paused", "")
        for _ in range(count):
            if self._state != "paused" or self._stop.is_set():
                break
            self._guarded(self._advance)

    def _advance(self) -> None:
        assert self._twin is not None
        self._pacer.started(time.monotonic())
        tick = self._twin.advance()
        self._pending = []
        message = tick_message(tick, self._run, self._server_time())
        self._message, self._tick = message, tick
        self._sink.tick(message, tick, last=self._state != "playing" or tick.done)
        self._settling = self._settling - 1 if tick.done else SETTLE_PERIODS
        if tick.done and self._settling <= 0:
            outcome = "all tasks are done" if tick.success else (tick.stop_reason or "the run ended without success")
            self._set_state("done", outcome)

    def _guarded(self, action: Callable[[], None]) -> None:
        """Run an action of the twin; any error stops it and is shown to everybody instead of ending the server."""
        try:
            action()
        except Refused as refusal:
            self._set_state("error", str(refusal))
        except Exception as error:
            traceback.print_exc()
            self._set_state("error", f"{type(error).__name__}: {error}")


def _require_known(name: str, known: list[str]) -> None:
    if name in known:
        return
    near = difflib.get_close_matches(name, known, 3, 0.4) or known[:5]
    raise Refused(f"there is no {name!r} to move" + (f"; there are: {', '.join(near)}" if near else ""))
