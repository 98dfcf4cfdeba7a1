"""A recorded run of an external robot is computed again from what the robot reported, period by period."""

import functools
import json
import sys
import threading
from collections.abc import Callable
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest
from meeting import DeafenedRobot, Router, running_robot, server_for_a_robot
from waiting import until

sys.path.insert(0, str(Path(__file__).parents[1] / "record"))

from recordings import changed

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Pause, Play, Reset, SetParameter
from motm_twin.bus.connection import open_member
from motm_twin.bus.library import FileLibrary
from motm_twin.cli import run as cli_run
from motm_twin.model.edits import Announce
from motm_twin.record import channels as ch
from motm_twin.record import replay
from motm_twin.record.mcap_file import McapFile, read
from motm_twin.record.recorder import Recorder
from motm_twin.record.recording import info, load_recording, observations_of
from motm_twin.record.replay import rerun_run
from motm_twin.sessions.session import SessionError

PERIODS = 60

T = TypeVar("T")
Robot = Callable[[], AbstractContextManager[DeafenedRobot]]


@contextmanager
def serving(folder):
    """A twin of an external robot, somebody at it, and the robot, which is not there yet."""
    router, scene = Router(), FileLibrary("exp1").load("exp1", "trial1", None)
    server = server_for_a_robot(folder, "staa", session=router.session)
    with server, TwinClient(server.endpoint) as client, open_member(server.endpoint) as session:
        yield client, session, functools.partial(running_robot, router, scene, clock="shared")
    router.session.close()


@contextmanager
def recording_to(path, session):
    """A recorder in a thread."""
    recorder, stop = Recorder(session, "frankie", path), threading.Event()
    thread = threading.Thread(target=recorder.run, args=(stop,))
    thread.start()
    try:
        assert recorder.listens(10.0)
        yield recorder
    finally:
        stop.set()
        thread.join(30.0)


def index(client):
    """The newest period; -1 before the first."""
    tick = client.tick()
    return -1 if tick is None else tick.index


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A recording of a robot that was disturbed on its way."""
    path = tmp_path_factory.mktemp("recorded") / "run.mcap"
    with serving(path.parent) as (client, session, robot), recording_to(path, session), robot():
        until(lambda: index(client) > 10)
        x, _, _ = client.scene().start
        assert client.command(AddObstacle(name="guest", x=float(x) + 2.0, y=0.0)).ok
        assert client.command(SetParameter(name="bezier", value=False)).ok
        until(lambda: index(client) > PERIODS)
        assert client.command(Pause()).ok  # else it may end between a period and what was seen in it
        until(lambda: client.status().state == "paused")
    return path


@dataclass(frozen=True, kw_only=True)
class Begun:
    """Recordings of one session, by where they begin."""

    in_first_run: Path
    between: Path  # the first run has been ended, the robot has not begun the second
    at_first_period: Path  # of the second run, where it stands


@pytest.fixture(scope="module")
def begun(tmp_path_factory):
    """Three recordings in a session of two runs."""
    folder = tmp_path_factory.mktemp("begun")
    files = Begun(
        in_first_run=folder / "first.mcap", between=folder / "between.mcap", at_first_period=folder / "period.mcap"
    )
    with serving(folder) as (client, session, robot), robot() as there:
        until(lambda: index(client) > 10)
        with recording_to(files.in_first_run, session):
            until(lambda: index(client) > 20)
            assert client.command(Pause()).ok
            there.muted = frozenset({"state"})
            assert client.command(Reset()).ok
            until(lambda: client.status().run == 2)
            with recording_to(files.between, session):
                assert client.tick().run == 1
                there.muted = frozenset()
                until(lambda: (client.tick().run, index(client)) == (2, 0))
                with recording_to(files.at_first_period, session):
                    assert client.command(Play()).ok
                    until(lambda: index(client) > 20)
                    assert client.command(Pause()).ok  # else they may end between a period and what was seen in it
                    until(lambda: client.status().state == "paused")
    return files


def test_every_period_is_the_recorded_one(recorded):
    recording = load_recording(recorded)
    (run,) = (run for run in recording.runs if run.indices)
    assert run.plant == "zenoh"
    assert [type(entry.edit) for entry in run.edits] == [AddObstacle, SetParameter]
    report = rerun_run(recording, run)
    assert (report.ok, report.fields, report.text) == (True, [], "")
    assert report.compared == len(run.indices) > PERIODS


def test_what_the_robot_reported_decides(recorded, monkeypatch):
    """Seen a hand's breadth further to the left, the robot would have driven otherwise."""

    def doctored(path, run):
        for message in observations_of(path, run):
            if message.index < 30:
                yield message
                continue
            samples = [
                msgspec.structs.replace(one, pose=[one.pose[0], one.pose[1] + 0.1, one.pose[2]])
                for one in message.samples
            ]
            yield msgspec.structs.replace(message, samples=samples)

    monkeypatch.setattr(replay, "observations_of", doctored)
    recording = load_recording(recorded)
    (run,) = (run for run in recording.runs if run.indices)
    report = rerun_run(recording, run)
    assert (report.ok, report.period) == (False, 30)
    assert any(field.startswith("robot.pose") for field in report.fields)


