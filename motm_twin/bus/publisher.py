"""Publishes the loop's results and its health on Zenoh, and answers queries for the last of each.

The loop only hands results over: encoding and sending happen in threads of this module. State goes through one thread,
in order and without waiting for slow readers. Events go through another, which may wait for a reader and then drop it.
"""

import os
import queue
import threading
import time
import traceback
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
import zenoh

from motm_twin.bus.connection import Keys
from motm_twin.bus.encode import ObservationEncoder, RobotEncoder, as_message, grid_bytes, grid_info
from motm_twin.bus.events import EventLog, EventWatch
from motm_twin.bus.messages import METRICS_VERSION, MetricsMessage, SceneInfo, ScoreMessage, StatusMessage, TickMessage
from motm_twin.bus.queries import Idle, LatestValues
from motm_twin.control.tick import Tick
from motm_twin.model.plant import PERIOD, Observation
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Scene
from motm_twin.perception.world_map import WorldMap

Work = Callable[[], None]
DRAIN = 1.0  # [s] to send the rest at closing
EVERY = 2  # every second sample is sent; they come at 100 Hz
KEPT = 200  # samples that may wait while the sender is blocked
Send = Callable[[Observation, int], None]  # sample, run


class Outbox:
    """Does work in its own thread. With ``size`` pieces waiting, further ones are dropped."""

    def __init__(self, name: str, size: int) -> None:
        # Posting to a SimpleQueue does not yield the interpreter; with a lock, the poster waited for the other thread.
        self._queue: queue.SimpleQueue[Work | None] = queue.SimpleQueue()
        self._size, self._closed = size, False
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def post(self, work: Work) -> bool:
        """Queue a piece of work; never waits. False when it was dropped."""
        if self._closed or self._queue.qsize() >= self._size:
            return False
        self._queue.put(work)
        return True

    def close(self) -> bool:
        """Finish queued work within `DRAIN`; False when something still blocks. Closing twice is fine."""
        if not self._closed:
            self._closed = True
            self._queue.put(None)
        self._thread.join(DRAIN)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (work := self._queue.get()) is not None:
            try:
                work()
            except Exception:
                traceback.print_exc()  # one failed message must not stop the later ones


class RobotStream:
    """Spreads the samples of a period over the wall time until the next, without blocking the caller."""

    def __init__(self, send: Send, speed: Callable[[], float]) -> None:
        """``send`` is called in the thread of this stream, ``speed`` gives the requested real-time factor."""
        self._send, self._speed = send, speed
        self._waiting: deque[tuple[float, Observation, int]] = deque(maxlen=KEPT)  # due [s], sample, run
        self._changed, self._closed = threading.Condition(), False
        self._thread = threading.Thread(target=self._run, name="robot", daemon=True)
        self._thread.start()

    def follow(self, tick: Tick, run: int) -> None:
        """Take the samples of a period that was just computed."""
        now, samples = time.monotonic(), tick.samples or (tick.observation,)
        step = PERIOD / len(samples) / self._speed()
        first = tick.index * len(samples)
        chosen = [i for i in range(len(samples)) if (first + i) % EVERY == 0] if len(samples) > 1 else [0]
        with self._changed:
            self._waiting.extend((now + i * step, samples[i], run) for i in chosen)
            self._changed.notify()

    def close(self) -> None:
        """End the thread; waiting samples are dropped."""
        with self._changed:
            self._closed = True
            self._changed.notify()
        self._thread.join(1.0)

    def _run(self) -> None:
        while (item := self._next()) is not None:
            try:
                self._send(*item)
            except Exception:
                traceback.print_exc()  # the next one may be sent again

    def _next(self) -> tuple[Observation, int] | None:
        with self._changed:
            while not self._closed:
                if not self._waiting:
                    self._changed.wait()
                    continue
                due, sample, run = self._waiting[0]
                left = due - time.monotonic()
                if left <= 0.0 or (len(self._waiting) > 1 and self._waiting[-1][0] - due > PERIOD / self._speed()):
                    self._waiting.popleft()
                    return sample, run
                self._changed.wait(left)
        return None


