"""The reference robot on Zenoh: messages in and out, and the clock that lets its time pass."""

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.session import open_member
from motm_twin.external.emulator import LinkSpec
from motm_twin.external.keys import PlantKeys
from motm_twin.external.messages import VERSION, ClockGrant, EditRequest, PlantAnswer, ResetRequest, TaskNotice
from motm_twin.external.robot import ReferenceRobot, encode
from motm_twin.model.scene import Scene
from motm_twin.sim.plant import SUBSTEP

MAX_WAITING = 2000  # messages; more are dropped
MAX_REQUEST = 1024 * 1024  # bytes
MAX_GRANT = 1.0  # [s] of shared time in one grant
CATCH_UP = 1.0  # [s] that a real clock falls behind before it gives up catching up
IDLE = 0.1  # [s] between looks at the stop event
SENT = ("state", "scan", "detections", "truth", "clock")


class RobotServer:
    """Runs a reference robot in the thread that calls `run`; Zenoh's threads only put what arrives into a queue."""

    def __init__(
        self,
        scene: Scene,
        endpoint: str,
        *,
        twin: str = "frankie",
        clock: str = "real",
        link: LinkSpec | None = None,
        stop: threading.Event | None = None,
    ) -> None:
        """Raises ValueError for a name or clock that can not be, TimeoutError when stopped before anybody answers."""
        if clock not in ("real", "shared"):
            raise ValueError(f"clock {clock!r}: use real or shared")
        self.keys, self._clock = PlantKeys(twin), clock
        self._stop = stop or threading.Event()
        self._queue: queue.Queue[Callable[[], None]] = queue.Queue(MAX_WAITING)
        self._granted = 0.0
        self._session = open_member(endpoint, stop=self._stop)
        self._publishers = {
            name: self._session.declare_publisher(
                getattr(self.keys, name), congestion_control=zenoh.CongestionControl.BLOCK, express=True
            )
            for name in SENT
        }
        self.robot = ReferenceRobot(scene, send=self._put, link=link, clock=clock)
        self._started = time.monotonic()
        self._declared = [
            self._session.declare_subscriber(self.keys.command, _direct(self._on_command)),
            self._session.declare_subscriber(self.keys.grant, _direct(self._on_grant)),
            self._asked(self.keys.info, None, lambda _: encode(self.robot.info())),
            self._asked(self.keys.reset, ResetRequest, self._reset),
            self._asked(self.keys.edit, EditRequest, lambda request: encode(self.robot.edit(request))),
            self._asked(self.keys.tasks, TaskNotice, lambda notice: encode(self.robot.tasks(notice))),
        ]
        self._token = self._session.liveliness().declare_token(self.keys.alive)

    def run(self) -> None:
        """Let time pass until stopped."""
        self.robot.show()
        self._started = time.monotonic()
        while not self._stop.is_set():
            if self._clock == "real":
                self._take(self._started + self.robot.time + SUBSTEP - time.monotonic())
                self._pass_real()
            else:
                self._take(IDLE)
                while self.robot.time + 0.5 * SUBSTEP < self._granted:
                    self.robot.step()

    def stop(self) -> None:
        """Make `run` return."""
        self._stop.set()

    def close(self) -> None:
        """Leave, after `run`."""
        for declared in (*self._declared, self._token, *self._publishers.values()):
            declared.undeclare()
        self._session.close()

    def _pass_real(self) -> None:
        due = time.monotonic() - self._started
        if due - self.robot.time > CATCH_UP:  # the machine was busy: time that was missed did not pass
            self._started = time.monotonic() - self.robot.time - SUBSTEP
            due = self.robot.time + SUBSTEP
        while self.robot.time + SUBSTEP <= due:
            self.robot.step()

    def _take(self, wait: float) -> None:
        """Do what has arrived; wait for it as long as there is nothing to do."""
        deadline = time.monotonic() + wait
        while True:
            left = deadline - time.monotonic()
            try:
                work = self._queue.get(timeout=left) if left > 0.0 else self._queue.get_nowait()
            except queue.Empty:
                return
            work()
            if self._clock == "shared" and self.robot.time + 0.5 * SUBSTEP < self._granted:
                return

    def _put(self, name: str, payload: bytes) -> None:
        with suppress(zenoh.ZError):  # nobody is connected now
            self._publishers[name].put(payload)

    def _post(self, work: Callable[[], None]) -> None:
        with suppress(queue.Full):
            self._queue.put_nowait(work)

    def _on_command(self, sample: zenoh.Sample) -> None:
        payload = sample.payload.to_bytes()
        self._post(lambda: self.robot.command(payload))

    def _on_grant(self, sample: zenoh.Sample) -> None:
        try:
            grant = msgspec.json.decode(sample.payload.to_bytes(), type=ClockGrant)
        except msgspec.DecodeError:
            return
        self._post(lambda: self._grant(grant))

    def _grant(self, grant: ClockGrant) -> None:
        if grant.life != self.robot.life or grant.version != VERSION:
            return
        if grant.until <= self.robot.time + 0.5 * SUBSTEP:
            self.robot.show()  # asked again: the answer was lost
        elif grant.until <= self.robot.time + MAX_GRANT:
            self._granted = grant.until

    def _reset(self, request: ResetRequest) -> bytes:
        answer = self.robot.reset(request)
        self._granted, self._started = 0.0, time.monotonic()
        self.robot.show()
        return encode(answer)

    def _asked(self, key: str, kind: Any, answer: Callable[[Any], bytes]) -> zenoh.Queryable:
        """Answer questions on this key, in the robot's thread."""

        def on_query(query: zenoh.Query) -> None:
            payload = b"" if query.payload is None else query.payload.to_bytes()
            self._post(lambda: _reply(query, key, payload, kind, answer))

        return self._session.declare_queryable(key, on_query)


def _reply(query: zenoh.Query, key: str, payload: bytes, kind: Any, answer: Callable[[Any], bytes]) -> None:
    try:
        if len(payload) > MAX_REQUEST:
            raise ValueError(f"{len(payload)} bytes: at most {MAX_REQUEST} are taken")
        request = None if kind is None else msgspec.json.decode(payload, type=kind)
        if request is not None and request.version != VERSION:
            raise ValueError(f"version {request.version!r}: this robot reads {VERSION!r}")
        text = answer(request)
    except (ValueError, RecursionError) as error:
        text = encode(PlantAnswer(version=VERSION, ok=False, reason=str(error)))
    with suppress(zenoh.ZError), query:
        query.reply(key, text, encoding=zenoh.Encoding.APPLICATION_JSON)


def _direct(callback: Callable[[zenoh.Sample], None]) -> zenoh.handlers.Callback:
    return zenoh.handlers.Callback(callback, indirect=False)
