"""Options of the commands, with their help. Imports no part of the twin, so that the command line stays quick."""

import shlex
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import FlagCreatePairsOff, Positional, UseAppendAction, arg
from tyro.constructors import PrimitiveConstructorSpec

from motm_twin.methods import DEFAULT_METHOD


def _whole_number(words: list[str]) -> int:
    try:
        return int(words[0])
    except ValueError:
        raise ValueError(f"{words[0]!r} is no whole number: give one from 0 on, such as 3") from None


Seed = Annotated[
    int | None,
    PrimitiveConstructorSpec(
        nargs=1,
        metavar="INT",
        instance_from_str=_whole_number,
        is_instance=lambda value: value is None or isinstance(value, int),
        str_from_instance=lambda value: [str(value)],
    ),
]


_Words = Annotated[
    str,
    PrimitiveConstructorSpec[Any](
        nargs="*",
        metavar="[STR [STR ...]]",
        instance_from_str=lambda words: words,
        is_instance=lambda value: isinstance(value, str),
        str_from_instance=lambda value: [value],
    ),
]
Words = UseAppendAction[tuple[_Words, ...]]  # only in subclasses of AddingUp


class AddingUp:
    """Settings whose options of several words add up when they are repeated: --twin a1 --twin a2, or --twin a1 a2."""

    def __post_init__(self) -> None:
        """Join the lists of words; there is one for each time that an option was given."""
        for each in fields(self):  # type: ignore[arg-type] - its subclasses are dataclasses
            given = getattr(self, each.name)
            if isinstance(given, tuple) and any(isinstance(words, list) for words in given):
                object.__setattr__(self, each.name, tuple(word for words in given for word in words))


Changes = Annotated[UseAppendAction[tuple[str, ...]], arg(name="set", metavar="NAME=VALUE")]


@dataclass(frozen=True, kw_only=True)
class SceneSettings:
    """The scene.

    Args:
        scene: Shipped scene (`motm-twin scene list`), path to a scene file, generated:SEED@DIFFICULTY or barn:SEED.
        variant: Named variant of the scene; without it the scene's default.
        seed: Seed of noise and random arrangements; without it the scene's.
    """

    scene: Annotated[Positional[str], arg(metavar="[SCENE]")] = "exp1"
    variant: Annotated[str | None, arg(metavar="NAME")] = None
    seed: Seed = None


@dataclass(frozen=True, kw_only=True)
class RunSettings(SceneSettings):
    """Scene, method and files of a headless run.

    Args:
        json: Write the report to a file, or to standard output with '-'.
        save: Write the session to a new file, for `rerun` and `what-if`; after Ctrl-C it holds the run so far.
        plot: Write a figure (.png, .svg or .pdf): speed along the path, and each leg beside the reference tour.
        method: fast (ours), motm (the paper's), another of docs/method.md, or FILE.py:NAME of your own.
        plant: simulated: kinematic; mujoco: contact dynamics (docs/physics.md).
        changes: Set a parameter (docs/zenoh.md lists them) to a value, on top of the method's; may be repeated.
    """

    json: Annotated[str | None, arg(name="json", metavar="FILE|-")] = None
    save: Annotated[str | None, arg(metavar="FILE")] = None
    plot: Annotated[Path | None, arg(metavar="FILE")] = None
    method: str = DEFAULT_METHOD
    plant: Literal["simulated", "mujoco"] = "simulated"
    changes: Changes = ()


