"""The health check of a container, of a twin that plays, stands or is gone."""

import pytest
from fake_twin import fake_server
from waiting import until

from motm_twin.bus import health
from motm_twin.bus.connection import free_port


@pytest.fixture
def playing(tmp_path, monkeypatch):
    monkeypatch.setattr(health, "TIMEOUT", 1.0)
    with fake_server(data=tmp_path, twin="t") as server:
        until(lambda: server.loop.status().time > 0.0, "it does not play")
        yield server


def problem(server):
    return health.check(server.endpoint, "t", None)


def test_a_twin_whose_time_runs_or_may_stand_is_healthy(playing):
    assert problem(playing) == ""
    playing.loop._set_state("paused", "")
    assert problem(playing) == ""


def test_a_twin_whose_control_thread_has_ended_is_not_healthy(playing):
    """It still answered that it plays, and that was enough."""
    playing.loop.stop()
    playing._threads[0].join(10.0)
    assert "stands, though it plays" in problem(playing)
    playing.loop._live._plant, playing.loop._text = "mirror", "waiting for robot"
    assert problem(playing) == "", "time can not run without a robot"


def test_an_error_a_missing_page_and_a_server_that_does_not_answer_are_told(playing):
    assert "no page answers" in health.check(playing.endpoint, "t", free_port())
    assert "no twin server answers" in health.check(playing.endpoint, "another", None)
    playing.loop._set_state("error", "broken")
    assert "stopped with an error" in problem(playing)
