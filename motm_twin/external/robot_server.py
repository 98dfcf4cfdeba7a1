"""The reference robot on Zenoh: messages in and out, and the clock that lets its time pass."""

import queue
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any

import msgspec
import zenoh

from motm_twin.bus.connection import PlantKeys, direct, open_member, spoken_on
from motm_twin.bus.plant_messages import VERSION, ClockGrant, EditRequest, PlantAnswer, ResetRequest, TaskNotice
from motm_twin.external.robot import LinkSpec, ReferenceRobot, encode
from motm_twin.model.plant import SUBSTEP
from motm_twin.model.scene import Scene

MAX_WAITING = 2000  # messages; more are dropped
MAX_REQUEST = 1024 * 1024  # bytes
MAX_GRANT = 1.0  # [s] of shared time in one grant
KEPT = 0.25  # [s] that a grant which overtook its command waits for it; the command may be lost
CATCH_UP = 1.0  # [s] that a real clock may fall behind before it skips the missed time
IDLE = 0.1  # [s] between checks of the stop event
Answer = Callable[[Any], msgspec.Struct]  # to a request
SENT = ("state", "scan", "detections", "truth", "clock")


class _Numbered(msgspec.Struct, frozen=True):
    life: str
    seq: int


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
        on_met: Callable[[], None] = lambda: None,
    ) -> None:
        """``on_met``: called once, in another thread, when a twin listens. Raises ValueError: wrong name or clock."""
        if clock not in ("real", "shared"):
            raise ValueError(f"clock {clock!r}: use real or shared")
        self.keys, self._endpoint, self._clock = PlantKeys(twin), endpoint, clock
        self._stop, self._on_met = stop or threading.Event(), on_met
        self.met = False  # a twin has listened
        self._queue: queue.Queue[Callable[[], None]] = queue.Queue(MAX_WAITING)
        self._granted, self._newest = 0.0, -1  # [s] shared time; highest number of an arrived command
        self._early: tuple[ClockGrant, float] | None = None  # grant that overtook its command, and when it ends waiting
        self.robot = ReferenceRobot(scene, send=self._put, link=link, clock=clock)
        self._started = time.monotonic()
        self._session: zenoh.Session | None = None
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._declared: list[Any] = []

    def run(self) -> None:
        """Wait until a server answers at the endpoint, then let time pass, until stopped."""
        try:
            self._declare(open_member(self._endpoint, stop=self._stop))
        except TimeoutError:  # stopped before a server answered
            return
        self.robot.show()
        self._started = time.monotonic()
        while not self._stop.is_set():
            if self._clock == "real":
                self._take(self._started + self.robot.time + SUBSTEP - time.monotonic())
                self._pass_real()
            else:
                self._take(IDLE if self._early is None else min(IDLE, max(0.0, self._early[1] - time.monotonic())))
                self._grant_early()
                while self.robot.time + 0.5 * SUBSTEP < self._granted:
                    self.robot.step()

    def stop(self) -> None:
        """Make `run` return."""
        self._stop.set()

    def close(self) -> None:
        """Close the session, after `run`."""
        for declared in (*self._declared, *self._publishers.values()):
            declared.undeclare()
        if self._session is not None:
            self._session.close()

    def _declare(self, session: zenoh.Session) -> None:
        self._session = session
        self._publishers = {
            name: session.declare_publisher(
                getattr(self.keys, name), congestion_control=zenoh.CongestionControl.BLOCK, express=True
            )
            for name in SENT
        }
        self._declared = [
            session.declare_subscriber(self.keys.command, direct(self._on_command)),
            session.declare_subscriber(self.keys.grant, direct(self._on_grant)),
            self._queryable(session, self.keys.info, None, lambda _: self.robot.info()),
            self._queryable(session, self.keys.reset, ResetRequest, self._reset),
            self._queryable(session, self.keys.edit, EditRequest, self.robot.edit),
            self._queryable(session, self.keys.tasks, TaskNotice, self.robot.tasks),
            session.liveliness().declare_token(self.keys.alive),
            self._publishers["state"].declare_matching_listener(direct(self._on_matching)),
        ]

    def _on_matching(self, status: zenoh.MatchingStatus) -> None:
        """Report a twin, in Zenoh's thread: any subscriber to the state, also one that only mirrors the robot."""
        if status.matching and not self.met:
            self.met = True
            self._on_met()

    def _pass_real(self) -> None:
        due = time.monotonic() - self._started
        if due - self.robot.time > CATCH_UP:  # the machine was busy: missed time does not pass
            self._started = time.monotonic() - self.robot.time - SUBSTEP
            due = self.robot.time + SUBSTEP
        while self.robot.time + SUBSTEP <= due:
            self.robot.step()

    def _take(self, wait: float) -> None:
        """Run queued work and wait for more, for ``wait`` [s] in all, or until granted time can pass."""
        deadline = time.monotonic() + wait
        while True:
            left = deadline - time.monotonic()
            try:
                work = self._queue.get(timeout=left) if left > 0.0 else self._queue.get_nowait()
            except queue.Empty:
                return
            work()
            self._grant_early()
            if self._clock == "shared" and self.robot.time + 0.5 * SUBSTEP < self._granted:
                return

    def _put(self, name: str, payload: bytes) -> None:
        with suppress(zenoh.ZError):  # nobody is connected now
            self._publishers[name].put(payload)

    def _post(self, work: Callable[[], None]) -> None:
        with suppress(queue.Full):
            self._queue.put_nowait(work)

    def _on_command(self, sample: zenoh.Sample) -> None:
        if spoken_on(sample, self.keys.command):
            payload = sample.payload.to_bytes()
            self._post(lambda: self._command(payload))

    def _command(self, payload: bytes) -> None:
        self.robot.command(payload)
        with suppress(msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            command = msgspec.json.decode(payload, type=_Numbered)
            if command.life == self.robot.life:
                self._newest = max(self._newest, command.seq)

    def _on_grant(self, sample: zenoh.Sample) -> None:
        if spoken_on(sample, self.keys.grant):
            with suppress(msgspec.DecodeError, UnicodeDecodeError, RecursionError):
                grant = msgspec.json.decode(sample.payload.to_bytes(), type=ClockGrant)
                self._post(lambda: self._grant(grant))

    def _grant(self, grant: ClockGrant) -> None:
        if grant.life != self.robot.life or grant.version != VERSION:
            return
        if grant.until <= self.robot.time + 0.5 * SUBSTEP:
            self.robot.show()  # asked again: the answer was lost
        elif grant.until > self.robot.time + MAX_GRANT:
            return
        elif grant.after > self._newest:
            self._early = (grant, time.monotonic() + KEPT) if self._early is None else (grant, self._early[1])
        else:
            self._granted, self._early = grant.until, None

    def _grant_early(self) -> None:
        """Apply a waiting grant once its command has come, or after `KEPT`."""
        if self._early is None:
            return
        grant, ends = self._early
        if grant.life != self.robot.life:
            self._early = None
        elif grant.after <= self._newest or time.monotonic() >= ends:
            self._granted, self._early = max(self._granted, grant.until), None

    def _reset(self, request: ResetRequest) -> PlantAnswer:
        answer = self.robot.reset(request)
        if answer.ok:
            self._granted, self._started, self._newest, self._early = 0.0, time.monotonic(), -1, None
            self.robot.show()
        return answer

    def _queryable(self, session: zenoh.Session, key: str, kind: Any, answer: Answer) -> zenoh.Queryable:
        """Declare a queryable that answers on this key, in the robot's thread."""

        def on_query(query: zenoh.Query) -> None:
            if kind is not None and not spoken_on(query, key):
                return  # a query to a wildcard asks for no change
            payload = b"" if query.payload is None else query.payload.to_bytes()
            self._post(lambda: _reply(query, key, payload, kind, answer))

        return session.declare_queryable(key, on_query)


def _reply(query: zenoh.Query, key: str, payload: bytes, kind: Any, answer: Answer) -> None:
    try:
        if len(payload) > MAX_REQUEST:
            raise ValueError(f"{len(payload)} bytes: at most {MAX_REQUEST} are taken")
        request = None if kind is None else msgspec.json.decode(payload, type=kind)
        if request is not None and request.version != VERSION:
            raise ValueError(f"version {request.version!r}: this robot reads {VERSION!r}")
        reply = answer(request)
    except (ValueError, RecursionError) as error:
        reply = PlantAnswer(version=VERSION, ok=False, reason=str(error))
    with suppress(zenoh.ZError), query:
        query.reply(key, encode(reply), encoding=zenoh.Encoding.APPLICATION_JSON)
