"""Processes that take part in a measurement: each does what lines of JSON on its standard input say, one by one."""

import json
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from typing import Any

from motm_twin.bus.process import leave

START = 300.0  # [s] until a worker is ready: the first twin compiles its kernels
ANSWER = 120.0  # [s] until a worker has answered
STOP = 5.0  # [s]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")

Work = Callable[..., Any]


def serve_lines(hello: Any, works: dict[str, Work]) -> None:
    """In the worker: say hello, then do what is asked, until standard input ends."""
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


class Worker:
    """A process of a module of this package. ``with`` starts it, and ends it for certain."""

    def __init__(self, module: str, *arguments: object) -> None:
        environment = {**dict.fromkeys(THREADS, "1"), **os.environ}
        self._name = module.rsplit(".", 1)[-1]
        self.process = subprocess.Popen(  # noqa: S603 - our own module
            [sys.executable, "-m", module, *(str(argument) for argument in arguments)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        )
        self._hello: Any = None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self.process.pid

    @property
    def hello(self) -> Any:
        """What it said when it was ready. Raises RuntimeError when it ended before."""
        if self._hello is None:
            self._hello = self._line(START)
        return self._hello

    def send(self, do: str, **details: Any) -> None:
        """Let it begin something; `answer` waits for the end."""
        assert self.hello is not None
        assert self.process.stdin is not None
        print(json.dumps({"do": do, **details}), file=self.process.stdin, flush=True)

    def answer(self, timeout: float = ANSWER) -> Any:
        """What came of the last wish. Raises RuntimeError."""
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
