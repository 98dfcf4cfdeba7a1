"""Scenes and methods that a server offers; sessions and recordings that it keeps."""

import contextlib
import json
import os
import shutil
import signal
import threading
import time
from pathlib import Path

import msgspec
import pytest
from fake_twin import FakeLibrary, FakeTwin, fake_server
from running import Running, real_server
from waiting import asked, until, until_paused

from motm_twin.bus import commands
from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Load, Reset, Seed
from motm_twin.bus.connection import open_client
from motm_twin.bus.data_folder import RECORDER
from motm_twin.bus.library import FileLibrary, MethodLibrary
from motm_twin.measures.references import reference_tour_s
from motm_twin.methods.registry import METHODS, MOTM, STAA
from motm_twin.model.assets import scenes_dir
from motm_twin.model.names import MethodError
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import Session, SessionError, load_session
from motm_twin.twin import Twin
from motm_twin.ui.what_if import WhatIf

OWN = """
from motm_twin.control.method import Method

SLOW = Method(name="slow", title="Slow", summary="Drives slowly.", source="own", parameters={"next_weight": 0.5})
SAME = Method(name="motm", title="Not the paper's", summary="-", source="own")
"""


@pytest.fixture
def own(tmp_path):
    """A file with a method of a user's."""
    path = tmp_path / "own.py"
    path.write_text(OWN, encoding="utf-8")
    return f"{path}:SLOW"


def test_every_shipped_method_is_offered_and_one_of_a_file_besides(own):
    shipped = [choice.name for choice in MethodLibrary().choices()]
    assert shipped == list(METHODS)
    library = MethodLibrary(own)
    assert library.own_name == "slow"
    assert [choice.name for choice in library.choices()] == [*shipped, "slow"]
    assert library.find("slow").parameters == {"next_weight": 0.5}


def test_a_file_is_no_name_and_no_file_may_take_the_name_of_a_shipped_method(own):
    with pytest.raises(MethodError, match="no method is called"):
        MethodLibrary().find(own)
    with pytest.raises(MethodError, match="'motm', as a shipped method"):
        MethodLibrary(own.replace("SLOW", "SAME"))
    with pytest.raises(MethodError, match="SLOW"):
        MethodLibrary(own.replace("SLOW", "SLOWW"))


def test_a_load_chooses_the_method_and_reset_and_seed_keep_it(running):
    assert running.loop.status().method == "motm"
    assert [choice.name for choice in running.loop.status().methods] == list(METHODS)
    assert running.ask(Load(scene="other", method="staa")) == ""
    assert running.twins[-1].method is STAA
    assert running.ask(Seed(seed=7)) == ""
    status = running.loop.status()
    assert (status.scene, status.variant, status.seed, status.state) == ("other", "a", 7, "paused")
    assert (running.twins[-1].method, running.library.loads[-1]) == (STAA, ("other", "a", 7))
    assert running.ask(Reset()) == ""
    assert (running.loop.status().method, running.loop.status().seed) == ("staa", 7)
    assert running.ask(Load(scene="other")) == ""
    assert (running.loop.status().method, running.twins[-1].method) == ("motm", MOTM)


def test_a_wrong_name_is_refused_with_the_near_ones_and_changes_nothing(own, running):
    assert running.ask(Load(scene="other", method="no_bezierr")).endswith("did you mean no_bezier?")
    for name in (own, "", "x" * 10_000):
        assert running.ask(Load(scene="other", method=name)).startswith("no method is called")
    status = running.loop.status()
    assert (status.scene, status.method, status.run, len(running.twins)) == ("fake", "motm", 1, 1)


def test_a_changed_scene_file_is_loaded_again_under_the_same_method():
    class Edited(FakeLibrary):
        title = "first"

        def load(self, scene, variant, seed):
            return msgspec.structs.replace(super().load(scene, variant, seed), title=self.title)

    with Running(library=Edited()) as running:
        assert running.ask(Load(scene="fake", method="staa")) == ""
        running.library.title = "second"
        running.loop.reload()
        until(lambda: len(running.twins) == 3, "it is not loaded again")
        assert running.twins[-1].method is STAA


