"""Child processes of `serve`: started, listened to, started again when they die, and ended for certain."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable

GRACE = 1.6  # [s] between the wish to end and the end by force
RESTARTS = 3  # within RESTART_WINDOW
RESTART_WINDOW = 60.0  # [s]

Listener = Callable[[str, dict], None]  # name of the child, event


class Child:
    """One process that runs a module of this package and reports through a pipe."""

    def __init__(
        self,
        name: str,
        module: str,
        arguments: list[str],
        listener: Listener,
        env: dict[str, str],
        ended: Callable[[int], None] = lambda code: None,
    ) -> None:
        """``ended`` is called with the exit code of each process, after all that it reported."""
        self._ended = ended
        self.name, self._module, self._arguments = name, module, arguments
        self._listener, self._env = listener, env
        self._starts: list[float] = []
        self.process: subprocess.Popen | None = None

    def start(self) -> None:
        """Start the process. It ends by itself when this one is gone, because its standard input ends."""
        read, write = os.pipe()
        command = [sys.executable, "-m", self._module, *self._arguments, "--report", str(write)]
        self.process = subprocess.Popen(  # noqa: S603 - our own module with checked arguments
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            pass_fds=(write,),
            start_new_session=True,  # Ctrl-C reaches this process only, which then ends its children in order
            env=self._env,
        )
        os.close(write)
        self._starts.append(time.monotonic())
        listen = threading.Thread(
            target=self._listen, args=(read, self.process), name=f"{self.name} reports", daemon=True
        )
        listen.start()

    def exit_code(self) -> int | None:
        """None while it runs."""
        return None if self.process is None else self.process.poll()

    def may_restart(self) -> bool:
        """Whether it died seldom enough to be worth another start."""
        recent = [at for at in self._starts if time.monotonic() - at < RESTART_WINDOW]
        return len(recent) <= RESTARTS

    def _listen(self, descriptor: int, process: subprocess.Popen) -> None:
        with os.fdopen(descriptor, encoding="utf-8") as lines:
            for line in lines:
                self._listener(self.name, json.loads(line))
        self._ended(process.wait())


def end_all(children: list[Child]) -> None:
    """End all children: asked first, forced after `GRACE`; returns when none is left."""
    running = [child.process for child in children if child.process is not None and child.process.poll() is None]
    for process in running:
        process.send_signal(signal.SIGTERM)
    deadline = time.monotonic() + GRACE
    for process in running:
        try:
            process.wait(max(0.01, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
    for child in children:
        if child.process is not None and child.process.stdin is not None:
            child.process.stdin.close()
