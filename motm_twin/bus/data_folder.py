"""The data folder of the server: sessions and recordings by plain names; nothing is overwritten."""

import datetime
import os
import sys
import threading
from collections.abc import Callable
from pathlib import Path

from motm_twin.bus.commands import Record, Refused, Save
from motm_twin.bus.live import LiveTwin
from motm_twin.bus.publisher import Outbox
from motm_twin.processes import Child, end_all

DEFAULT_FOLDER = Path("recordings")
MAX_FILES = 1000  # in the folder; a program that saves without end must not fill the disk
RECORDER = "motm_twin.record.recorder"
START_WAIT = 20.0  # [s] for the recorder to begin
_WAITING = 20  # files that may wait to be written

Done = Callable[[str, str], None]  # reason of the failure ("": done), path of the file


class DataFolder:
    """Writes files in its own thread. A failure is reported to the requester only."""

    def __init__(
        self,
        folder: Path,
        endpoint: str,
        twin: str,
        changed: Callable[[], None],
        failed: Callable[[str], None] = lambda _: None,
    ) -> None:
        """``endpoint`` and ``twin``: source of a recorder; ``changed`` is called when `recording` changes.

        ``failed`` is told why a running recording has stopped; it is called from another thread.
        """
        self._folder, self._endpoint, self._twin, self._changed = folder, endpoint, twin, changed
        self._failed = failed
        self._work = Outbox("files", _WAITING)
        self._recorder: Child | None = None
        self._path = ""
        self._first, self._last = {}, ""  # first event that the recorder reported, and kind of the last
        self._heard = threading.Event()

    @property
    def recording(self) -> str:
        """File being recorded to; "" for none."""
        running = self._recorder is not None and self._recorder.exit_code() is None
        return self._path if running else ""

    def write(self, command: Save | Record, live: LiveTwin, done: Done) -> None:
        """Save the running session, or start or stop a recording; ``done`` is called from another thread.

        Raises Refused.
        """
        match command:
            case Save(name=name):
                session = live.session()
                self._do(lambda: self._save(name, session), done)
            case Record(action="stop"):
                self._do(self._stop, done)
            case Record(name=name):
                scene = "" if live.scene is None else live.scene.name
                self._do(lambda: self._start(name, scene), done)

    def record(self, path: Path, done: Done) -> None:
        """Record to this file, or to a numbered one when it exists already (left by a server that died)."""
        self._do(lambda: self._launch(_unused(path)), done)

    def close(self) -> None:
        """Finish the recording."""
        self._work.close()
        if self._recorder is not None:
            end_all([self._recorder])

    def _do(self, write: Callable[[], Path], done: Done) -> None:
        def work() -> None:
            try:
                path = write()
            except (Refused, ValueError) as refusal:
                done(str(refusal), "")
            except OSError as error:
                done(f"{error.filename or self._folder} cannot be written: {error.strerror or error}", "")
            else:
                done("", str(path))

        if not self._work.post(work):
            raise Refused(f"{_WAITING} files are waiting to be written already")

    def _save(self, name: str, session: bytes) -> Path:
        from motm_twin.sessions.session import decode_session, save_session

        path = self._new(name, ".json")
        try:
            save_session(decode_session(session, file=path.name), path)
        except BaseException:
            path.unlink(missing_ok=True)
            raise
        return path

    def _start(self, name: str, scene: str) -> Path:
        if self.recording:
            raise Refused(f"{self._path} is being recorded already: stop that first")
        stamp = datetime.datetime.now(tz=datetime.UTC).strftime("%Y%m%d-%H%M%S")
        path = self._new(name or f"{scene}-{stamp}", ".mcap")
        path.unlink()  # the recorder creates it
        return self._launch(path)

    def _launch(self, path: Path) -> Path:
        arguments = ["--endpoint", self._endpoint, "--twin", self._twin, "--out", str(path)]
        heard = threading.Event()
        recorder = Child(
            "recorder",
            RECORDER,
            arguments,
            lambda event: self._report(heard, event),
            dict(os.environ),
            ended=lambda code: self._ended(heard, code),
        )
        self._path, self._first, self._last, self._heard = str(path), {}, "", heard
        self._recorder = recorder
        recorder.start()
        if not heard.wait(START_WAIT) or self._first.get("event") != "recording":
            end_all([recorder])
            self._recorder = None
            raise Refused(f"the recording did not start: {self._first.get('text', 'the recorder says nothing')}")
        self._changed()
        return path

    def _stop(self) -> Path:
        if self._recorder is None or not self.recording:
            raise Refused("nothing is being recorded")
        end_all([self._recorder])
        self._recorder = None
        self._changed()
        return Path(self._path)

    def _report(self, heard: threading.Event, event: dict) -> None:
        """Take an event of the recorder ``heard``; called in the thread that listens to it."""
        if heard is not self._heard:
            return
        self._last = event.get("event", "")
        if not heard.is_set():
            self._first = event
            heard.set()
        elif event.get("event") == "failed":
            self._failed(f"the recording has stopped: {event.get('text', '')}")
        self._changed()

    def _ended(self, heard: threading.Event, code: int) -> None:
        """Take the end of a recorder, in the same thread: one that reported no end was killed."""
        if heard is not self._heard:
            return
        if self._last == "recording":
            how = f"by signal {-code}" if code < 0 else f"with exit code {code}"
            why = f"its process ended {how}; `motm-twin recover {self._path}` repairs the file"
            print(f"record: the recording has stopped: {why}; the robot goes on", file=sys.stderr)
            self._failed(f"the recording has stopped: {why}")
        heard.set()
        self._changed()

    def _new(self, name: str, suffix: str) -> Path:
        """Create an empty file; its path. Raises Refused."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if sum(1 for _ in self._folder.iterdir()) >= MAX_FILES:
            raise Refused(f"{self._folder} has {MAX_FILES} files already: remove some")
        path = self._folder.resolve() / (name if name.endswith(suffix) else name + suffix)
        try:  # O_EXCL: refuses an existing link too, wherever it leads
            os.close(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644))
        except FileExistsError:
            raise Refused(f"{path} is there already: choose another name") from None
        return path


def _unused(path: Path) -> Path:
    """The path, made unique with a number from 2 on if it exists."""
    found, number = path, 1
    while os.path.lexists(found):
        number += 1
        found = path.with_name(f"{path.stem}-{number}{path.suffix}")
    return found
