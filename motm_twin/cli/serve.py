"""`motm-twin serve`: the twin server and its page as two processes, supervised until Ctrl-C."""

import os
import queue
import signal
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from rich.console import Console

from motm_twin.bus.connection import LOOPBACK, VARIABLE, Keys, check_endpoint, free_port, require_free_port
from motm_twin.bus.library import MethodLibrary
from motm_twin.bus.private_folder import Running, announce, client_file, forget, keep_fresh, note, own_credentials
from motm_twin.bus.security import Folder
from motm_twin.cli.scene import load_with_doubts
from motm_twin.cli.settings import PageSettings, ReplaySettings, ServeSettings
from motm_twin.plants import with_plant
from motm_twin.processes import Child, end_all, handled, setter
from motm_twin.program import BAD_INPUT, FAILED, OK, THREADS, folder_problem, plain_console
from motm_twin.ui.page_server import VARIABLE as VARIABLE_OF_TOKEN
from motm_twin.ui.page_server import check_token, chosen_token

SERVER, PAGE = "twin server", "page"
WATCH = 0.1  # [s] between checks of the children
TOUCH_INTERVAL = 3600.0  # [s] between two touches of the private files


def serve(given: ServeSettings) -> int:
    """Run until Ctrl-C or SIGTERM; the exit code. Raises SceneError and MethodError for an unusable scene or method.

    0: ended on request. 1: a process died again and again. 2: bad input, such as a port that is taken.
    """
    with_plant(load_with_doubts(given.scene, given.variant, given.seed), given.plant)
    methods = MethodLibrary(given.method)
    methods.find(methods.own_name)
    console = plain_console()
    try:
        page = _checked(given)
        folder = None if given.secure is None else Folder(Path(given.secure)).ready()
    except (OSError, ValueError) as error:
        console.print(f"motm-twin serve: {error.args[-1]}", style="red", markup=False)
        return BAD_INPUT
    supervisor = _Supervisor(console, given.twin, given.zenoh_port or free_port(), folder, given.open_bus)
    supervisor.add(SERVER, "motm_twin.server_process", given.server_arguments(supervisor.zenoh_port))
    if not given.headless:
        own = [] if methods.own_name == given.method else ["--own-method", methods.own_name, given.method]
        supervisor.add_page(page, own)
    if given.ros2 is not None:
        bridge = ["--endpoint", supervisor.endpoint, "--twin", given.twin, "--form", given.ros2]
        supervisor.add("ROS 2 bridge", "motm_twin.ros2.bridge_process", bridge)
    return supervisor.run()


def _checked(given: ServeSettings) -> PageSettings:
    """Check all settings but scene and method; returns the page with its token. Raises ValueError, OSError."""
    if given.paused and given.play:
        raise ValueError("--paused and --play exclude each other")
    if given.loop and given.external:
        raise ValueError("--loop is for the simulated robot: another one does not begin anew by itself")
    if given.open_bus and given.secure is not None:
        raise ValueError("--open-bus and --secure exclude each other")
    if given.connect is not None:
        if not given.external:
            raise ValueError("--connect is where twin and robot meet: it needs --plant zenoh or --plant mirror")
        check_endpoint(given.connect)
    page = _checked_addresses(given, "is another twin running?")
    if (path := given.record) is not None:
        if path.suffix != ".mcap":
            raise ValueError(f"--record {path}: give a name that ends in .mcap")
        if problem := folder_problem(path.parent):
            raise ValueError(f"--record {path}: {problem}")
        if path.exists() or not path.parent.is_dir():
            raise ValueError(f"--record {path}: give a new file in a folder that exists")
    if given.data is not None and (problem := folder_problem(given.data)):
        raise ValueError(f"--data {given.data}: {problem}")
    return page


def _checked_addresses(given: ServeSettings | ReplaySettings, hint: str) -> PageSettings:
    """Check name, ports and passwords; returns the page with its token. Raises ValueError, OSError."""
    Keys(given.twin)
    own_credentials()  # raises if they cannot be stored
    require_free_port(LOOPBACK, given.zenoh_port, f"{hint} Choose another one with --zenoh-port (0: any)")
    page = given.page
    if given.headless:
        return page
    if page.visitors < 1:
        raise ValueError(f"--visitors {page.visitors}: at least one page must be possible")
    token = chosen_token(page.token, none=page.no_token)
    check_token(page.host, token)
    require_free_port(page.host, page.port, "choose another one with --port (0 takes any free one)")
    return replace(page, token=token)


def serve_recording(given: ReplaySettings) -> int:
    """Play a recording under the keys of a twin, with its page; exit codes as for `serve`."""
    console = plain_console()
    try:
        page = _checked_addresses(given, "is a twin running?")
    except (OSError, ValueError) as error:
        console.print(f"motm-twin replay: {error.args[-1]}", style="red", markup=False)
        return BAD_INPUT
    supervisor = _Supervisor(console, given.twin, given.zenoh_port or free_port(), None, given.open_bus)
    supervisor.add(SERVER, "motm_twin.record.player_server", given.server_arguments(supervisor.zenoh_port))
    if not given.headless:
        supervisor.add_page(page)
    return supervisor.run()


