"""`motm-twin robot`: the reference robot, our simulated plant with its referee as a program of its own."""

import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import TYPE_CHECKING, Annotated, Literal

from tyro.conf import FlagCreatePairsOff, Positional, arg

from motm_twin.cli.outputs import write_json
from motm_twin.cli.settings import Seed
from motm_twin.program import BAD_INPUT, FAILED, OK

if TYPE_CHECKING:
    from motm_twin.external.robot_server import RobotServer


@dataclass(frozen=True, kw_only=True)
class LinkSettings:
    """An emulated link between robot and twin; without any of these it is perfect.

    Args:
        latency: Emulated link: delay of each message [s], in each direction.
        jitter: Emulated link: the delay varies by up to this much, either way [s].
        loss: Emulated link: share of messages that are lost, 0 to 1.
        outage: Emulated link: duration of outages [s], in which nothing arrives in either direction.
        every: Emulated link: time [s] in which one outage falls, at a random moment.
        link_seed: Seed of the emulated link.
    """

    latency: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0
    outage: float = 0.0
    every: float = 2.0
    link_seed: int = 0


@dataclass(frozen=True, kw_only=True)
class RobotSettings:
    """The robot's scene, twin and clock.

    Args:
        scene: Shipped scene or path to a scene file; the twin may load another one.
        variant: Named variant of the scene; without it the scene's default.
        seed: Seed of noise and random arrangements; without it the scene's.
        twin: Name of the twin in the Zenoh keys.
        endpoint: Address of the twin's server or of a Zenoh router; the robot waits for it. Without it, that of
            MOTM_ZENOH_CONFIG, or tcp/127.0.0.1:7447.
        clock: real: time passes by itself; shared: it passes as fast as the twin grants it.
        link: Emulated link.
        physics: kinematic, or mujoco: contact dynamics (docs/physics.md).
        json: Write the report to a file, or to standard output with '-'.
        child: For programs that start a robot: end when standard input ends, too, and print nothing about the twin.
    """

    scene: Annotated[Positional[str], arg(metavar="[SCENE]")] = "exp1"
    variant: Annotated[str | None, arg(metavar="NAME")] = None
    seed: Seed = None
    twin: str = "frankie"
    endpoint: Annotated[str | None, arg(metavar="ENDPOINT")] = None
    clock: Literal["real", "shared"] = "real"
    link: Annotated[LinkSettings, arg(name="")] = field(default_factory=LinkSettings)
    physics: Literal["kinematic", "mujoco"] = "kinematic"
    json: Annotated[str, arg(name="json", metavar="FILE|-")] = "-"
    child: FlagCreatePairsOff[bool] = False


def robot(settings: Annotated[RobotSettings, arg(name="")]) -> int:
    """Simulate the robot of a twin that runs with `serve --plant zenoh`, with a referee, in its own process.

    Runs until Ctrl-C or SIGTERM and then prints the referee's counts. Standard error says where it waits for its twin
    and when they have met. Exit code 0: the robot caused no contact; 1: it caused one; 2: bad input.
    """
    from motm_twin.bus.connection import DEFAULT_PORT, LOOPBACK, configured_endpoint
    from motm_twin.bus.processes import leave

    def say(text: str) -> None:
        if not settings.child:
            print(f"motm-twin robot: {text}", file=sys.stderr, flush=True)

    twin = settings.twin
    try:
        leads = configured_endpoint()  # a file that cannot be used is refused in any case
        endpoint = settings.endpoint or leads or f"tcp/{LOOPBACK}:{DEFAULT_PORT}"
        server = _server(settings, endpoint, lambda: say(f"has met the twin {twin!r} at {endpoint}"))
    except ValueError as error:
        print(f"motm-twin robot: {error}", file=sys.stderr)
        return BAD_INPUT
    say(f"waiting for a twin {twin!r} at {endpoint} (motm-twin serve --plant zenoh); Ctrl-C ends it")
    server.run()
    if not server.met:
        say(f"no twin {twin!r} was met at {endpoint}")
    counted = server.robot.report()
    server.close()
    write_json(counted, settings.json)
    leave(FAILED if counted["contacts_caused_by_robot"] or counted["dropped"] else OK)
    return OK


def _server(settings: RobotSettings, endpoint: str, on_met: Callable[[], None]) -> "RobotServer":
    from motm_twin.bus.processes import stop_event
    from motm_twin.external.robot import LinkSpec
    from motm_twin.external.robot_server import RobotServer
    from motm_twin.model.scene_file import load_scene
    from motm_twin.plants import with_plant

    link = asdict(settings.link)
    return RobotServer(
        with_plant(load_scene(settings.scene, settings.variant, settings.seed), settings.physics),
        endpoint,
        twin=settings.twin,
        clock=settings.clock,
        link=LinkSpec(seed=link.pop("link_seed"), **link),
        stop=stop_event(settings.child),  # until all is imported a signal ends the program
        on_met=on_met,
    )
