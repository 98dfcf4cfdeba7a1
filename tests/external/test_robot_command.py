"""`motm-twin robot` as a person sees it: where it waits, that it has met its twin, and the report at the end."""

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from meeting import Router

from motm_twin.bus.connection import LOOPBACK, SHIPPED, VARIABLE, free_port

STATE = "motm/frankie/plant/state"


def started(*options: str, config: Path | None = None) -> subprocess.Popen[str]:
    """The command, without the rest of the command line."""
    environment = {name: value for name, value in os.environ.items() if name != VARIABLE}
    environment |= {} if config is None else {VARIABLE: str(config)}
    command = [sys.executable, "-m", "motm_twin", "robot", "exp1", *options]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, stdin=pipe, stdout=pipe, stderr=pipe, text=True, env=environment)


def line(process: subprocess.Popen[str]) -> str:
    """The next one on standard error."""
    assert process.stderr is not None
    return process.stderr.readline()


def test_a_robot_says_where_it_waits_and_reports_at_the_end_without_a_twin_too() -> None:
    endpoint = f"tcp/{LOOPBACK}:{free_port()}"
    with started("--endpoint", endpoint) as process:
        assert f"waiting for a twin 'frankie' at {endpoint}" in line(process)
        process.send_signal(signal.SIGINT)
        report, said = process.communicate(timeout=60.0)
    assert process.returncode == 0
    assert json.loads(report)["time_s"] == 0.0
    assert said == f"motm-twin robot: no twin 'frankie' was met at {endpoint}\n"


def test_without_an_endpoint_a_robot_goes_where_the_configuration_leads(router: Router, tmp_path: Path) -> None:
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


def test_an_endpoint_that_is_given_counts_more_and_who_is_no_twin_is_not_met(router: Router, tmp_path: Path) -> None:
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


def test_a_program_that_starts_a_robot_hears_nothing_of_it_but_the_report() -> None:
    with started("--child", "--endpoint", f"tcp/{LOOPBACK}:{free_port()}") as process:
        report, said = process.communicate("", timeout=60.0)
    assert (json.loads(report)["picks"], said) == (0, "")
