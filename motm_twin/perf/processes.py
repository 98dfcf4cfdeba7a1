"""Processes of a benchmark: `motm-twin serve` as a user starts it, workers, and a robot in another program."""

import json
import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Command, HandOver, Pause, Play, Reset, Speed
from motm_twin.bus.connection import LOOPBACK, free_port, open_server
from motm_twin.bus.health import page_answers
from motm_twin.bus.messages import TickMessage
from motm_twin.external.plant import ZenohPlant
from motm_twin.external.robot import LinkSpec
from motm_twin.external.robot_link import RobotLink
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import find_method
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.program import THREADS
from motm_twin.trial import run_scene
from motm_twin.ui.page_server import VARIABLE, page_url

START = 300.0  # [s] for the first start on a busy machine: kernels are compiled
STOP = 10.0  # [s]
DRIVEN = "is driving"  # part of a refusal while another client has the lease
WHEEL = 15.0  # [s] to wait for the lease
_TICKS = os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Served:
    """A running `serve`."""

    port: int  # of the page
    client: TwinClient
    process: subprocess.Popen
    token: str = ""  # of the page

    @property
    def url(self) -> str:
        """Address of the page as `serve` prints it."""
        return page_url(LOOPBACK, self.port, self.token)

    def pid(self, module: str) -> int:
        """Process number of the child that runs a module. Raises RuntimeError when there is none."""
        for pid, words in children(self.process.pid):
            if module in words:
                return pid
        raise RuntimeError(f"no process of {module} under {self.process.pid}")

    @property
    def viewer(self) -> int:
        """Process number of the viewer."""
        return self.pid("motm_twin.ui.viewer")

    @property
    def server(self) -> int:
        """Process number of the twin server."""
        return self.pid("motm_twin.server_process")

    def interrupt(self) -> float:
        """Send Ctrl-C; returns the time [s] until the process has ended."""
        started = time.monotonic()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(STOP)
        return time.monotonic() - started


def children(of: int) -> Iterator[tuple[int, list[str]]]:
    """Process number and command line of each child of a process; works on every Linux kernel."""
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
            words = (path / "cmdline").read_bytes().decode().split("\0")
        except (OSError, ValueError):
            continue
        if parent == of:
            yield int(path.name), words


@contextmanager
def served(scene: str, *options: str) -> Iterator[Served]:
    """Context in which a scene is served on free ports."""
    port, zenoh_port, token = free_port(), free_port(), secrets.token_urlsafe(32)
    command = [sys.executable, "-m", "motm_twin", "serve", scene, "--port", str(port)]
    process = subprocess.Popen(  # noqa: S603 - our own program
        [*command, "--zenoh-port", str(zenoh_port), *options],
        stdout=subprocess.DEVNULL,
        env={**os.environ, VARIABLE: token},
    )
    try:
        with TwinClient(f"tcp/{LOOPBACK}:{zenoh_port}") as client:
            up = lambda: running(process) and page_answers(port) and client.tick() is not None  # noqa: E731
            wait_for(up, START, "page and first period")
            yield Served(port, client, process, token)
    finally:
        if process.poll() is None:
            process.terminate()
        process.wait(STOP)


def running(process: subprocess.Popen) -> bool:
    """True while this `serve` runs. Raises RuntimeError when it has ended."""
    if process.poll() is not None:
        raise RuntimeError(f"serve ended with exit code {process.returncode}")
    return True


def wait_for(condition: Callable[[], Any], timeout: float, what: str) -> Any:
    """Wait until ``condition`` is true and return its value. Raises TimeoutError."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"no {what} within {timeout:.0f} s")
        time.sleep(0.01)
    return value


def cpu_seconds(pid: int) -> float:
    """Processor time [s] that all threads of a process have used."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def act(client: TwinClient, command: Command) -> None:
    """Send a command and give up the lease, so that a page may take it. Raises RuntimeError when it is refused."""
    deadline = time.monotonic() + WHEEL
    while not (answer := client.command(command)).ok:
        if DRIVEN not in answer.reason or time.monotonic() > deadline:
            raise RuntimeError(f"{command!r} was refused: {answer.reason}")
        time.sleep(0.1)  # a page keeps the lease until it has been silent for a while
    client.command(HandOver())


def restart(client: TwinClient, *, playing: bool) -> None:
    """Reset the run to its start at 1x, playing or paused."""
    act(client, Pause())
    act(client, Reset())
    wait_for(lambda: now(client).index <= 1, 60.0, "start of the run")
    act(client, Speed(factor=1.0))
    if playing:
        act(client, Play())
        wait_for(lambda: now(client).index > 1, 60.0, "period after the start")


