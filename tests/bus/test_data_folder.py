"""Commands that programs asked for: drive there, save and record."""

import contextlib
import json
import os
import signal
import threading
import time
from pathlib import Path

import pytest
from fake_twin import FakeTwin
from running import Running, real_server
from waiting import asked, until, until_paused

from motm_twin.bus import commands
from motm_twin.bus.client import TwinClient
from motm_twin.bus.connection import open_client
from motm_twin.bus.data_folder import RECORDER
from motm_twin.bus.library import FileLibrary
from motm_twin.model.scene_file import load_scene
from motm_twin.sessions.session import load_session
from motm_twin.twin import Twin


@pytest.fixture
def server(tmp_path):
    with real_server(playing=False, data=tmp_path / "data") as running:
        until_paused(running)
        yield running


def test_a_session_is_saved_once_under_a_name(tmp_path, client):
    answer = client.command(commands.Save(name="first"), timeout=5.0)
    assert (answer.ok, answer.path) == (True, str((tmp_path / "data" / "first.json").resolve())), answer.reason
    kept = (tmp_path / "data" / "first.json").read_bytes()
    again = client.command(commands.Save(name="first.json"), timeout=5.0)
    assert not again.ok
    assert "is there already" in again.reason
    assert (tmp_path / "data" / "first.json").read_bytes() == kept
    assert load_session(answer.path).scene.name == "exp1"


def test_a_folder_that_can_not_be_written_is_said_so(tmp_path, client):
    (tmp_path / "data").write_text("a file where the folder should be")
    answer = client.command(commands.Save(name="first"), timeout=5.0)
    assert not answer.ok
    assert answer.reason.startswith(f"{tmp_path / 'data'} cannot be written: ")


def test_a_save_or_record_that_is_refused_takes_no_wheel(server, tmp_path):
    with TwinClient(server.endpoint) as ann, TwinClient(server.endpoint) as bob:
        assert not ann.command(commands.Record(action="stop"), timeout=5.0).ok
        assert bob.command(commands.Save(name="first"), timeout=5.0).ok
        assert bob.command(commands.HandOver()).ok
        assert "is there already" in ann.command(commands.Save(name="first"), timeout=5.0).reason
        assert bob.command(commands.Pause()).ok
        assert "is driving" in ann.command(commands.Save(name="second"), timeout=5.0).reason


@pytest.mark.parametrize("other", ["goes on", "hands over"])
def test_who_has_saved_drives_unless_somebody_else_does_by_then(other):
    class Slow:
        """Writes when it is told to."""

        recording = ""

        def write(self, command, live, done):
            self.done = done

    keeper, answers = Slow(), []
    with Running(FakeTwin, data=keeper) as running:
        save = commands.Envelope(
            sender="ann", name="Ann", seq=1, expires=time.time() + 60.0, command=commands.Save(name="a")
        )
        running.loop.request(save, lambda *answer: answers.append(answer))
        assert running.ask(commands.Pause(), sender="bob") == ""
        if other == "hands over":
            assert running.ask(commands.HandOver(), sender="bob") == ""
        keeper.done("", "a.json")
        assert running.ask(commands.Inspect()) == ""  # comes after it
        assert running.loop.status().driver == ("ann" if other == "hands over" else "bob")
    assert answers == [("", 0, "a.json")]


def test_a_recording_is_started_and_stopped_by_commands(tmp_path, client):
    assert "nothing is being recorded" in client.command(commands.Record(action="stop"), timeout=5.0).reason
    started = client.command(commands.Record(action="start", name="run"), timeout=30.0)
    assert started.ok, started.reason
    assert started.path == str((tmp_path / "data" / "run.mcap").resolve())
    until(lambda: client.status().recording == started.path, "the status does not say so")
    assert "already" in client.command(commands.Record(action="start"), timeout=5.0).reason
    assert client.command(commands.Step(count=5)).ok
    stopped = client.command(commands.Record(action="stop"), timeout=10.0)
    assert (stopped.ok, stopped.path) == (True, started.path), stopped.reason
    until(lambda: client.status().recording == "", "the status does not say so")
    data = (tmp_path / "data" / "run.mcap").read_bytes()
    assert data.startswith(b"\x89MCAP")
    assert data.endswith(b"MCAP0\r\n"), "it was not finished"


def test_a_recorder_that_was_killed_is_told_and_another_can_begin(server, tmp_path, capfd):
    with TwinClient(server.endpoint) as client, open_client(server.endpoint) as plain:
        started = client.command(commands.Record(action="start", name="cut"), timeout=30.0)
        assert started.ok, started.reason
        os.kill(_recorder_of(started.path), signal.SIGKILL)
        until(lambda: client.status().recording == "", "the status does not say so")

        def told():
            (reply,) = asked(plain, server.keys.event + "?from=0")
            events = json.loads(reply.ok.payload.to_bytes())["events"]
            return [event for event in events if event["kind"] == "recording"]

        until(told, "no event says so")
        assert "its process ended by signal 9; `motm-twin recover " in told()[-1]["text"]
        assert "the recording has stopped" in capfd.readouterr().err
        assert client.command(commands.Record(action="start", name="next"), timeout=30.0).ok
        assert client.command(commands.Record(action="stop"), timeout=10.0).ok
        listens = (thread for thread in threading.enumerate() if thread.name == "recorder reports")
        for thread in listens:
            thread.join(10.0)
        assert len(told()) == 1, "one that was asked to stop has not failed"


def _recorder_of(path):
    """Number of the process that records to a file."""
    for process in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            words = (process / "cmdline").read_bytes().decode().split("\0")
            if RECORDER in words and path in words:
                return int(process.name)
    raise AssertionError("there is no recorder")


def test_drive_to_comes_before_the_active_task_and_is_logged():
    with Running(Twin, library=FileLibrary("exp1"), first="exp1") as running:
        assert running.ask(commands.DriveToPoint(x=0.5, y=0.2)) == ""
        running.step()
        task = running.last.tasks[running.last.task_index]
        assert (task.kind, task.status) == ("drive_to", "active")
        assert len(running.last.tasks) == len(load_scene("exp1").tasks) + 1
        assert running.loop.status().recorded == 1
