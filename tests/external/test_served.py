"""`serve --plant zenoh`, `motm-twin robot` as a person sees it, and the page and the skeleton that describe them."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import msgspec
import pytest
from meeting import driven, running_robot, server_for_a_robot
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Branch, Load, Pause, Refused, Reset, Speed, Step
from motm_twin.bus.connection import LOOPBACK, SHIPPED, VARIABLE, PlantKeys, free_port
from motm_twin.bus.plant_messages import ScanData
from motm_twin.bus.schemas import PLANT_MESSAGES
from motm_twin.client import connect
from motm_twin.external.plant import scan_of
from motm_twin.model.profile import Lidar
from motm_twin.perception.scan import CheckedScan, RefusedScan, check_scan

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "external_robot.md").read_text(encoding="utf-8")
SKELETON = ROOT / "examples" / "robot_skeleton.py"
STATE = "motm/frankie/plant/state"


@pytest.fixture
def served(tmp_path, router):
    """A server whose robot is met at a router of its own."""
    with server_for_a_robot(tmp_path, session=router.session) as server:
        yield server


def test_the_robot_is_waited_for_driven_and_found_again_after_it_was_killed(served, router):
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and client.status().text.startswith("waiting for robot"))
        assert client.status().plant == "zenoh"
        robots = []

        def robot():
            robots.append(started("--variant", "trial1", "--endpoint", router.endpoint))
            return robots[-1]

        first = robot()
        try:
            until(lambda: client.tick() and client.tick().index > 20)
            assert "real clock" in client.status().plant_text
            refused = client.command(Branch(index=3))
            assert "can not go back" in refused.reason
            assert "runs by itself" in client.command(Speed(factor=2.0)).reason
            assert client.command(AddObstacle(name="box", x=0.0, y=-2.0)).ok
            until(lambda: [body.name for body in client.tick().obstacles] == ["box"])
            first.kill()
            until(lambda: "nothing is heard of it" in client.status().text)
            stood = client.tick()
            assert re.match("stopped: (the newest|scan rejected: it is .* old)", stood.stop_reason), stood.stop_reason
            second = robot()
            until(lambda: client.tick().index > stood.index + 10 and not client.tick().stop_reason)
            assert client.tick().run == stood.run
            second.send_signal(signal.SIGTERM)
            report, _ = second.communicate(timeout=30.0)
            assert '"contacts": []' in report
        finally:
            for process in robots:
                process.kill()
                process.communicate()


def test_a_reset_puts_a_simulated_robot_back_to_the_start(served, router, scene):
    with running_robot(router, scene, clock="shared") as robot, TwinClient(served.endpoint) as client:
        until(lambda: client.status() and client.tick() and client.tick().index > 5)
        before, life = client.status().run, robot.robot.life
        assert client.command(Reset()).ok
        until(lambda: (now := client.tick()) and now.run > before and now.index > 2)
        assert robot.robot.life != life


def test_without_a_robot_a_mirror_is_not_reset_and_a_new_run_is_not_waited_for(tmp_path, router):
    for mirror in (True, False):
        with (
            server_for_a_robot(tmp_path, session=router.session, mirror=mirror) as server,
            connect(server.endpoint) as twin,
        ):
            until(lambda: (now := twin.status()) and now.text.startswith("waiting for robot"))
            if mirror:
                with pytest.raises(Refused, match="a mirror only shows the robot"):
                    twin.reset()
            else:
                assert twin.reset().ok
            assert twin.seed(3).ok  # the run has begun, and there is no first period
            assert twin.latest_tick() is None


def test_a_paused_twin_shows_the_robot_as_soon_as_it_is_there(served, router, scene):
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and client.status().text.startswith("waiting for robot"))
        assert client.command(Pause()).ok
        assert client.tick() is None
        with running_robot(router, scene, clock="shared"):
            until(client.tick)
            run = client.tick().run
            assert client.command(Load(scene="exp1", variant="trial1", seed=3)).ok
            until(lambda: client.tick().run > run)
            until(lambda: client.status().state == "paused")
            assert client.tick().index == 0
            assert client.command(Step(count=2)).ok
            until(lambda: client.tick().index == 2)


def test_a_paused_twin_finds_a_real_robot_and_moves_nothing(served, router, scene):
    with TwinClient(served.endpoint) as client:
        until(lambda: client.status() and client.status().text.startswith("waiting for robot"))
        assert client.command(Pause()).ok
        with running_robot(router, scene, clock="real") as robot:
            until(lambda: "real clock" in client.status().plant_text)
            until(lambda: robot.robot.report()["time_s"] > 2.0)
            assert client.tick() is None and robot.robot.report()["path_length_m"] == 0.0
            assert client.command(Step()).ok
            until(client.tick)


@pytest.mark.parametrize("clock", [(), ("--shared",)])
def test_the_skeleton_of_a_robot_is_driven(router, scene, clock):
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


def started(*options, config=None):
    """The command, without the rest of the command line."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment |= {} if config is None else {VARIABLE: str(config)}
    command = [sys.executable, "-m", "motm_twin", "robot", "exp1", *options]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment)


