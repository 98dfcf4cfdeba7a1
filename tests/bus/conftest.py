"""A paused loop of the stand-in for a twin."""

import pytest
from running import Running


@pytest.fixture
def running():
    with Running() as loop:
        yield loop
