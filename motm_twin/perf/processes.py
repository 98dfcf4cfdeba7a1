"""A served twin to measure, `motm-twin serve` as a user starts it: its processes, and how a benchmark drives it."""

import os
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Command, HandOver, Pause, Play, Reset, Speed
from motm_twin.bus.connection import LOOPBACK, free_port
from motm_twin.bus.health import page_answers
from motm_twin.bus.messages import TickMessage
from motm_twin.ui.page_server import VARIABLE, page_url

START = 300.0  # [s] for the first start on a busy machine: kernels are compiled
STOP = 10.0  # [s]
DRIVEN = "is driving"  # what a refusal says while somebody else has the wheel
WHEEL = 15.0  # [s] to wait for the wheel
_TICKS = os.sysconf("SC_CLK_TCK")
_PAGE = os.sysconf("SC_PAGE_SIZE")


@dataclass(frozen=True)
class Served:
    """A running `serve`."""

    port: int  # of the page
    client: TwinClient
    process: subprocess.Popen
    token: str = ""  # of the page

    @property
    def url(self) -> str:
        """Address of the page, as it is printed."""
        return page_url(LOOPBACK, self.port, self.token)

    def pid(self, module: str) -> int:
        """Number of the child process that runs a module. Raises RuntimeError when there is none."""
        for path in Path("/proc").glob("[0-9]*"):
            try:
                parent = int((path / "stat").read_text().rsplit(")", 1)[1].split()[1])
                words = (path / "cmdline").read_bytes().decode().split("\0")
            except (OSError, ValueError):
                continue
            if parent == self.process.pid and module in words:
                return int(path.name)
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
        """Ctrl-C; how long [s] it took to end."""
        started = time.monotonic()
        self.process.send_signal(signal.SIGINT)
        self.process.wait(STOP)
        return time.monotonic() - started


@contextmanager
def served(scene: str, *options: str) -> Iterator[Served]:
    """Serve a scene on free ports until the end of the block."""
    port, zenoh_port, token = free_port(), free_port(), secrets.token_urlsafe(32)
    command = [sys.executable, "-m", "motm_twin.cli", "serve", scene, "--port", str(port)]
    process = subprocess.Popen(  # noqa: S603 - our own program
        [*command, "--zenoh-port", str(zenoh_port), *options],
        stdout=subprocess.DEVNULL,
        env={**os.environ, VARIABLE: token},
    )
    try:
        with TwinClient(f"tcp/{LOOPBACK}:{zenoh_port}") as client:
            wait_for(lambda: _up(process, port, client), START, "page and first period")
            yield Served(port, client, process, token)
    finally:
        if process.poll() is None:
            process.terminate()
        process.wait(STOP)


def _up(process: subprocess.Popen, port: int, client: TwinClient) -> bool:
    if process.poll() is not None:
        raise RuntimeError(f"serve ended with exit code {process.returncode}")
    return page_answers(port) and client.tick() is not None


def wait_for(condition: Callable[[], Any], timeout: float, what: str) -> Any:
    """Wait for a state and return it. Raises TimeoutError."""
    deadline = time.monotonic() + timeout
    while not (value := condition()):
        if time.monotonic() > deadline:
            raise TimeoutError(f"no {what} within {timeout:.0f} s")
        time.sleep(0.01)
    return value


def cpu_seconds(pid: int) -> float:
    """Processor time [s] that a process has used, all its threads."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / _TICKS


def memory_mb(pid: int) -> float:
    """Resident memory of a process [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text().split()[1]) * _PAGE / 1e6


def act(client: TwinClient, command: Command) -> None:
    """Send a command and let go of the wheel, so that a page may take it. Raises RuntimeError when it is refused."""
    deadline = time.monotonic() + WHEEL
    while not (answer := client.command(command)).ok:
        if DRIVEN not in answer.reason or time.monotonic() > deadline:
            raise RuntimeError(f"{command!r} was refused: {answer.reason}")
        time.sleep(0.1)  # a page has the wheel until it has been silent for a while
    client.command(HandOver())


def restart(client: TwinClient, *, playing: bool) -> None:
    """The run from its start at 1x."""
    act(client, Pause())
    act(client, Reset())
    wait_for(lambda: now(client).index <= 1, 60.0, "start of the run")
    act(client, Speed(factor=1.0))
    if playing:
        act(client, Play())
        wait_for(lambda: now(client).index > 1, 60.0, "period after the start")


def ticks(client: TwinClient, seconds: float) -> Iterator[TickMessage]:
    """Every new tick for so long [s of wall time]; ends early with the run."""
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
