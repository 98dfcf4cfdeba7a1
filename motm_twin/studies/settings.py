"""Settings of `motm-twin bench` and `paper`; imports no part of the twin, so that the command line stays quick."""

import shlex
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import FlagCreatePairsOff, Positional, arg


@dataclass(frozen=True, kw_only=True)
class BenchSettings:
    """Names of groups and experiments, and their options.

    Args:
        groups: Names of groups of trials or experiments, or all; without one they are listed with their times. Or
            barn, and after it scene files of worlds of that challenge; or people, or tracker, alone.
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
        visits: Page only: pages that come and break off.
        share: Soak, period, task, faults, mismatch, screening and the studies of grasps only: part of the full counts.
        kinds: Faults only: these kinds of faults, or none for trials without one.
        scenes: Faults only: these of exp1, exp1a and exp2.
        situations: People and tracker only: these of the situations among people, as circle or exp2_blind.
        numbers: Screening only: these numbers of docs/parameters.md, or groups, as arm.qp or planning.reach.r_min.
        quick: Growth, anytime, solvers and grasp_rule only: a few points, half a minute.
        plant: simulated: kinematic; mujoco: contact dynamics (docs/physics.md), of groups of trials and experiments.
        worlds: Barn only: number of worlds like those of the challenge, seeds from 0.
        profile: Barn only: limits of the Jackal, nominal or of its controller; without it those of the file.
    """

    groups: Positional[list[str]] = field(default_factory=list)
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
    visits: int = 1000
    share: float = 1.0
    kinds: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    situations: tuple[str, ...] = ()
    numbers: tuple[str, ...] = ()
    quick: FlagCreatePairsOff[bool] = False
    worlds: int | None = None
    profile: Literal["nominal", "controller"] | None = None
    plant: Literal["simulated", "mujoco"] = "simulated"

    @property
    def experiment(self) -> bool:
        """Something was asked for that only experiments have."""
        return bool(self.methods or self.changes or self.retry_failed) or any(
            value is not None for value in (self.trials, self.backend, self.address)
        )


OPTIONS_OF_PLANS = {"quick": " --quick", "default": "", "full": " --full --yes"}  # of `motm-twin paper`, by plan


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """Plan of the report, its folder, and the processes that run it.

    Args:
        out: Folder for everything; trials that are in it are not run again.
        quick: In less than five minutes, to see that it works: one trial of every method and modification on Experiment
            1, of four methods on 1a, of motm and fast on 2; one seed of one level of every error and of late grasps;
            one value of every swept parameter.
        full: Fifty seeds everywhere; says how long, and needs --yes, but not to go on.
        yes: Start also what takes hours.
        only: Only these figures and tables, with the trials that they are made from.
        draw: Run no experiment: draw what is in the folder, from whichever plan and state of the source.
        no_page: No photographs of the page.
        workers: Processes.
        backend: loky: processes here; ray: a cluster (extra [cluster]).
        address: Of the Ray cluster.
        retry_failed: Run trials again that were without success.
    """

    out: Annotated[Path, arg(metavar="DIR")] = Path("out/paper")
    quick: FlagCreatePairsOff[bool] = False
    full: FlagCreatePairsOff[bool] = False
    yes: FlagCreatePairsOff[bool] = False
    only: Annotated[tuple[str, ...], arg(metavar="NAME")] = ()
    draw: FlagCreatePairsOff[bool] = False
    no_page: FlagCreatePairsOff[bool] = False
    workers: int = 2
    backend: Literal["loky", "ray"] = "loky"
    address: str | None = None
    retry_failed: FlagCreatePairsOff[bool] = False

    @property
    def plan(self) -> str:
        """Name of the plan."""
        return "quick" if self.quick else "full" if self.full else "default"

    def command(self) -> str:
        """The same as a command."""
        run = f"{OPTIONS_OF_PLANS[self.plan]} --workers {self.workers}"
        run += f" --backend {self.backend}" if self.backend != "loky" else ""
        run += f" --address {self.address}" if self.address else ""
        run += " --retry-failed" if self.retry_failed else ""
        only = f" --only {' '.join(self.only)}" if self.only else ""
        return f"motm-twin paper{' --draw' if self.draw else run} --out {shlex.quote(str(self.out))}{only}"