def line(process):
    """The next one on standard error."""
    return process.stderr.readline()


def test_a_robot_says_where_it_waits_and_reports_at_the_end_without_a_twin_too():
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    with started("--endpoint", endpoint) as process:
        assert f"waiting for a twin 'frankie' at {endpoint}" in line(process)
        process.send_signal(signal.SIGINT)
        report, said = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert json.loads(report)["time_s"] == 0.0
    assert said == f"motm-twin robot: no twin 'frankie' was met at {endpoint}\n"


def test_without_an_endpoint_a_robot_goes_where_the_configuration_leads(router, tmp_path):
    config = tmp_path / "robot.json5"
    leads = f'connect: {{ endpoints: ["{router.endpoint}"] }}'
    shipped = SHIPPED.read_text()
    assert "connect: { endpoints: [] }" in shipped
    config.write_text(shipped.replace("connect: { endpoints: [] }", leads))
    listening = router.session.declare_subscriber(STATE, lambda _: None)  # as a twin does, and a mirror too
    with started(config=config) as process:
        assert f"waiting for a twin 'frankie' at {router.endpoint}" in line(process)
        assert line(process) == f"motm-twin robot: has met the twin 'frankie' at {router.endpoint}\n"
        process.send_signal(signal.SIGINT)
        report, said = process.communicate(timeout=60.0)
    listening.undeclare()
    assert (process.returncode, said) == (0, "")
    assert json.loads(report)["scene"] == "exp1"


def test_an_endpoint_that_is_given_counts_more_and_who_is_no_twin_is_not_met(router, tmp_path):
    listening = router.session.declare_subscriber(STATE.replace("frankie", "anna"), lambda _: None)
    with started("--endpoint", router.endpoint, config=tmp_path / "none.json5") as process:
        assert "none.json5" in line(process)
        assert process.wait(60.0) == 2
    with started("--endpoint", router.endpoint) as process:
        assert "waiting" in line(process)
        with pytest.raises(subprocess.TimeoutExpired):
            process.wait(1.0)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=60.0)
    listening.undeclare()
    assert said == f"motm-twin robot: no twin 'frankie' was met at {router.endpoint}\n"


def test_a_program_that_starts_a_robot_hears_nothing_of_it_but_the_report():
    with started("--child", "--endpoint", f"tcp/{LOOPBACK}:{free_port()}") as process:
        report, said = process.communicate("", timeout=60.0)
    assert (json.loads(report)["picks"], said) == (0, "")


def test_the_page_leads_to_the_skeleton_and_names_what_is_replaced_in_it():
    skeleton = SKELETON.read_text(encoding="utf-8")
    assert "](../examples/robot_skeleton.py)" in PAGE
    assert "`Drives`" in PAGE and "\nclass Drives:" in skeleton
    assert len(skeleton.splitlines()) < 130  # "a hundred lines"


def test_the_page_names_every_key():
    keys = PlantKeys()
    named = [key.removeprefix(keys.root + "/") for name, key in vars(keys).items() if name not in ("twin", "root")]
    assert [key for key in named if f"`{key}`" not in PAGE] == []


def shown(title, kind):
    match = re.search(rf"<!-- {title} -->\n```json\n(.*?)```", PAGE, re.S)
    return msgspec.json.decode(match[1].encode(), type=kind)


@pytest.mark.parametrize("title", ["info", "state", "scan", "detections", "command"])
def test_the_examples_of_messages_can_be_read(title):
    assert shown(title, PLANT_MESSAGES[f"plant/{title}"][1]).version == "motm.plant/1"


def test_the_example_of_a_scan_is_one_that_a_lidar_of_so_many_beams_makes():
    data = shown("scan", ScanData)
    scan = scan_of(data, 0.0)
    assert isinstance(check_scan(scan, Lidar(beams=len(data.ranges)), data.stamp), CheckedScan)
    assert isinstance(check_scan(scan, Lidar(), data.stamp), RefusedScan)
    assert f"{Lidar().beams} for Frankie" in PAGE