def test_the_run_that_is_whole_is_computed_and_of_the_other_it_is_said_why_not(begun, tmp_path, capsys):
    assert [run.from_s > 0.0 for run in info(begun.in_first_run).runs] == [True, False]
    assert cli_run.rerun_file(str(begun.in_first_run), report=str(tmp_path / "report.json")) == cli_run.OK
    printed = capsys.readouterr().out
    assert "run 2: exp1 / trial1, seed 0\nequal bit for bit" in printed
    assert "run 1\nnot computed, which is no difference: its robot was in another program" in printed
    report = json.loads((tmp_path / "report.json").read_text())
    assert ([run["run"] for run in report["runs"]], [run["run"] for run in report["not_computed"]]) == ([2], [1])
    assert report["ok"]


def test_a_run_that_differs_is_told_beside_one_that_cannot_be_computed(begun, tmp_path, capsys):
    def moved(topic, message):
        if topic == ch.TICK.topic and message["run"] == 2 and message["index"] == 7:
            message["robot"]["pose"][0] += 0.1
        return message

    path = changed(begun.in_first_run, tmp_path / "moved.mcap", moved)
    assert cli_run.rerun_file(str(path)) == cli_run.FAILED
    printed = capsys.readouterr().out
    assert "different first in period 7" in printed
    assert "not computed" in printed


def test_a_recording_of_which_no_run_can_be_computed_is_refused_with_every_reason(begun, tmp_path):
    path = changed(
        begun.in_first_run, tmp_path / "x.mcap", lambda topic, message: None if "observ" in topic else message
    )
    with pytest.raises(
        SessionError, match=r"no run in it can be computed again: run 1: its robot .*; run 2: its robot"
    ):
        cli_run.rerun_file(str(path))


def test_a_recording_begun_between_two_runs_has_nothing_of_the_run_before(begun):
    """The twin still tells the last period of that run: an old picture, hours before the first of the recording."""
    assert [run.key[1] for run in load_recording(begun.between).runs] == [2]
    runs = {}
    for entry in read(begun.between):
        message = json.loads(entry.data)
        if entry.topic in (ch.TICK.topic, ch.ROBOT.topic, ch.GRID.topic, ch.OBSERVATIONS.topic):
            runs.setdefault(entry.topic, set()).add(message.get("info", message)["run"])
    assert len(runs) == 4
    assert set.union(*runs.values()) == {2}
    assert cli_run.rerun_file(str(begun.between)) == cli_run.OK


def test_a_recording_begun_while_time_stands_at_the_first_period_has_the_whole_run(begun):
    recording = load_recording(begun.at_first_period)
    (run,) = recording.runs
    report = rerun_run(recording, run)
    assert (run.indices[0], report.ok, report.text) == (0, True, "")
    assert report.compared == len(run.indices) > 20


def test_what_was_seen_in_the_first_period_may_come_before_that_period(begun, tmp_path):
    """A recorder that begins between the two is sent the one, and is answered with the other afterwards."""
    entries = list(read(begun.at_first_period))
    first = next(entry for entry in entries if entry.topic == ch.OBSERVATIONS.topic)
    assert json.loads(first.data)["index"] == 0
    path = tmp_path / "early.mcap"
    file = McapFile(path)
    for entry in (first, *(entry for entry in entries if entry is not first)):
        file.add(ch.CHANNELS[entry.topic], entry.log_time / 1e9, entry.data)
    file.close()
    recording = load_recording(path)
    report = rerun_run(recording, recording.runs[0])
    assert (report.ok, report.text, report.compared) == (True, "", len(recording.runs[0].indices))


def test_a_run_is_computed_up_to_the_first_period_of_which_the_robot_is_not_known(recorded, tmp_path):
    def gap(topic, message):
        return None if topic == ch.OBSERVATIONS.topic and message["index"] == 20 else message

    recording = load_recording(changed(recorded, tmp_path / "gap.mcap", gap))
    report = rerun_run(recording, recording.runs[0])
    assert (report.ok, report.periods, report.compared) == (True, 20, 20)
    assert report.text.startswith("periods 20 to ")
    assert report.text.endswith("what the robot saw in period 20 is missing in the file")


def test_a_run_is_computed_up_to_furniture_that_was_announced(recorded, tmp_path):
    def announced(topic, message):
        if topic == ch.TICK.topic and message["index"] == 30:
            message["edits"] = [*message["edits"], {"type": "announce", "name": "cabinet"}]
        return message

    recording = load_recording(changed(recorded, tmp_path / "told.mcap", announced))
    assert any(isinstance(entry.edit, Announce) for entry in recording.runs[0].edits)
    report = rerun_run(recording, recording.runs[0])
    assert (report.ok, report.periods) == (True, 30)
    assert "announced furniture" in report.text


def test_what_a_robot_saw_is_of_its_run_also_when_a_server_that_came_again_counts_from_one(recorded, tmp_path):
    path = tmp_path / "twice.mcap"
    file = McapFile(path)
    for later in (False, True):
        for entry in read(recorded):
            message = json.loads(entry.data)
            if entry.topic == ch.TICK.topic:
                message["began"] += 1000.0 * later
            elif entry.topic == ch.OBSERVATIONS.topic and not later and message["index"] == 30:
                message["samples"][0]["pose"][1] += 0.1
            file.add(ch.CHANNELS[entry.topic], entry.log_time / 1e9 + 1000.0 * later, json.dumps(message).encode())
    file.close()
    recording = load_recording(path)
    reports = [rerun_run(recording, run) for run in recording.runs]
    assert [(report.ok, report.period) for report in reports] == [(False, 30), (True, -1)]
