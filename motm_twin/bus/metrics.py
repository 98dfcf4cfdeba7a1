"""Health of the run, once a second: times of the periods, and the referee's count."""

import os
import threading
import time
from collections import deque
from pathlib import Path

import numpy as np

from motm_twin.bus.messages import METRICS_VERSION, MetricsMessage, StatusMessage, TickMessage
from motm_twin.model.period import PERIOD

PERIOD_WINDOW = 10.0  # [s] of wall time
STAGE_WINDOW = 1.0  # [s]
_PAGE = os.sysconf("SC_PAGE_SIZE")


class Metrics:
    """Collects what the periods took; safe to use from several threads."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._periods: deque[tuple[float, float, dict[str, float]]] = deque(maxlen=4000)  # at [s], took [s], stages
        self._last: TickMessage | None = None
        self._overruns = 0

    def note(self, message: TickMessage, took: float) -> None:
        """A period that was computed within ``took`` [s]."""
        with self._lock:
            if self._last is None or message.run != self._last.run:
                self._overruns = 0
            self._last = message
            self._overruns += took > PERIOD
            self._periods.append((time.monotonic(), took, message.stage_ms))

    def message(self, status: StatusMessage) -> MetricsMessage:
        """The message of now."""
        now = time.monotonic()
        with self._lock:
            last, overruns, periods = self._last, self._overruns, list(self._periods)
        took = [1000.0 * seconds for at, seconds, _ in periods if at >= now - PERIOD_WINDOW]
        stages = [stage_ms for at, _, stage_ms in periods if at >= now - STAGE_WINDOW]
        score = None if last is None else last.score
        contacts = [] if score is None else score.contacts
        tasks = [] if last is None else last.tasks
        return MetricsMessage(
            version=METRICS_VERSION,
            run=status.run,
            server_time=status.server_time,
            time=status.time,
            state=status.state,
            speed=status.speed,
            actual_speed=status.actual_speed,
            period_ms=_spread(took),
            stage_ms=_means(stages),
            overruns=overruns,
            tasks_done=sum(task.status == "done" for task in tasks),
            tasks_total=len(tasks),
            picks=0 if score is None else score.picks,
            places=0 if score is None else score.places,
            drops=0 if score is None else score.drops,
            contacts=len(contacts),
            contacts_caused_by_robot=sum(contact.caused_by_robot for contact in contacts),
            path_length=0.0 if score is None else score.path_length,
            min_base_clearance=None if score is None else score.min_base_clearance,
            min_arm_clearance=None if score is None else score.min_arm_clearance,
            min_ee_obstacle=None if score is None else score.min_ee_obstacle,
            reference_tour=status.reference_tour,
            memory_mb=_memory_mb(),
        )


def _spread(values: list[float]) -> dict[str, float]:
    if not values:
        return {}
    p50, p99 = np.percentile(values, [50, 99])
    return {"p50": round(float(p50), 3), "p99": round(float(p99), 3), "max": round(max(values), 3)}


def _means(stages: list[dict[str, float]]) -> dict[str, float]:
    names = {name for stage_ms in stages for name in stage_ms}
    return {name: round(sum(ms.get(name, 0.0) for ms in stages) / len(stages), 3) for name in sorted(names)}


def _memory_mb() -> float:
    """Resident memory of this process."""
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    return round(pages * _PAGE / 1e6, 1)
