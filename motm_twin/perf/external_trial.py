"""One trial with the robot in another process, on a shared clock, over a link that may be bad."""

import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from motm_twin.bus.connection import LOOPBACK, free_port, open_server
from motm_twin.control.tick import Tick
from motm_twin.external.emulator import LinkSpec
from motm_twin.external.plant import ZenohPlant
from motm_twin.external.robot_link import RobotLink
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import find_method
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.trial import run_scene


@contextmanager
def external_robot(scene: Scene, link: LinkSpec, *, clock: str = "shared") -> Iterator[ZenohPlant]:
    """A reference robot in a process of its own, and the plant that drives it once it has come up."""
    port = free_port()
    session = open_server(port)
    arguments = ["exp1", "--endpoint", f"tcp/{LOOPBACK}:{port}", "--clock", clock, "--child"]
    for name in ("latency", "jitter", "loss", "outage", "every", "seed"):
        arguments += [f"--{'link-seed' if name == 'seed' else name}", str(getattr(link, name))]
    process = subprocess.Popen(  # noqa: S603 - our own module
        [sys.executable, "-m", "motm_twin.external.cli_robot", *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
    )
    robot = RobotLink(session, "frankie")
    try:
        yield ZenohPlant(robot, scene)
    finally:
        process.terminate()
        process.wait(30.0)
        robot.close()
        session.close()


def run_external(
    name: str,
    variant: str | None,
    link: LinkSpec,
    on_tick: Callable[[Tick], None] | None = None,
    method: str = DEFAULT_METHOD,
) -> dict[str, Any]:
    """A trial; the dictionary of `motm_twin.trial.run_scene`."""
    scene = load_scene(name, variant)
    with external_robot(scene, link) as plant:
        return run_scene(scene, on_tick=on_tick, plant=plant, method=find_method(method))