@dataclass(frozen=True, kw_only=True)
class PageSettings(AddingUp):
    """Address of the page, and the people who may open it.

    Args:
        port: TCP port of the page; 0 takes any free one.
        host: Address to listen on.
        token: Secret of at least 32 characters that the page asks for (or set MOTM_TOKEN, which `ps` does not show).
            Without it, your user's own secret is used, and the printed address contains it.
        no_token: Let anybody with an account on this machine look and drive. On loopback only.
        names: Other host names under which browsers may open the page, such as that of a proxy.
        visitors: Number of pages that may be open at once.
    """

    port: int = 8080
    host: str = "127.0.0.1"
    token: Annotated[str | None, arg(metavar="SECRET")] = None
    no_token: FlagCreatePairsOff[bool] = False
    names: Annotated[Words, arg(name="name", metavar="NAME ...")] = ()
    visitors: int = 50

    def arguments(self, endpoint: str, twin: str) -> list[str]:
        """Arguments of `ui.viewer`."""
        found = ["--endpoint", endpoint, "--twin", twin, "--host", self.host, "--port", str(self.port)]
        found += ["--visitors", str(self.visitors), *(["--no-token"] if self.token is None else [])]
        return found + [word for name in self.names for word in ("--name", name)]


@dataclass(frozen=True, kw_only=True)
class ServeSettings(SceneSettings):
    """Scene, robot and page of a served twin.

    Args:
        page: Page of the twin.
        headless: Start only the Zenoh server, no page.
        zenoh_port: TCP port of Zenoh, on loopback; 0 takes any free one. Your own programs may connect.
        open_bus: Let anybody with an account on this machine look and drive over Zenoh.
        record: New MCAP file to record to (docs/recording.md).
        twin: Name of the twin in the Zenoh keys.
        secure: Folder made by `motm-twin security`: also listen, with TLS, for the people in it on other machines.
        ros2: Publish ROS 2 topics too, for zenoh-bridge-ros2dds (bridge) or rmw_zenoh (rmw).
        data: Folder for the files of the commands save and record; without it ./recordings.
        plant: simulated: kinematic; mujoco: contact dynamics (docs/physics.md); zenoh: drive a robot in another program
            (docs/external_robot.md); mirror: only show it.
        connect: Zenoh router where twin and robot meet (tcp/127.0.0.1:7450); without it they meet at this server.
        method: fast (ours), motm (the paper's), another of docs/method.md, or FILE.py:NAME of your own; the page can
            change it.
        loop: When a run has ended and nobody drives, start the next seed after 8 s.
        paused: Stay paused at the start until somebody plays.
        play: Start at once. Without it a run waits at its start until the first page shows it.
        expansions_only: Bound searches by expansions alone, not by the clock: the run equals `motm-twin run` bit for
            bit, however slow the machine is.
    """

    page: Annotated[PageSettings, arg(name="")] = field(default_factory=PageSettings)
    headless: bool = False
    zenoh_port: int = 7447
    open_bus: FlagCreatePairsOff[bool] = False
    record: Annotated[Path | None, arg(metavar="FILE")] = None
    twin: str = "frankie"
    secure: Annotated[str | None, arg(metavar="DIR")] = None
    ros2: Literal["bridge", "rmw"] | None = None
    data: Annotated[Path | None, arg(metavar="DIR")] = None
    plant: Literal["simulated", "mujoco", "zenoh", "mirror"] = "simulated"
    connect: Annotated[str | None, arg(metavar="ENDPOINT")] = None
    method: str = DEFAULT_METHOD
    loop: FlagCreatePairsOff[bool] = False
    paused: FlagCreatePairsOff[bool] = False
    play: FlagCreatePairsOff[bool] = False
    expansions_only: FlagCreatePairsOff[bool] = False

    @property
    def external(self) -> bool:
        """True when the robot is in another program."""
        return self.plant in ("zenoh", "mirror")

    def server_arguments(self, zenoh_port: int) -> list[str]:
        """Arguments of `server_process`; ``zenoh_port``: the actual, free port."""
        given = {
            "--port": zenoh_port, "--twin": self.twin, "--variant": self.variant, "--seed": self.seed,
            "--method": self.method, "--plant": self.plant, "--connect": self.connect, "--data": self.data,
            "--record": self.record and self.record.resolve(),
        }  # fmt: skip
        words = [word for name, value in given.items() if value is not None for word in (name, str(value))]
        hold = not (self.play or self.headless or self.external)
        flags = {
            "--open-bus": self.open_bus, "--expansions-only": self.expansions_only, "--loop": self.loop,
            "--paused": self.paused, "--hold": hold,
        }  # fmt: skip
        return [self.scene, *words, *(name for name, on in flags.items() if on)]