def ticks(client: TwinClient, seconds: float) -> Iterator[TickMessage]:
    """Every new tick for ``seconds`` of wall time; ends early with the run."""
    deadline, seen, last = time.monotonic() + seconds, 0, -1
    while time.monotonic() < deadline:
        seen = client.wait_tick(seen, 0.2)
        tick = now(client)
        if tick.index != last and not tick.preview:
            last = tick.index
            yield tick
        if tick.done:
            return


def now(client: TwinClient) -> TickMessage:
    """The newest tick. Raises RuntimeError when there is none yet."""
    tick = client.tick()
    if tick is None:
        raise RuntimeError("the twin has not run yet")
    return tick


def open_place(client: TwinClient) -> tuple[float, float]:
    """A position [m] in a corner of the map that is in nobody's way. Raises RuntimeError without a scene."""
    scene = client.scene()
    if scene is None:
        raise RuntimeError("the twin has no scene yet")
    return scene.bounds[0] + 1.0, scene.bounds[1] + 1.0


@contextmanager
def external_robot(scene: Scene, link: LinkSpec) -> Iterator[ZenohPlant]:
    """A reference robot in a process of its own; gives the plant that drives it once it has started."""
    port = free_port()
    session = open_server(port)
    arguments = ["exp1", "--endpoint", f"tcp/{LOOPBACK}:{port}", "--clock", "shared", "--child"]
    for name in ("latency", "jitter", "loss", "outage", "every", "seed"):
        arguments += [f"--{'link-seed' if name == 'seed' else name}", str(getattr(link, name))]
    process = subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-m", "motm_twin", "robot", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    robot = RobotLink(session, "frankie")
    try:
        yield ZenohPlant(robot, scene)
    finally:
        process.terminate()
        process.wait(30.0)
        robot.close()
        session.close()


def run_external(name: str, variant: str | None, link: LinkSpec, method: str = DEFAULT_METHOD) -> dict[str, Any]:
    """Run a trial with an external robot; returns the dictionary of `motm_twin.trial.run_scene`."""
    scene = load_scene(name, variant)
    with external_robot(scene, link) as plant:
        return run_scene(scene, plant=plant, method=find_method(method))


WORKER_START = 300.0  # [s] until a worker is ready: the first twin compiles its kernels
ANSWER = 120.0  # [s] until a worker has answered
WORKER_STOP = 5.0  # [s] until a worker has ended by itself


def one_thread(**more: str) -> dict[str, str]:
    """The environment with one thread for numeric libraries, unless it already sets their number; plus ``more``."""
    return {**dict.fromkeys(THREADS, "1"), **os.environ, **more}


class Worker(AbstractContextManager["Worker"]):
    """A process that plays a role of `perf.participants`; leaving a ``with`` block ends it for certain."""

    def __init__(self, role: str, *arguments: object) -> None:
        self._name = role
        words = [sys.executable, "-m", "motm_twin.perf.participants", role, *map(str, arguments)]
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(words, env=one_thread(), **pipes)  # noqa: S603 - our own module
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self._wishes, self._answers = self.process.stdin, self.process.stdout
        self._hello: Any = None

    @property
    def pid(self) -> int:
        """Process number."""
        return self.process.pid

    @property
    def hello(self) -> Any:
        """Greeting that the worker sends when ready. Raises RuntimeError when it ends before."""
        if self._hello is None:
            self._hello = self._line(WORKER_START)
        return self._hello

    def send(self, do: str, **details: Any) -> None:
        """Send a request; `answer` waits for its result."""
        assert self.hello is not None
        print(json.dumps({"do": do, **details}), file=self._wishes, flush=True)

    def answer(self, timeout: float = ANSWER) -> Any:
        """Result of the last request. Raises RuntimeError when it failed."""
        answer = self._line(timeout)
        if "error" in answer:
            raise RuntimeError(f"{self._name}: {answer['error']}")
        return answer["ok"]

    def ask(self, do: str, timeout: float = ANSWER, **details: Any) -> Any:
        """`send`, then `answer`."""
        self.send(do, **details)
        return self.answer(timeout)

    def close(self) -> None:
        """End the process, by force when it does not end by itself."""
        self._wishes.close()
        try:
            self.process.wait(WORKER_STOP)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        self._answers.close()

    def __exit__(self, *_: object) -> None:
        self.close()

    def _line(self, timeout: float) -> Any:
        """The next line, decoded; a worker that is silent for ``timeout`` [s] is killed."""
        late = threading.Timer(timeout, self.process.kill)
        late.start()
        try:
            line = self._answers.readline()
        finally:
            late.cancel()
        if not line:
            raise RuntimeError(f"{self._name} ended, or said nothing for {timeout:.0f} s")
        return json.loads(line)
