"""A paused loop of the stand-in for a twin; a client and a plain session of the server that a module has."""

import pytest
from running import Running
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import open_client


@pytest.fixture
def running():
    with Running() as loop:
        yield loop


@pytest.fixture
def client(server):
    with TwinClient(server.endpoint, sender="tester") as connected:
        until(lambda: connected.tick() and connected.status(), "nothing was received")
        yield connected


@pytest.fixture
def session(server):
    with open_client(server.endpoint) as plain:
        yield plain