class _Supervisor:
    """Starts, reports on, restarts and ends the processes."""

    def __init__(
        self, console: Console, twin: str, zenoh_port: int, folder: Folder | None = None, open_bus: bool = False
    ) -> None:
        self._console, self._twin, self._folder, self._open_bus = console, twin, folder, open_bus
        self.zenoh_port = zenoh_port
        self.endpoint = f"tcp/{LOOPBACK}:{zenoh_port}"
        self._children: list[Child] = []
        self._events: queue.Queue[dict] = queue.Queue()
        self._stop = threading.Event()
        self._started = time.monotonic()
        self._note: Path | None = None
        self._open = False

    def add(self, name: str, module: str, arguments: list[str], token: str | None = None) -> None:
        """Add a process to supervise."""
        env = {name: value for name, value in os.environ.items() if name != VARIABLE_OF_TOKEN}
        for threads in THREADS:
            env.setdefault(threads, "1")
        if token is not None:
            env[VARIABLE_OF_TOKEN] = token
        if name == PAGE:  # returns memory after visitors left: `give_back` cannot trim Python's own arenas
            env.setdefault("PYTHONMALLOC", "malloc")
        if self._folder is not None:
            env[VARIABLE] = str(self._folder.server if name == SERVER else self._folder.here)
        self._children.append(Child(name, module, arguments, self._events.put, env))

    def add_page(self, page: PageSettings, more: Sequence[str] = ()) -> None:
        """Add the page; its address is printed, with a note on who may drive."""
        self._open = page.token is None
        self.add(PAGE, "motm_twin.ui.viewer", [*page.arguments(self.endpoint, self._twin), *more], page.token)

    def run(self) -> int:
        """Supervise the processes until a signal; the exit code."""
        with handled(setter(self._stop), signal.SIGINT, signal.SIGTERM):
            if self._open_bus:
                announce(self.zenoh_port, self.endpoint, None)  # before the children connect
            self._print(f"motm-twin: starting twin [bold]{self._twin}[/bold]")
            for child in self._children:
                child.start()
            self._remember(None, "")
            try:
                code = self._watch()
            finally:
                end_all(self._children)
                if self._note is not None:
                    self._note.unlink(missing_ok=True)
                forget(self.zenoh_port)
        self._print("motm-twin: stopped")
        return code

    def _watch(self) -> int:
        young = time.monotonic()
        while not self._stop.wait(WATCH):
            if time.monotonic() - young > TOUCH_INTERVAL:
                young = time.monotonic()
                keep_fresh()
            self._tell_events()
            for child in self._children:
                code = child.exit_code()
                if code is None or self._stop.is_set():
                    continue
                time.sleep(WATCH)  # for its last reports
                self._tell_events()
                if code == BAD_INPUT:
                    return BAD_INPUT
                if not child.may_restart():
                    self._print(f"[red]the {child.name} ended again and again (exit code {code}); giving up[/red]")
                    return FAILED
                self._print(f"[yellow]the {child.name} ended (exit code {code}); starting it again[/yellow]")
                child.start()
        return OK

    def _tell_events(self) -> None:
        while not self._events.empty():
            self._tell(self._events.get())

    def _tell(self, event: dict) -> None:
        after = f"{time.monotonic() - self._started:5.1f} s"
        match event["event"]:
            case "listening":
                self._print(f"{after}  Zenoh: {event['endpoint']}, keys motm/{self._twin}/**")
                yours = f"your programs, and others with {client_file(self.zenoh_port)}"
                who = "anybody on this machine" if self._open_bus else yours
                self._print(f"{after}  Zenoh accepts {who}", markup=False)
                if why := event.get("no_real_time"):
                    self._print(f"{after}  no real-time scheduling: {why} (docs/install.md)", markup=False)
            case "page":
                self._remember(event["port"], event["url"])
                self._print(f"{after}  Page:  [bold]{event['url']}[/bold]")
                who = "on this machine" if self._open else "with this address"
                self._print(f"{after}  anybody {who} may look and drive", markup=False)
            case "ros2":
                self._print(f"{after}  ROS 2: {event['text']}", markup=False)
            case "record":
                words = "recording to" if event["ok"] else "not recorded:"
                self._print(f"{after}  {words} {event['text']}", markup=False)
            case "refused":
                self._print(f"motm-twin: {event['text']}", style="red", markup=False)
            case "state":
                text = event["text"] or {"playing": "the robot moves"}.get(event["state"], "")
                self._print(f"{after}  {event['state']}{text and ': ' + text}", markup=False)

    def _print(self, text: str, **options: Any) -> None:
        """Print; a closed output or a full disk must not stop the robot."""
        with suppress(OSError):
            self._console.print(text, **options)

    def _remember(self, port: int | None, page: str) -> None:
        running = Running(pid=os.getpid(), twin=self._twin, endpoint=self.endpoint, page_port=port, page=page)
        self._note = note(running)
