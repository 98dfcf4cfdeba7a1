"""A robot that reports what was recorded."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from motm_twin.bus.observations import DetectionSample, ObservationsMessage, Sample, ScanSample
from motm_twin.model.edits import WorldEdit
from motm_twin.model.geometry import Array
from motm_twin.model.plant import Actuation, Detection, Observation, Scan
from motm_twin.model.scene import PlanarPose, Scene, Task


class RecordedPlant:
    """A robot that reports what was recorded, whatever it is told. Takes edits of the world without an effect."""

    mirror = False
    shared = True

    def __init__(self, messages: Iterable[ObservationsMessage]) -> None:
        """``messages``: of one run from its first period on, without a gap; ValueError else."""
        self.periods = 0  # that it reports
        self._samples: list[Observation] = []
        self._restarts: set[int] = set()  # first sample of each period before which control had been away
        scan, detections = None, ()
        for expected, message in enumerate(messages):
            if message.index != expected:
                raise ValueError(f"the observations of period {expected} are missing: they go on with {message.index}")
            if message.restarted:
                self._restarts.add(len(self._samples))
            for sample in message.samples:
                _check(sample, expected)
                scan = scan if sample.scan is None else _scan(sample.scan)
                if sample.detections is not None:
                    detections = tuple(_detection(one) for one in sample.detections)
                self._samples.append(_observation(sample, scan, detections))
            self.periods = expected + 1
        self._at = 0

    def begin(self, scene: Scene) -> None:
        """From the first sample on."""
        self._at = 0

    def observe(self) -> Observation:
        """The sample of now; ValueError after the last one."""
        if self._at >= len(self._samples):
            raise ValueError(f"the recording has {len(self._samples)} samples: there is no other")
        return self._samples[self._at]

    def command(self, actuation: Actuation) -> None:
        """Without an effect: what the robot did is known."""

    def step(self, dt: float) -> None:
        """On to the next sample."""
        self._at += 1

    def truth(self) -> None:
        """Nobody knows."""

    def rehearsal(self) -> "RecordedPlant":
        """Every edit that was accepted is again."""
        return self

    def accept(self, edit: WorldEdit) -> None:
        """As above."""

    def apply(self, edit: WorldEdit) -> None:
        """Its effect is in what the robot saw."""

    def expect_tasks(self, tasks: Sequence[Task]) -> None:
        """There is no referee."""

    def expect_map(self, announced: Mapping[str, PlanarPose]) -> None:
        """There is no referee."""

    def ready(self) -> bool:
        """There is another sample."""
        return self._at < len(self._samples)

    def text(self) -> str:
        """What it is."""
        return f"a recorded robot: {len(self._samples)} samples"

    def interrupted(self) -> bool:
        """Whether control was away before the period that begins now."""
        return self._at in self._restarts


def _array(values: Sequence[float | None]) -> Array:
    return np.array([np.inf if value is None else value for value in values], dtype=float)


def _arrays(sample: msgspec.Struct, **others: Any) -> dict[str, Any]:
    names = [name for name in sample.__struct_fields__ if name not in others]
    values = {name: getattr(sample, name) for name in names}
    return {name: _array(value) if isinstance(value, list) else value for name, value in values.items()} | others


_LENGTHS = {"pose": 3, "odometry": 3, "twist": 2, "q": 7, "dq": 7}
_LENGTHS_SEEN = {"p_base": 3, "odometry": 3}
_LARGEST = 1e6  # of any number of a pose, a joint or a rate: what is more was not measured


def _check(sample: Sample, period: int) -> None:
    """Raise ValueError for numbers that no robot reports: a recording may come from anybody. Control checks scans."""
    seen = [(part, _LENGTHS_SEEN) for part in sample.detections or ()]
    for part, lengths in [(sample, _LENGTHS), *seen]:
        for name, length in lengths.items():
            values = getattr(part, name)
            if len(values) != length or any(abs(value) > _LARGEST for value in values):
                raise ValueError(f"period {period}: {name} has {len(values)} numbers, or one that cannot be")
    if not abs(sample.time) <= _LARGEST or not abs(sample.gripper_width) <= 1.0:
        raise ValueError(f"period {period}: its time or the gripper's width cannot be")


def _scan(sample: ScanSample) -> Scan:
    return Scan(**_arrays(sample))


def _detection(sample: DetectionSample) -> Detection:
    return Detection(**_arrays(sample))


def _observation(sample: Sample, scan: Scan | None, detections: tuple[Detection, ...]) -> Observation:
    return Observation(**_arrays(sample, scan=scan, detections=detections))
