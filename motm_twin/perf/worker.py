"""Workers: processes that take part in a benchmark, and do what JSON lines on their standard input say, one by one.

``python -m motm_twin.perf.worker ROLE [ARGUMENT ...]``. A worker says hello when it is ready, and ends with its input.
"""

import importlib
import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

from motm_twin.bus.processes import leave

ROLES = {  # name: module and function, which is given the arguments and gives the greeting and the works by name
    "bare": ("motm_twin.perf.bus_participants", "bare"),
    "readers": ("motm_twin.perf.bus_participants", "readers"),
    "twin": ("motm_twin.perf.timed_server", "timed_twin"),
    "fleet": ("motm_twin.perf.scale_worker", "fleet"),
    "attackers": ("motm_twin.perf.soak_worker", "attackers"),
}
START = 300.0  # [s] until a worker is ready: the first twin compiles its kernels
ANSWER = 120.0  # [s] until a worker has answered
STOP = 5.0  # [s]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Works = dict[str, Callable[..., Any]]


def one_thread(**more: str) -> dict[str, str]:
    """The environment, in which numeric libraries compute in one thread unless it says otherwise."""
    return {**dict.fromkeys(THREADS, "1"), **os.environ, **more}


class Worker:
    """A process that plays one of `ROLES`. ``with`` starts it, and ends it for certain."""

    def __init__(self, role: str, *arguments: object) -> None:
        self._name = role
        words = [sys.executable, "-m", "motm_twin.perf.worker", role, *map(str, arguments)]
        pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self.process = subprocess.Popen(words, env=one_thread(), **pipes)  # noqa: S603 - our own module
        self._hello: Any = None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self.process.pid

    @property
    def hello(self) -> Any:
        """Greeting of the worker when it was ready. Raises RuntimeError when it ended before."""
        if self._hello is None:
            self._hello = self._line(START)
        return self._hello

    def send(self, do: str, **details: Any) -> None:
        """Let it begin something; `answer` waits for the end."""
        assert self.hello is not None
        assert self.process.stdin is not None
        print(json.dumps({"do": do, **details}), file=self.process.stdin, flush=True)

    def answer(self, timeout: float = ANSWER) -> Any:
        """Answer to the last request. Raises RuntimeError."""
        answer = self._line(timeout)
        if "error" in answer:
            raise RuntimeError(f"{self._name}: {answer['error']}")
        return answer["ok"]

    def ask(self, do: str, timeout: float = ANSWER, **details: Any) -> Any:
        """`send`, then `answer`."""
        self.send(do, **details)
        return self.answer(timeout)

    def close(self) -> None:
        """End the process."""
        assert self.process.stdin is not None
        self.process.stdin.close()
        try:
            self.process.wait(STOP)
        except subprocess.TimeoutExpired:
            self.process.kill()
            self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def __enter__(self) -> "Worker":
        """Already running."""
        return self

    def __exit__(self, *_: object) -> None:
        """End it."""
        self.close()

    def _line(self, timeout: float) -> Any:
        """The next line; a worker that is silent for so long is killed."""
        assert self.process.stdout is not None
        late = threading.Timer(timeout, self.process.kill)
        late.start()
        try:
            line = self.process.stdout.readline()
        finally:
            late.cancel()
        if not line:
            raise RuntimeError(f"{self._name} ended, or said nothing for {timeout:.0f} s")
        return json.loads(line)


def main() -> None:
    """Play the role that the command line names, until standard input ends."""
    role, *arguments = sys.argv[1:]
    module, function = ROLES[role]
    hello, works = getattr(importlib.import_module(module), function)(*arguments)
    _say(hello)
    for line in sys.stdin:
        wish = json.loads(line)
        try:
            _say({"ok": works[wish.pop("do")](**wish)})
        except Exception as error:
            _say({"error": f"{type(error).__name__}: {error}"})
    leave(0)


def _say(answer: Any) -> None:
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
