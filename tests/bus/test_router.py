"""Behind a router, with the files of docs/scale.md."""

import re
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from fake_twin import fake_server
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Step
from motm_twin.bus.connection import SHIPPED, VARIABLE, free_port, open_client

DOCS = Path(__file__).resolve().parents[2] / "docs" / "scale.md"


@pytest.fixture
def routers(tmp_path):
    """Two linked routers, opened with the file that the text shows; where each listens."""
    (shown,) = re.findall(r"```json5\n(.*?)```", DOCS.read_text(encoding="utf-8"), re.S)
    sessions, endpoints = [], []
    for number in range(2):
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        link = f'connect: {{ endpoints: ["{endpoints[-1]}"] }},' if endpoints else ""
        file = tmp_path / f"router-{number}.json5"
        file.write_text(
            shown.replace("tcp/0.0.0.0:7450", endpoint).replace('mode: "router",', f'mode: "router", {link}')
        )
        sessions.append(zenoh.open(zenoh.Config.from_file(str(file))))
        endpoints.append(endpoint)
    yield endpoints
    for session in reversed(sessions):
        session.close()


def test_twins_at_one_router_are_read_and_commanded_through_it_and_through_another(routers, tmp_path, monkeypatch):
    site, viewer = tmp_path / "site.json5", tmp_path / "viewer.json5"
    shipped = SHIPPED.read_text(encoding="utf-8")
    site.write_text(shipped.replace("connect: { endpoints: [] }", f'connect: {{ endpoints: ["{routers[0]}"] }}'))
    viewer.write_text(shipped.replace('mode: "peer"', 'mode: "client"'))
    monkeypatch.setenv(VARIABLE, str(site))
    made = [fake_server(playing=False, twin=name) for name in ("anna", "bert")]
    monkeypatch.setenv(VARIABLE, str(viewer))
    with made[0] as anna, made[1]:
        for endpoint in routers:
            for name in ("anna", "bert"):
                with TwinClient(endpoint, name) as client:
                    until(lambda client=client: client.tick() and client.status() and client.scene(), f"no {name}")
                    assert client.status().twin == name
                    index = client.tick().index
                    answer = client.command(Step(), sender="visitor")
                    assert answer.ok, answer.reason
                    until(lambda client=client, index=index: client.tick().index == index + 1, f"{name} does not step")
        monkeypatch.delenv(VARIABLE)
        with TwinClient(anna.endpoint, "anna") as near:
            until(near.tick, "its own port does not answer")


LATE = """
import sys, time, zenoh
config = zenoh.Config()
config.insert_json5("mode", "'router'")
config.insert_json5("listen/endpoints", f"['{sys.argv[1]}']")
config.insert_json5("scouting/multicast/enabled", "false")
print("ready", flush=True)
time.sleep(0.5)
with zenoh.open(config):
    sys.stdin.read()
"""


def test_a_client_waits_a_moment_for_a_router_that_is_just_starting(tmp_path, monkeypatch):
    viewer, endpoint = tmp_path / "viewer.json5", f"tcp/127.0.0.1:{free_port()}"
    viewer.write_text(SHIPPED.read_text(encoding="utf-8").replace('mode: "peer"', 'mode: "client"'))
    monkeypatch.setenv(VARIABLE, str(viewer))
    command = [sys.executable, "-c", LATE, endpoint]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as router:
        assert router.stdout and router.stdout.readline() == "ready\n"
        with open_client(endpoint) as session:
            assert session.info.routers_zid()
        router.communicate("")