PERIOD_WINDOW = 10.0  # [s] of wall time
STAGE_WINDOW = 1.0  # [s]
_PAGE = os.sysconf("SC_PAGE_SIZE")


_OF_SCORE = ("picks", "places", "drops", "path_length", "min_base_clearance", "min_arm_clearance", "min_ee_obstacle")
_NO_SCORE = ScoreMessage(
    picks=0, places=0, drops=0, contacts=[], min_base_clearance=None, min_arm_clearance=None, min_ee_obstacle=None,
    ee_obstacle=None,
)  # fmt: skip


class Metrics:
    """Collects the times of periods; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._periods: deque[tuple[float, float, dict[str, float]]] = deque(maxlen=4000)  # at [s], took [s], stages
        self._last: TickMessage | None = None
        self._overruns = 0

    def note(self, message: TickMessage, took: float) -> None:
        """Note a period that was computed within ``took`` [s]."""
        with self._lock:
            if self._last is None or message.run != self._last.run:
                self._overruns = 0
            self._last = message
            self._overruns += took > PERIOD
            self._periods.append((time.monotonic(), took, message.stage_ms))

    def message(self, status: StatusMessage) -> MetricsMessage:
        """The current message."""
        now = time.monotonic()
        with self._lock:
            last, overruns, periods = self._last, self._overruns, list(self._periods)
        took = [1000.0 * seconds for at, seconds, _ in periods if at >= now - PERIOD_WINDOW]
        stages = [stage_ms for at, _, stage_ms in periods if at >= now - STAGE_WINDOW]
        score = (None if last is None else last.score) or _NO_SCORE
        tasks = [] if last is None else last.tasks
        return as_message(
            status,
            MetricsMessage,
            version=METRICS_VERSION,
            period_ms=_spread(took),
            stage_ms=_means(stages),
            overruns=overruns,
            tasks_done=sum(task.status == "done" for task in tasks),
            tasks_total=len(tasks),
            contacts=len(score.contacts),
            contacts_caused_by_robot=sum(contact.caused_by_robot for contact in score.contacts),
            **{name: getattr(score, name) for name in _OF_SCORE},
            memory_mb=round(memory_mb(), 1),
        )


def _spread(values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(max(values), 3)}


def _means(stages: list[dict[str, float]]) -> dict[str, float]:
    names = {name for stage_ms in stages for name in stage_ms}
    return {name: round(sum(ms.get(name, 0.0) for ms in stages) / len(stages), 3) for name in sorted(names)}


def memory_mb(pid: int | str = "self") -> float:
    """Resident memory of a process [MB]."""
    return int(Path(f"/proc/{pid}/statm").read_text(encoding="ascii").split()[1]) * _PAGE / 1e6


GRID_INTERVAL = 0.25  # [s] the grid is sent on change, at most four times a second
GRID_REFRESH = 2.0  # [s] between repetitions of an unchanged grid, for late subscribers
STATE_WAITING = 400  # messages: at full speed more than a second of them
EVENTS_WAITING = 1000


class Publisher:
    """A Sink that publishes without blocking. Messages that a reader cannot take for seconds are dropped for it."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        status: Callable[[], StatusMessage],
        now: Callable[[], float],
        took: Callable[[], float] = lambda: 0.0,
        idle: Idle,
    ) -> None:
        """``status`` gives the state of the server, ``now`` its clock [s], ``took`` the time of the last period [s].

        ``idle`` is set while queries may be answered.
        """
        self._keys, self._status, self._now, self._took = keys, status, now, took
        self._encode = msgspec.json.Encoder().encode
        self._values, self._telling = LatestValues(session, keys, idle), threading.Lock()
        self.event_log = EventLog(now, self._emit)
        self._watch, self._metrics = EventWatch(self.event_log), Metrics()
        self._values.answer(keys.status, lambda _: self._encode(status()))
        self._values.answer(keys.metrics, lambda _: self._encode(self._metrics.message(status())))
        self._values.answer(keys.event, self.event_log.answer)
        self._state, self._events = Outbox("state", STATE_WAITING), Outbox("events", EVENTS_WAITING)
        self._robot = RobotStream(self._send_robot, lambda: status().speed)
        self._profile: RobotProfile | None = None
        self._encoder: tuple[RobotProfile, RobotEncoder] | None = None
        self._observations = ObservationEncoder()
        self._scan = (-1, -1.0)  # run and stamp of the last sweep sent
        self._sent_map: WorldMap | None = None
        self._sent_run = -1
        self._sent_at = 0.0

    def tick(self, message: TickMessage, tick: Tick, last: bool) -> None:
        """Hand over a period."""
        self._state.post(partial(self._send_tick, message, tick, last, self._took()))

    def scene(self, scene: Scene, run: int) -> None:
        """Hand over the resolved scene and its first run."""
        self._state.post(partial(self._send_scene, scene, run))

    def status(self) -> None:
        """Hand over the current state of the server, from any thread; never an older state after a newer one."""
        with self._telling:
            self._state.post(partial(self._send_status, self._status()))

    def metrics(self) -> None:
        """Hand over the metrics."""
        key, message = self._keys.metrics, self._metrics.message
        self._state.post(lambda: self._values.put(key, self._encode(message(self._status()))))

    def close(self) -> None:
        """Send the rest within `DRAIN`, and withdraw all keys."""
        self._robot.close()
        self._state.close()
        self._events.close()
        self._values.close()

    def _send_tick(self, message: TickMessage, tick: Tick, last: bool, took: float) -> None:
        self._values.put(self._keys.tick, self._encode(message))
        if self._profile is not None and (self._encoder is None or self._encoder[0] != self._profile):
            self._encoder = self._profile, RobotEncoder(self._profile)  # created late, when its imports are loaded
        if not message.preview:
            self._robot.follow(tick, message.run)
        self._send_scan(tick, message.run)
        new_run, age = message.run != self._sent_run, time.monotonic() - self._sent_at
        due = age >= GRID_REFRESH or ((last or new_run or age >= GRID_INTERVAL) and self._changed(tick.map, new_run))
        if due:
            self._sent_map, self._sent_run, self._sent_at = tick.map, message.run, time.monotonic()
            self._values.put(self._keys.grid, grid_bytes(tick.map), self._encode(grid_info(tick.map, message.run)))
        if not message.preview:
            if self._status().plant != "simulated":
                observed = self._observations.message(tick, message.run, self._now())
                self._values.put(self._keys.observations, self._encode(observed))
            self._metrics.note(message, took)
            self._watch.tick(message)

    def _send_scene(self, scene: Scene, run: int) -> None:
        self._profile = scene.robot
        self._values.put(self._keys.scene, self._encode(scene), self._encode(SceneInfo(run=run)))
        self._watch.scene(" ".join(part for part in (scene.name, scene.variant) if part) + f", seed {scene.seed}")

    def _send_status(self, status: StatusMessage) -> None:
        self._values.put(self._keys.status, self._encode(status))
        self._watch.status(status)

    def _send_scan(self, tick: Tick, run: int) -> None:
        """Send the sweeps that are new in this period."""
        for sample in (tick.observation, *tick.samples):
            scan = sample.scan
            if scan is None or self._encoder is None or (run == self._scan[0] and scan.stamp <= self._scan[1]):
                continue
            self._scan = run, scan.stamp
            self._values.put(self._keys.scan, self._encode(self._encoder[1].scan(scan, run, self._now())))

    def _send_robot(self, sample: Observation, run: int) -> None:
        if (encoder := self._encoder) is not None:
            self._values.put(self._keys.robot, self._encode(encoder[1].state(sample, run, self._now())))

    def _emit(self, event: msgspec.Struct) -> None:
        self._events.post(lambda: self._values.put(self._keys.event, self._encode(event)))

    def _changed(self, world: WorldMap, new_run: bool) -> bool:
        sent = self._sent_map
        if sent is None or new_run:
            return True
        return not (np.array_equal(sent.occupied, world.occupied) and np.array_equal(sent.proximity, world.proximity))
