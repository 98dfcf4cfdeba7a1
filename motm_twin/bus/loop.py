"""The twin in real time: plays, pauses and steps it, and applies commands between periods. Knows no transport."""

import math
import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress

import msgspec

from motm_twin.bus import commands
from motm_twin.bus.commands import Holds, Wheel
from motm_twin.bus.data_folder import DataFolder
from motm_twin.bus.library import MethodLibrary, SceneSource, TwinSetup
from motm_twin.bus.live import LiveTwin, SessionDesk, SessionReply, Sink
from motm_twin.bus.messages import STATUS_VERSION, StatusMessage
from motm_twin.bus.pacing import Pacer, RealTime
from motm_twin.bus.queries import Idle, Reply
from motm_twin.control.tick import SETTLE_PERIODS
from motm_twin.model.bounds import SEED
from motm_twin.model.plant import PERIOD
from motm_twin.model.scene import DriveTo, Scene
from motm_twin.sessions.session import LoggedEdit

IDLE_WAIT = 0.1  # [s] between checks of the clock while paused
STANDING_INTERVAL = 0.05  # [s] minimum between two previews of a paused twin
AT_START = "the run starts when the first page shows it, or somebody drives; play starts it now"
AGAIN = 8.0  # [s] from the end of a run that nobody drives to the next run
REQUESTS_PER_TURN = 32  # limited, so that time goes on however many requests wait

Work = Callable[[], None]


