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
        groups: Names of groups or experiments, or all; without a name they are listed with their times. Or barn,
            followed by scene files of worlds of that challenge; or people, or tracker, alone.
        methods: Methods to compare, or all, or ablations; FILE.py:NAME for your own.
        trials: Number of random arrangements, seeds from 0; without it the ten published arrangements.
        changes: Change fields of the scene: noise.lidar_range_sd=0.05, detections=named, agents.*.speed=0.6.
        workers: Processes.
        backend: loky, processes of this machine; ray, a Ray cluster (extra "cluster").
        address: Of the Ray cluster, or auto.
        retry_failed: Run failed trials again.
        out: Folder of the JSON results.
        seconds: Page, bus and scale: time of each measurement [s].
        minutes: Page only: time over which memory is watched [min].
        visits: Page only: number of pages that connect and drop.
        share: Soak, period, task, faults, mismatch, screening and the studies of grasps only: part of the full counts.
        kinds: Faults only: kinds of faults; none for trials without one.
        scenes: Faults only: some of exp1, exp1a and exp2.
        situations: People and tracker only: some of the situations among people, such as circle or exp2_blind.
        first: People only: seed of the first trial; others follow it.
        numbers: Screening only: numbers of docs/parameters.md, or groups, such as arm.qp or planning.reach.r_min.
        quick: Growth, anytime, solvers and grasp_rule only: a few points, half a minute.
        plant: simulated: kinematic; mujoco: contact dynamics (docs/physics.md), for groups of trials and experiments.
        worlds: Barn only: number of worlds like those of the challenge, seeds from 0.
        profile: Barn only: limits of the Jackal, nominal or of its controller; without it those of the file.
    """

    groups: Annotated[Positional[list[str]], arg(metavar="[GROUP ...]")] = field(default_factory=list)
    methods: Annotated[tuple[str, ...], arg(metavar="METHOD ...")] = ()
    trials: Annotated[int | None, arg(metavar="INT")] = None
    changes: Annotated[tuple[str, ...], arg(metavar="FIELD=VALUE ...")] = ()
    workers: int = 2
    backend: Literal["loky", "ray"] | None = None
    address: Annotated[str | None, arg(metavar="ADDRESS")] = None
    retry_failed: FlagCreatePairsOff[bool] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("out/bench")
    seconds: float = 60.0
    minutes: float = 3.0
    visits: int = 1000
    share: float = 1.0
    kinds: tuple[str, ...] = ()
    scenes: tuple[str, ...] = ()
    situations: tuple[str, ...] = ()
    first: int = 0
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
        quick: A check of less than five minutes: one trial of every method and modification on Experiment 1, of four
            methods on 1a, of motm and fast on 2; one seed of one level of every error and of late grasps; one value of
            every swept parameter.
        full: Fifty seeds everywhere. Prints how long that takes, and needs --yes to start, but not to resume.
        yes: Start plans that take hours.
        only: Make these figures and tables only, with the trials that they are made from.
        draw: Run no experiment: draw the trials in the folder, whatever plan and source they are from.
        no_page: Leave out the screenshots of the page.
        workers: Number of processes.
        backend: loky: processes of this machine; ray: a Ray cluster (extra [cluster]).
        address: Address of the Ray cluster.
        retry_failed: Run failed trials again.
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
    address: Annotated[str | None, arg(metavar="ADDRESS")] = None
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
