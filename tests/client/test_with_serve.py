"""A program finds what `motm-twin serve` runs, by its name alone, and is told when there is more than one."""

import json
import secrets
import signal
import subprocess
import sys

import pytest
from waiting import until

from motm_twin.client import NoTwin, connect, running_twins

SERVE = [sys.executable, "-m", "motm_twin", "serve", "exp1", "--headless", "--zenoh-port", "0"]


def found(name):
    return [twin for twin in running_twins() if twin.twin == name and twin.alive]


@pytest.mark.slow
def test_a_served_twin_is_found_by_its_name_driven_and_gone_after_the_end(tmp_path):
    name = f"client-{secrets.token_hex(4)}"
    process = subprocess.Popen([*SERVE, "--twin", name, "--data", str(tmp_path / "kept")], stdout=subprocess.DEVNULL)
    try:
        until(lambda: found(name), "it is not found", 60.0)
        with connect(twin=name, timeout=30.0) as twin:
            twin.wait_until(lambda tick: tick.index > 3, timeout=120.0)
            twin.drive_to(0.5, 0.2)
            saved = twin.save("mine")
            assert json.loads((tmp_path / "kept" / "mine.json").read_bytes())["version"] == "motm.session/1"
            assert saved.path.endswith("kept/mine.json")
            kinds = set()
            for event in twin.events(since=0):
                kinds.add(event.kind)
                if {"loaded", "edit"} <= kinds:
                    break
            twin.hand_over()
        listed = subprocess.run(
            [sys.executable, "-m", "motm_twin", "twins", "--json"],
            capture_output=True,
            text=True,
            check=False,
        )
        assert name in [json.loads(line)["twin"] for line in listed.stdout.splitlines()]
    finally:
        process.send_signal(signal.SIGINT)
        assert process.wait(20.0) == 0
    with pytest.raises(NoTwin, match="start one with"):
        connect(twin=name)