class TwinLoop:
    """Owns the twin; everything that touches it happens in the thread that calls `run`."""

    def __init__(
        self,
        setup: TwinSetup,
        *,
        twin_name: str,
        sink: Sink,
        server_time: Callable[[], float] = time.time,
        data: DataFolder | None = None,
    ) -> None:
        """``sink`` receives the results; ``server_time``: clock of the server [s]; ``data``: folder of saved files."""
        self._twin_name, self._sink, self._data = twin_name, sink, data
        self._play_at_start, self._server_time, self._reference_tour = setup.playing, server_time, setup.reference_tour
        self._requests: queue.Queue[Work] = queue.Queue(maxsize=1000)
        self._stop, self._reload = threading.Event(), threading.Event()
        self._pacer, self._live = Pacer(), LiveTwin(setup.make_twin, server_time, setup.plant)
        self._wheel = Wheel(self._post, lambda: sink.status())  # noqa: PLW0108 - the sink may be set later
        self._source = SceneSource(setup.library, setup.methods or MethodLibrary(), setup.first)
        self._tour: float | None = None
        self._hold, self._again, self._pages = setup.hold, setup.again, 0
        self._held, self._ended = False, math.inf  # waits for a page now; [s] monotonic, end of the run
        self._steps, self._settling = 0, SETTLE_PERIODS  # periods left: requested steps, and after the last task
        self._play_on, self._first_due = setup.playing, False  # resume on a new task; first period due
        self._outdated, self._stood_at = False, -1e9  # preview of the paused twin is outdated; [s] when it was sent
        self._state, self._text = "loading", "starting"
        self._sessions = SessionDesk(
            lambda: (self._live.session(), self._live.session_info()),
            lambda error: f"{commands.reason_of(error)} ({self._text or self._state})",
        )
        self.took = 0.0  # [s] of wall time that the last period needed
        self.idle, self._real_time = Idle(), RealTime()  # idle while no period is computed

    def request(self, envelope: commands.Envelope, reply: Reply) -> None:
        """Hand a command over; ``reply`` is called once, before slow work. Raises Refused when full."""
        arrived = time.monotonic()
        self._put(lambda: self._answer(envelope, arrived, reply))

    def session(self, reply: SessionReply) -> None:
        """Ask for the run so far; ``reply`` is called once, between two periods. Raises Refused when full."""
        if self._sessions.ask(reply):
            with suppress(commands.Refused):  # a full queue keeps the loop awake
                self._put(lambda: None)

    def reload(self) -> None:
        """Load the running scene again, because its file has changed; from any thread."""
        self._reload.set()

    def stop(self) -> None:
        """Make `run` return after the current period."""
        self._stop.set()

    def status(self) -> StatusMessage:
        """The state of the server, from any thread."""
        now, live, scene, source = time.monotonic(), self._live, self._live.scene, self._source
        playing, busy = self._state == "playing", self._state in ("loading", "error")
        return StatusMessage(
            version=STATUS_VERSION,
            twin=self._twin_name,
            server_time=self._server_time(),
            state=self._state,
            text=self._text if busy else (source.error or self._text or (live.waiting if playing else "")),
            speed=self._pacer.speed,
            actual_speed=round(self._pacer.actual_speed(now), 2) if playing else 0.0,
            capped=playing and self._pacer.capped(now),
            **source.shown(scene),
            **self._wheel.shown(now),
            **live.status(),
            reference_tour=self._tour,
            recording="" if self._data is None else self._data.recording,
            pages=self._pages if self._hold or self._again else -1,
            held=self._held,
        )

    def run(self) -> None:
        """Load the first scene and run until `stop`."""
        self._guarded(lambda: self._load(self._source.loaded, self._play_at_start)())  # noqa: PLW0108 - it may raise
        while not self._stop.is_set():
            self._guarded(self._take_requests)
            self._guarded(self._look_after)
            self._guarded(self._send_preview)
            if self._until_due() == 0.0:
                self._guarded(self._advance)

    def _put(self, work: Work) -> None:
        try:
            self._requests.put_nowait(work)
        except queue.Full:
            raise commands.Refused("too many commands are waiting") from None

    def _until_due(self) -> float:
        """Seconds until the next period is due; infinite when none is to be computed."""
        if self._state == "playing":
            return 0.0 if self._live.real_time else self._pacer.wait(time.monotonic())
        return 0.0 if self._state == "paused" and (self._steps > 0 or self._first_due) else math.inf

    def _take_requests(self) -> None:
        shown = max(0.0, self._stood_at + STANDING_INTERVAL - time.monotonic()) if self._outdated else IDLE_WAIT
        wait = min(self._until_due(), shown)
        try:
            work = self._requests.get(timeout=wait) if wait > 0.0 else self._requests.get_nowait()
            work()
            for _ in range(REQUESTS_PER_TURN - 1):
                self._requests.get_nowait()()
        except queue.Empty:
            return

    def _answer(self, envelope: commands.Envelope, arrived: float, reply: Reply) -> None:
        index, command, late = self._live.index, envelope.command, self._server_time() - envelope.expires
        try:
            if late >= 0.0:  # it had to wait, for a load, for example
                raise commands.Refused(f"stale: expired {late:.3f} s ago")
            self._wheel.require(envelope, arrived)
            if isinstance(command, commands.Save | commands.Record):
                self._write_file(envelope, command, index, reply)
                return
            work = self._apply(command)
        except Exception as error:
            reply(commands.reason_of(error), index)
            return
        self._wheel.turn(envelope, arrived)
        if work is not None:
            self._set_state("loading", "")  # before the answer, so that an error reported after it is new
        reply("", index)
        if work is not None:
            self._guarded(work)
            self._wheel.lease.renew(envelope.sender, time.monotonic())  # waiting for one's own command is no silence

    def _apply(self, command: commands.Command) -> Work | None:
        """Apply a command, or return the slow part to do after the answer. Raises Refused."""
        match command:
            case commands.Play():
                return self._play()
            case commands.Pause():
                self._require_twin()
                self._steps = 0
                if self._state == "playing":
                    self._set_state("paused", "")
            case commands.Step(count=count):
                self._require_twin()
                if self._state == "done":
                    raise commands.Refused("the run has ended: reset it first")
                self._steps += count
                self._set_state("paused", "")
            case commands.Reset():
                self._require_scene()
                self._live.require_commanded()
                return lambda play=self._state in ("playing", "done"): self._restart(play)
            case commands.Speed(factor=factor):
                self._live.require_speed(factor)
                self._pacer.speed = factor
                self._pacer.restart()
                self._sink.status()
            case commands.Load():
                return self._load(command, self._state in ("playing", "done") or self._live.twin is None)
            case commands.Seed(seed=seed):
                self._require_twin()
                return self._apply(msgspec.structs.replace(self._source.loaded, seed=seed))
            case commands.DriveToPoint(x=x, y=y, heading=heading):
                self._require_twin()
                task = DriveTo(point=(x, y), heading=heading)
                self._edit(commands.InsertTask(tasks=(task,), index=self._live.task_index))
            case commands.Branch(index=index):
                self._require_scene()
                self._live.require_branch(index)
                return self._going_on(lambda: self._live.branch(index), f"going back to {index * PERIOD:.1f} s")
            case commands.UndoBranch():
                self._require_scene()
                self._live.require_aside()
                return self._going_on(self._live.undo_branch, f"back to {self._live.aside:.1f} s")
            case commands.Inspect():
                self._require_twin()
                self._live.inspect(command)
                self._outdated = True
            case commands.Audience(pages=pages):
                self._pages = pages
                self._sink.status()
                if self._held and pages and self._state == "paused":
                    self._set_state("playing", "")
            case _ if isinstance(command, commands.Edit):
                self._edit(command)
        return None  # the remaining commands concern the lease only

    def _require_scene(self) -> None:
        if self._live.twin is None:
            raise commands.Refused(f"no scene is running yet: {self._text or self._state}")

    def _require_twin(self) -> None:
        self._require_scene()
        if self._state == "error":
            raise commands.Refused(f"the twin stopped with an error: {self._text}; reset or load a scene")

    def _play(self) -> Work | None:
        self._require_twin()
        self._steps, self._hold = 0, False
        if self._state == "done":
            return lambda: self._restart(True)
        self._set_state("playing", "")
        return None

    def _edit(self, edit: commands.Edit) -> None:
        self._require_twin()
        self._live.post(edit)
        self._wheel.holds.note(edit, time.monotonic())
        if isinstance(edit, commands.InsertTask | commands.Drive):
            if self._held:  # somebody drives, though not with a page
                self._set_state("playing", "")
            if self._state == "done":
                self._settling = SETTLE_PERIODS
                self._set_state("playing" if self._play_on else "paused", "")
        self._outdated = True

    def _write_file(
        self, envelope: commands.Envelope, command: commands.Save | commands.Record, index: int, reply: Reply
    ) -> None:
        """Write a file in another thread, which answers. Raises Refused."""
        if self._data is None:
            raise commands.Refused("this server has no data folder")
        self._require_scene()

        def done(problem: str, path: str) -> None:
            if not problem:
                with suppress(commands.Refused):  # full: then others are sending, and one of them drives
                    self._put(lambda: self._wheel.turn_if_free(envelope, time.monotonic()))
            reply(problem, index, path)  # messages sent after this arrive after the answer

        self._data.write(command, self._live, done)

    def _post(self, edit: commands.Edit) -> None:
        """Post an edit of the loop itself."""
        if self._live.twin is None:
            return
        try:
            self._live.post(edit)
        except commands.Refused as refusal:
            self._set_state(self._state, str(refusal))
        else:
            self._outdated = True

    def _look_after(self) -> None:
        now = time.monotonic()
        self._wheel.look_after(now)
        ended = self._again and self._state == "done" and now >= self._ended + AGAIN
        if ended and not self._wheel.lease.driver:
            self._guarded(self._next_seed)
        self._sessions.serve(now, self._state == "playing")
        if self._reload.is_set():
            self._reload.clear()
            self._guarded(self._load_again)

    def _next_seed(self) -> None:
        scene = self._live.scene
        assert scene is not None
        seed = 0 if SEED.refusal("seed", scene.seed + 1) else scene.seed + 1
        self._load(msgspec.structs.replace(self._source.loaded, seed=seed), True)()

    def _send_preview(self) -> None:
        """Send previews after edits and inspections while paused: at once, but rate-limited."""
        now = time.monotonic()
        if not self._outdated or now < self._stood_at + STANDING_INTERVAL:
            return
        self._stood_at = now
        try:
            if self._state != "playing" and (shown := self._live.shown()) is not None:
                self._sink.tick(*shown, last=True)
        finally:
            self._outdated = False

    def _set_state(self, state: str, text: str) -> None:
        if (state, text) == (self._state, self._text):
            return
        self._held = False
        self._ended = time.monotonic() if state == "done" else math.inf
        if state == "playing":
            self._pacer.restart()
        else:
            self._real_time.want(False)  # a load takes seconds of computing
        self._state, self._text = state, text
        self._sink.status()

    def _load(self, command: commands.Load, play: bool) -> Work:
        """Resolve the scene; the returned function makes its twin and starts it. Raises Refused."""
        scene = self._source.load(command)
        return lambda: self._build(scene, play, "")

    def _load_again(self) -> None:
        """Reload a changed scene file. While it is invalid, the old scene goes on."""
        before, scene = self._source.error, self._source.again()
        if self._source.error != before:
            self._sink.status()
        if scene is not None and scene != self._live.scene:  # a changed comment or corrected error does not count
            play = self._state in ("playing", "done") or self._live.twin is None
            self._build(scene, play, "scene file changed: loaded again")

    def _build(self, scene: Scene, play: bool, text: str) -> None:
        self._set_state("loading", f"loading {scene.name} {scene.variant}".rstrip())
        self._live.clear(scene)
        self._sink.scene(scene, self._live.run + 1)
        self._set_state("loading", "preparing the control loop (the first start compiles it, a minute or more)")
        self._live.build(scene, self._source.method())
        self._tour = None if self._reference_tour is None else self._reference_tour(scene)
        self._begin(play, text)

    def _restart(self, play: bool) -> None:
        self._set_state("loading", "back to the start")
        self._live.reset()
        self._begin(play)

    def _going_on(self, move: Callable[[], list[LoggedEdit]], text: str) -> Work:
        """Work that continues from another moment or run; ``move`` goes there and returns the edits until then."""
        play = self._state in ("playing", "done")

        def go_on() -> None:
            self._set_state("loading", text)
            holds = Holds()
            for entry in move():
                holds.note(entry.edit, 0.0)
            for release in holds.expired():  # nobody holds these bodies any more
                self._live.post(release)
            self._begin(play)

        return go_on

    def _begin(self, play: bool, text: str = "") -> None:
        self._settling, self._steps, self._first_due = SETTLE_PERIODS, 0, True
        self._wheel.holds.clear()
        self._pacer.restart()
        self._advance()
        if self._state != "done":
            waits = play and self._hold and not self._pages
            self._set_state("playing" if play and not waits else "paused", AT_START if waits else text)
            self._held = waits

    def _advance(self) -> None:
        unasked = self._first_due and self._state == "paused" and not self._steps
        if not self._live.ready() or (unasked and self._live.commands_at_once):  # no robot, or it would move unasked
            self._stop.wait(IDLE_WAIT)
            return
        self._steps, self._first_due = max(0, self._steps - (not self._first_due)), False
        self._pacer.started(time.monotonic())
        self._real_time.want(self._state == "playing" and self._pacer.at_ease(time.monotonic()))
        self._outdated = False
        began = time.perf_counter()
        with self.idle.suspended(self._live.simulated):  # with an external robot the period mostly waits
            message, tick = self._live.advance(by_the_clock=self._state == "playing")
        self.took = time.perf_counter() - began
        done = tick.done and not self._live.mirror
        self._sink.tick(message, tick, last=self._state != "playing" or done)
        self._live.tell_refused(self._sink)
        self._settling = self._settling - 1 if done else SETTLE_PERIODS
        if done and self._settling <= 0:
            self._play_on, self._steps = self._state == "playing", 0
            outcome = "all tasks are done" if tick.success else (tick.stop_reason or "the run ended without success")
            self._set_state("done", outcome)

    def _guarded(self, action: Work) -> None:
        """Run an action of the twin; any error stops it and is shown to everybody instead of ending the server."""
        try:
            action()
        except Exception as error:
            self._set_state("error", commands.reason_of(error))
