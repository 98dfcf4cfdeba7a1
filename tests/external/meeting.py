"""A router, and reference robots in threads of this process: with sessions of their own, as if they were elsewhere."""

import functools
import threading
from contextlib import contextmanager

import pytest
from waiting import until

from motm_twin.bus.commands import Load
from motm_twin.bus.connection import LOOPBACK, free_port, open_server
from motm_twin.bus.library import FileLibrary, TwinSetup
from motm_twin.bus.plant_messages import VERSION
from motm_twin.bus.server import RobotChoice, TwinServer
from motm_twin.external.plant import ZenohPlant
from motm_twin.external.robot_link import RobotLink
from motm_twin.external.robot_server import RobotServer
from motm_twin.methods import UNNAMED_METHOD
from motm_twin.planning.types import SearchBudget
from motm_twin.server_process import make_external_twin
from motm_twin.twin import Twin

STATE = {"version": VERSION, "life": "1", "seq": 0, "stamp": 5.0, "pose": [0.0] * 3, "odometry": [0.0] * 3,
         "twist": [0.0] * 2, "q": [0.0] * 7, "dq": [0.0] * 7, "gripper_width": 0.08, "gripper_moving": False,
        }  # fmt: skip


class Router:
    """A Zenoh session in the middle."""

    def __init__(self):
        self.port = free_port()
        self.session = open_server(self.port)
        self.endpoint = f"tcp/{LOOPBACK}:{self.port}"


class DeafenedRobot(RobotServer):
    """A reference robot whose messages can be held back, and whose link can become another one."""

    muted: frozenset[str] = frozenset()

    def impair(self, link):
        """From now on commands go through this link; those under way arrive as they would have."""
        self.robot._up.spec = link

    def _put(self, name, payload):
        if name not in self.muted:
            super()._put(name, payload)


@contextmanager
def running_robot(router, scene, *, twin="frankie", clock="shared", link=None):
    """A robot in a thread."""
    server = DeafenedRobot(scene, router.endpoint, twin=twin, clock=clock, link=link)
    thread = threading.Thread(target=server.run, name="robot")
    thread.start()
    try:
        yield server
    finally:
        server.stop()
        thread.join(10.0)
        server.close()


@contextmanager
def driven(router, scene, *, twin="frankie", mirror=False):
    """A twin whose robot is met at the router, as soon as it is there."""
    link = RobotLink(router.session, twin, listen_only=mirror)
    plant = ZenohPlant(link, scene)
    driven_twin = Twin(scene, plant=plant)
    try:
        until(plant.ready)
        yield driven_twin
    finally:
        link.close()


def server_for_a_robot(data, method=UNNAMED_METHOD, **robot):
    """A server of Experiment 1 whose robot is in another program; ``robot``: fields of `RobotChoice`."""
    make = functools.partial(make_external_twin, budget=SearchBudget(), sender="twin")
    return TwinServer(
        TwinSetup(
            library=FileLibrary("exp1"),
            make_twin=lambda scene, method: pytest.fail("the simulated robot was asked for"),
            first=Load(scene="exp1", variant="trial1", method=method),
        ),
        data=data,
        robot=RobotChoice(meet=RobotLink, make_twin=make, **robot),
    )
