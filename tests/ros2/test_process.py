"""The bridge as a program: it waits for a twin, finds one that was started again, and ends when it is told to."""

import json
import signal
import subprocess
import sys
import threading

import pytest
from ear import direct, until
from running import real_server
from waiting import until_paused

from motm_twin.bus.connection import free_port, open_member, open_server


class Bridge:
    """The program, and what it says."""

    def __init__(self, *options):
        command = [sys.executable, "-m", "motm_twin.ros2.bridge_process", *options]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        self.said = []
        self._thread = threading.Thread(target=self._listen)
        self._thread.start()

    def _listen(self):
        for line in self.process.stdout:
            self.said.append(json.loads(line))

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(20.0)
        self._thread.join()
        self.process.stdout.close()
        return code


def heard(port, key):
    """Wait until something comes on a key of the server at a port."""
    session, got = open_member(f"tcp/127.0.0.1:{port}"), []
    subscriber = session.declare_subscriber(key, direct(lambda sample: got.append(1)))
    try:
        until(lambda: got, f"nothing came on {key}")
    finally:
        subscriber.undeclare()
        session.close()


def test_it_waits_for_the_twin_and_finds_it_again():
    port = free_port()
    bridge = Bridge("--endpoint", f"tcp/127.0.0.1:{port}", "--prefix", "/lab")
    try:
        for _ in range(2):
            with real_server(port=port):
                heard(port, "lab/tf")
    finally:
        code = bridge.end()
    assert code == 0
    assert [event["event"] for event in bridge.said] == ["waiting", "ros2", "ended"]
    assert bridge.said[2]["sent"]["tf"] > 0
    assert bridge.said[2]["unreadable"] == {}


def test_a_twin_that_is_paused_is_shown_as_it_stands():
    with real_server(playing=False) as server:
        until_paused(server)
        session = open_member(server.endpoint)
        got = set()
        subscriber = session.declare_subscriber(
            "0/**", direct(lambda sample: got.add(str(sample.key_expr).split("/")[1]))
        )
        bridge = Bridge("--endpoint", server.endpoint, "--form", "rmw")
        try:
            wanted = {"joint_states", "odom", "tf", "scan", "map", "plan", "local_plan", "markers", "clock"}
            until(lambda: wanted <= got, "not all was said", 30.0)
        finally:
            subscriber.undeclare()
            session.close()
            bridge.end()


def test_the_ros_side_may_be_another_router():
    port, router_port = free_port(), free_port()
    router = open_server(router_port)
    bridge = Bridge("--endpoint", f"tcp/127.0.0.1:{port}", "--ros-endpoint", f"tcp/127.0.0.1:{router_port}")
    try:
        with real_server(port=port):
            heard(router_port, "tf")
    finally:
        code = bridge.end()
        router.close()
    assert code == 0


def test_serve_starts_it_beside_the_twin():
    port = free_port()
    command = [sys.executable, "-m", "motm_twin", "serve", "exp1", "--headless", "--zenoh-port", str(port)]
    with subprocess.Popen([*command, "--ros2", "bridge"], stdout=subprocess.PIPE, text=True) as serve:
        try:
            heard(port, "tf")
        finally:
            serve.send_signal(signal.SIGINT)
            said, _ = serve.communicate(timeout=30.0)
    assert serve.returncode == 0
    assert "ROS 2: topics in the form of zenoh-bridge-ros2dds" in said


def test_it_ends_while_nobody_is_there():
    bridge = Bridge("--endpoint", f"tcp/127.0.0.1:{free_port()}")
    until(lambda: bridge.said, "it never began")
    assert bridge.end() == 0


@pytest.mark.parametrize(
    ("options", "words"), [(("--prefix", "lab 1"), "prefix"), (("--form", "rmw", "--domain", "500"), "ROS_DOMAIN_ID"),
                           (("--twin", "a/b"), "twin name")]
)  # fmt: skip
def test_bad_input_is_refused_with_a_sentence(options, words):
    bridge = Bridge(*options)
    code = bridge.process.wait(30.0)
    bridge.end()
    assert code == 2
    assert words in bridge.said[0]["text"]
