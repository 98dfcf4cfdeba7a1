"""`serve --plant zenoh` with robots that come, go and come back; and the example of a robot that shares no code."""

import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from meeting import Router, driven, running_robot, server_for_a_robot, until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Branch, Load, Pause, Refused, Speed, Step
from motm_twin.bus.messages import StatusMessage, TickMessage
from motm_twin.bus.server import TwinServer
from motm_twin.client import connect
from motm_twin.model.scene import Scene

SKELETON = Path(__file__).parents[2] / "examples" / "robot_skeleton.py"


def status(client: TwinClient) -> StatusMessage:
    now = client.status()
    assert now is not None
    return now


def tick(client: TwinClient) -> TickMessage:
    now = client.tick()
    assert now is not None
    return now


def robot_process(endpoint: str) -> subprocess.Popen[bytes]:
    arguments = ["exp1", "--variant", "trial1", "--endpoint", endpoint]
    return subprocess.Popen([sys.executable, "-m", "motm_twin", "robot", *arguments], stdout=subprocess.PIPE)


@pytest.fixture
def served(tmp_path: Path, router: Router) -> Iterator[TwinServer]:
    """A server whose robot is met at a router of its own."""
    with server_for_a_robot(tmp_path, session=router.session) as server:
        yield server


def test_the_robot_is_waited_for_driven_and_found_again_after_it_was_killed(served: TwinServer, router: Router) -> None:
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and status(client).text.startswith("waiting for robot"))
        assert status(client).plant == "zenoh"
        first = robot_process(router.endpoint)
        second = None
        try:
            until(lambda: client.tick() and tick(client).index > 20)
            assert "real clock" in status(client).plant_text
            refused = client.command(Branch(index=3))
            assert "can not go back" in refused.reason
            assert "runs by itself" in client.command(Speed(factor=2.0)).reason
            assert client.command(AddObstacle(name="box", x=0.0, y=-2.0)).ok
            until(lambda: [body.name for body in tick(client).obstacles] == ["box"])
            first.kill()
            until(lambda: "nothing is heard of it" in status(client).text)
            stood = tick(client)
            assert re.match("stopped: (the newest|scan rejected: it is .* old)", stood.stop_reason), stood.stop_reason
            second = robot_process(router.endpoint)
            until(lambda: tick(client).index > stood.index + 10 and not tick(client).stop_reason)
            assert tick(client).run == stood.run
            second.send_signal(signal.SIGTERM)
            report, _ = second.communicate(timeout=30.0)
            assert b'"contacts": []' in report
        finally:
            for process in (first, second):
                if process is not None:
                    process.kill()
                    process.communicate()


def test_a_reset_puts_a_simulated_robot_back_to_the_start(served: TwinServer, router: Router, scene: Scene) -> None:
    from motm_twin.bus.commands import Reset

    with running_robot(router, scene, clock="shared") as robot, TwinClient(served.endpoint) as client:
        until(lambda: client.status() and client.tick() and tick(client).index > 5)
        before, life = status(client).run, robot.robot.life
        assert client.command(Reset()).ok
        until(lambda: (now := client.tick()) is not None and now.run > before and now.index > 2)
        assert robot.robot.life != life


def test_without_a_robot_a_mirror_is_not_reset_and_a_new_run_is_not_waited_for(tmp_path: Path, router: Router) -> None:
    for mirror in (True, False):
        with (
            server_for_a_robot(tmp_path, session=router.session, mirror=mirror) as server,
            connect(server.endpoint) as twin,
        ):
            until(lambda: (now := twin.status()) is not None and now.text.startswith("waiting for robot"))
            if mirror:
                with pytest.raises(Refused, match="a mirror only shows the robot"):
                    twin.reset()
            else:
                assert twin.reset().ok
            assert twin.seed(3).ok  # the run has begun, and there is no first period
            assert twin.latest_tick() is None


def test_a_paused_twin_shows_the_robot_as_soon_as_it_is_there(served: TwinServer, router: Router, scene: Scene) -> None:
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and status(client).text.startswith("waiting for robot"))
        assert client.command(Pause()).ok
        assert client.tick() is None
        with running_robot(router, scene, clock="shared"):
            until(lambda: client.tick() is not None)
            run = tick(client).run
            assert client.command(Load(scene="exp1", variant="trial1", seed=3)).ok
            until(lambda: tick(client).run > run)
            until(lambda: status(client).state == "paused")
            assert tick(client).index == 0
            assert client.command(Step(count=2)).ok
            until(lambda: tick(client).index == 2)


def test_a_paused_twin_finds_a_real_robot_and_moves_nothing(served: TwinServer, router: Router, scene: Scene) -> None:
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and status(client).text.startswith("waiting for robot"))
        assert client.command(Pause()).ok
        with running_robot(router, scene, clock="real") as robot:
            until(lambda: "real clock" in status(client).plant_text)
            until(lambda: robot.robot.report()["time_s"] > 2.0)
            assert client.tick() is None and robot.robot.report()["path_length_m"] == 0.0
            assert client.command(Step()).ok
            until(lambda: client.tick() is not None)


@pytest.mark.parametrize("clock", [(), ("--shared",)])
def test_the_skeleton_of_a_robot_is_driven(router: Router, scene: Scene, clock: tuple[str, ...]) -> None:
    process = subprocess.Popen([sys.executable, str(SKELETON), router.endpoint, "frankie", *clock])
    try:
        with driven(router, scene) as twin:
            start = twin.advance().observation.pose
            until(lambda: abs(twin.advance().observation.pose[:2] - start[:2]).max() > 0.1)
            assert twin.plant.truth() is None
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0  # Ctrl-C ends it, also with Zenoh's threads
    finally:
        process.kill()
        process.wait()
