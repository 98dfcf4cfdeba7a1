"""The twin server as a program: ``python -m motm_twin.server_process exp1 --port 7447``."""

import argparse
import functools
import secrets
import sys
import threading
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from motm_twin.bus.commands import Load
from motm_twin.bus.connection import DEFAULT_PORT, DEFAULT_TWIN, PortTaken, open_member
from motm_twin.bus.data_folder import DEFAULT_FOLDER
from motm_twin.bus.library import FileLibrary, MethodLibrary, TwinSetup
from motm_twin.bus.pacing import refusal
from motm_twin.bus.server import RobotChoice, TwinServer
from motm_twin.external.robot_link import RobotLink
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import SceneError
from motm_twin.model.scene import Scene
from motm_twin.planning.types import SearchBudget
from motm_twin.processes import Reporter, leave, stop_event
from motm_twin.program import BAD_INPUT, freeze_setup, share_arenas

if TYPE_CHECKING:
    from motm_twin.control.method import Method
    from motm_twin.twin import Twin

SEARCH_SECONDS = 0.02  # [s] of wall time for one search of the base; the period is 0.05 s
WATCH = 0.1  # [s] between two checks of the state for the report


def make_twin(scene: Scene, *, budget: SearchBudget, plant: str, method: "Method") -> "Twin":
    """A twin whose searches are bounded by the clock as well; ``plant`` "mujoco": contact dynamics, else kinematic."""
    from motm_twin.plants import with_plant
    from motm_twin.twin import Twin  # slow to import: only once the server listens
    from motm_twin.warm_up import compile_kernels, parts_of, program_clock

    compile_kernels(parts_of(method.parameters, agents=True))
    twin = Twin(with_plant(scene, plant), method=method, budget=budget, clock=program_clock)
    freeze_setup()
    return twin


def make_external_twin(
    robot: RobotLink, scene: Scene, *, budget: SearchBudget, sender: str, method: "Method"
) -> "Twin":
    """A twin of a robot in another program; with a link that only listens, it has no tasks."""
    from motm_twin.external.plant import ZenohPlant
    from motm_twin.twin import Twin
    from motm_twin.warm_up import compile_kernels, parts_of, program_clock

    compile_kernels(parts_of(method.parameters, agents=True))
    scene = msgspec.structs.replace(scene, tasks=()) if robot.listen_only else scene
    plant = ZenohPlant(robot, scene, sender=sender)
    twin = Twin(scene, method=method, budget=budget, clock=program_clock, plant=plant)
    freeze_setup()
    return twin


def reference_tour(scene: Scene) -> float:
    """Time [s] of the reference tour of a scene: for comparison, not a bound."""
    from motm_twin.measures.references import reference_tour_s

    return reference_tour_s(scene)


def main() -> None:
    """Run until a signal or the end of the parent."""
    options = _options()
    share_arenas()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    try:
        library = FileLibrary(options.scene)
        methods = MethodLibrary(options.method)
        first = Load(scene=library.own_name, variant=options.variant, seed=options.seed, method=methods.own_name)
        budget = SearchBudget(seconds=None if options.expansions_only else SEARCH_SECONDS)
        server = TwinServer(
            TwinSetup(
                library=library,
                make_twin=functools.partial(make_twin, budget=budget, plant=options.plant),
                first=first,
                playing=not options.paused,
                hold=options.hold,
                again=options.loop,
                reference_tour=reference_tour,
                methods=methods,
            ),
            port=options.port,
            twin=options.twin,
            data=options.data,
            robot=_robot(options, budget, stop),
            open_bus=options.open_bus,
        )
    except TimeoutError:  # stopped before the router answered
        leave(0)
        return
    except (SceneError, PortTaken, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    report("listening", endpoint=server.endpoint, no_real_time=refusal())
    server.start()
    if options.record is not None:
        server.record(options.record, lambda problem, path: report("record", text=problem or path, ok=not problem))
    reported = ("", "")
    while not stop.wait(WATCH):
        status = server.loop.status()
        if (status.state, status.text) != reported:
            reported = (status.state, status.text)
            report("state", state=status.state, text=status.text)
    server.close()
    leave(0)


def _robot(options: argparse.Namespace, budget: SearchBudget, stop: threading.Event) -> RobotChoice | None:
    """The requested external robot, None: simulated; with ``--connect`` it waits for the router."""
    if options.plant not in ("zenoh", "mirror"):
        return None
    sender = f"twin-{secrets.token_hex(4)}"
    return RobotChoice(
        meet=RobotLink,
        make_twin=functools.partial(make_external_twin, budget=budget, sender=sender),
        mirror=options.plant == "mirror",
        session=None if options.connect is None else open_member(options.connect, stop=stop),
    )


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.server_process", description=__doc__)
    parser.add_argument("scene")
    parser.add_argument("--variant")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--method", default=DEFAULT_METHOD, help="shipped name, or FILE.py:NAME")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="TCP port of Zenoh, 0 takes any free one")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--data", type=Path, default=DEFAULT_FOLDER, help="folder of saved sessions and recordings")
    plants = ("simulated", "mujoco", "zenoh", "mirror")
    parser.add_argument("--plant", choices=plants, default="simulated", help="the robot")
    parser.add_argument("--connect", help="router where the robot is met; without it, at this server")
    parser.add_argument("--record", type=Path, help="MCAP file to record to from the start")
    parser.add_argument("--expansions-only", action="store_true", help="no clock ends a search of the base")
    parser.add_argument("--paused", action="store_true", help="do not play at the start")
    parser.add_argument("--hold", action="store_true", help="wait at the start until a page shows the run")
    parser.add_argument("--loop", action="store_true", help="after a run that nobody drives, start the next seed")
    parser.add_argument("--open-bus", action="store_true", help="anybody on this machine is let in")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