def test_a_session_says_its_method_and_is_rerun_with_it():
    first = Load(scene="exp1", variant="trial1", method="staa")
    with Running(Twin, library=FileLibrary("exp1"), first=first) as running:
        running.step(5)
        kept = []
        running.loop.session(lambda payload, info, problem: kept.append(payload))
        session = msgspec.json.decode(until(lambda: kept, "no session")[0], type=Session)
    assert (session.method, session.periods) == ("staa", 6)
    again = rerun(session)
    assert again.ok, again.first_sign
    with pytest.raises(SessionError, match="made with the method 'staa', not with 'motm'"):
        rerun(session, MOTM)


def test_a_method_of_a_file_is_served_by_its_name_and_loaded_again_by_it(own):
    server = fake_server(first=Load(scene="fake", method="slow"), methods=MethodLibrary(own), playing=False)
    with server, TwinClient(server.endpoint) as client:
        status = until(lambda: (s := client.status()) and s.state == "paused" and s, "it does not start")
        assert status.method == "slow"
        assert status.methods[-1].title == "Slow"
        assert client.command(Load(scene="other", method="motm")).ok
        until(lambda: client.status().scene == "other" and client.status().state == "paused", "it is not loaded")
        refused = client.command(Load(scene="fake", method=own))
        assert not refused.ok and refused.reason.startswith("no method is called")
        assert client.command(Load(scene="fake", method="slow")).ok
        until(lambda: client.status().method == "slow", "it is not loaded again")


def test_a_comparison_is_told_where_the_method_of_the_session_is(own):
    what_if = WhatIf(bytes, own_method=("slow", own))
    scene = FakeLibrary().load("fake", None, None)
    assert what_if._method_of(msgspec.json.encode(Session(scene=scene, method="slow"))) == ["--method", own]
    assert what_if._method_of(msgspec.json.encode(Session(scene=scene))) == []


@pytest.fixture
def file(tmp_path):
    return shutil.copy(scenes_dir() / "exp1.yaml", tmp_path / "mine.yaml")


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def watched(running):
    """Heartbeat of the server, by hand."""
    if running.library.changed():
        running.loop.reload()
    return running.loop.status()


def test_a_changed_file_is_told_once_and_only_when_it_is_at_rest(file):
    library = FileLibrary(str(file))
    assert not library.changed()
    library.load("mine", "trial2", None)
    assert not library.changed()
    edit(file, "Experiment 1:", "New:")
    assert [library.changed() for _ in range(4)] == [False, True, False, False]
    os.utime(file, (1.0, 1.0))
    assert [library.changed() for _ in range(3)] == [False, True, False]
    library.load("exp2", None, None)
    edit(file, "New:", "Newer:")
    assert [library.changed() for _ in range(3)] == [False, False, False]


def test_a_saved_scene_is_loaded_again_and_a_wrong_one_leaves_the_old_one_running(file):
    with Running(Twin, library=FileLibrary(str(file)), first=Load(scene="mine", variant="trial2")) as running:
        assert running.loop.status().run == 1
        running.step(5)
        edit(file, "Experiment 1:", "Changed:")
        status = until(lambda: (s := watched(running)).run == 2 and s.state == "paused" and s, "it is not loaded")
        assert (status.text, status.variant) == ("scene file changed: loaded again", "trial2")
        assert running.last.index == 0
        assert running.sink.scenes[-1].title.startswith("Changed:")
        assert next(choice for choice in status.scenes if choice.name == "mine").title.startswith("Changed:")

        running.step(3)
        edit(file, "title:", "titel:")
        status = until(lambda: (s := watched(running)).text.startswith("the scene file") and s, "no error")
        assert "titel" in status.text
        assert "mine.yaml:" in status.text
        running.step(2)
        assert running.loop.status().text == status.text

        edit(file, "titel:", "title:")
        until(lambda: not watched(running).text, "the error stays")
        assert (running.loop.status().run, running.last.index) == (2, 5)


def test_the_bound_of_the_scene_is_told():
    scene = load_scene("exp1")
    library = FileLibrary("exp1")
    with Running(Twin, library=library, first="exp1", reference_tour=reference_tour_s) as running:
        assert running.loop.status().reference_tour == reference_tour_s(scene)


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