@dataclass(frozen=True, kw_only=True)
class ReplaySettings:
    """A recording, its speed, and its page.

    Args:
        file: An MCAP recording. (For a saved session use `motm-twin rerun`.)
        page: Page of the recording.
        speed: Playback speed, 1/8 to 8; 1 is real time.
        loop: Begin again at the end.
        paused: Stay paused at the start until somebody plays.
        headless: Publish on Zenoh only, no page.
        zenoh_port: TCP port of Zenoh, on loopback; 0 takes any free one. Your own programs may connect.
        open_bus: Let anybody with an account on this machine look over Zenoh.
        twin: Name in the Zenoh keys.
    """

    file: Annotated[Positional[str], arg(metavar="FILE")]
    page: Annotated[PageSettings, arg(name="")] = field(default_factory=PageSettings)
    speed: float = 1.0
    loop: FlagCreatePairsOff[bool] = False
    paused: FlagCreatePairsOff[bool] = False
    headless: FlagCreatePairsOff[bool] = False
    zenoh_port: int = 7447
    open_bus: FlagCreatePairsOff[bool] = False
    twin: str = "frankie"

    def server_arguments(self, zenoh_port: int) -> list[str]:
        """Arguments of `record.player_server`; ``zenoh_port``: the actual, free port."""
        words = [self.file, "--speed", str(self.speed), "--port", str(zenoh_port), "--twin", self.twin]
        flags = {"--loop": self.loop, "--paused": self.paused, "--open-bus": self.open_bus}
        return words + [name for name, on in flags.items() if on]


@dataclass(frozen=True, kw_only=True)
class BenchSettings(AddingUp):
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
    methods: Annotated[Words, arg(metavar="METHOD ...")] = ()
    trials: Annotated[int | None, arg(metavar="INT")] = None
    changes: Annotated[Words, arg(metavar="FIELD=VALUE ...")] = ()
    workers: int = 2
    backend: Literal["loky", "ray"] | None = None
    address: Annotated[str | None, arg(metavar="ADDRESS")] = None
    retry_failed: FlagCreatePairsOff[bool] = False
    out: Annotated[Path, arg(metavar="DIR")] = Path("out/bench")
    seconds: float = 60.0
    minutes: float = 3.0
    visits: int = 1000
    share: float = 1.0
    kinds: Words = ()
    scenes: Words = ()
    situations: Words = ()
    first: int = 0
    numbers: Words = ()
    quick: FlagCreatePairsOff[bool] = False
    worlds: int | None = None
    profile: Literal["nominal", "controller"] | None = None
    plant: Literal["simulated", "mujoco"] = "simulated"

    @property
    def experiment(self) -> bool:
        """True when an option was given that only experiments have."""
        return bool(self.methods or self.changes or self.retry_failed) or any(
            value is not None for value in (self.trials, self.backend, self.address)
        )


@dataclass(frozen=True, kw_only=True)
class PaperSettings(AddingUp):
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
    only: Annotated[Words, arg(metavar="NAME")] = ()
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
        """Command with these settings."""
        from motm_twin.studies.paper.data import OPTIONS_OF_PLANS

        run = f"{OPTIONS_OF_PLANS[self.plan]} --workers {self.workers}"
        run += f" --backend {self.backend}" if self.backend != "loky" else ""
        run += f" --address {self.address}" if self.address else ""
        run += " --retry-failed" if self.retry_failed else ""
        only = f" --only {' '.join(self.only)}" if self.only else ""
        return f"motm-twin paper{' --draw' if self.draw else run} --out {shlex.quote(str(self.out))}{only}"
