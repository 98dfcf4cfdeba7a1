"""Settings of `motm-twin bench`; imports no part of the twin, so that the command line stays quick."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from tyro.conf import FlagCreatePairsOff, Positional


@dataclass(frozen=True, kw_only=True)
class BenchSettings:
    """Names of groups and experiments, and their options.

    Args:
        groups: Names of groups of trials or experiments, or all groups; or page (needs Chromium), bus, soak, scale,
            efficiency, growth, anytime, solvers, task, faults, mismatch, surprise. Or barn, and after it scene files
            of worlds of that challenge.
        methods: Names of methods, or all, or ablations; or FILE.py:NAME of your own.
        trials: Number of random arrangements, seeds from 0; without it the ten published ones.
        changes: Fields of the resolved scene, as noise.lidar_range_sd=0.05, detections=named or agents.*.speed=0.6.
        workers: Processes.
        backend: loky, processes of this machine; ray, a Ray cluster (extra "cluster").
        address: Of the Ray cluster, or auto.
        retry_failed: Run trials again that were without success.
        out: Folder of the JSON results.
        seconds: Page, bus and scale: time of each measurement.
        minutes: Page only: time over which memory is watched.
        share: Soak, period, task, faults and mismatch only: part of the full counts.
        kinds: Faults only: these kinds of faults, or none for trials without one.
        scenes: Faults only: these of exp1, exp1a and exp2.
        quick: Growth, anytime and solvers only: a few points, half a minute.
        worlds: Barn only: number of worlds like those of the challenge, seeds from 0.
        profile: Barn only: limits of the Jackal, nominal or of its controller; without it those of the file.
    """

    groups: Positional[list[str]] = field(default_factory=lambda: ["all"])
    methods: tuple[str, ...] = ()
    trials: int | None = None
    changes: tuple[str, ...] = ()
    workers: int = 2
    backend: Literal["loky", "ray"] | None = None
    address: str | None = None
    retry_failed: FlagCreatePairsOff[bool] = False
    out: Path = Path("out/bench")
    seconds: float = 60.0
    minutes: float = 3.0
    share: float = 1.0
    kinds: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    quick: FlagCreatePairsOff[bool] = False
    worlds: int | None = None
    profile: Literal["nominal", "controller"] | None = None

    @property
    def experiment(self) -> bool:
        """Something was asked for that only experiments have."""
        return bool(self.methods or self.changes or self.retry_failed) or any(
            value is not None for value in (self.trials, self.backend, self.address)
        )
