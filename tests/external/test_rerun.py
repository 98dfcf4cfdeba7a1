"""A recorded run of an external robot is computed again from what the robot reported, period by period."""

import functools
import threading
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from meeting import Router, running_robot, until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Load, SetParameter
from motm_twin.bus.library import FileLibrary
from motm_twin.bus.server import RobotChoice, TwinServer
from motm_twin.bus.server_process import make_external_twin
from motm_twin.bus.session import open_member
from motm_twin.planning.types import SearchBudget
from motm_twin.record import rerun_file
from motm_twin.record.observations import ObservationsMessage
from motm_twin.record.recorder import Recorder
from motm_twin.record.recording import Run, load_recording, observations_of
from motm_twin.record.rerun_file import rerun_run

PERIODS = 60


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a robot that was disturbed on its way."""
    folder = tmp_path_factory.mktemp("recorded")
    router, scene = Router(), FileLibrary("exp1").load("exp1", "trial1", None)
    make = functools.partial(make_external_twin, budget=SearchBudget(), sender="twin")
    server = TwinServer(
        library=FileLibrary("exp1"),
        make_twin=lambda scene, method: pytest.fail("the simulated robot was asked for"),
        first=Load(scene="exp1", variant="trial1", method="staa"),
        data=folder,
        robot=RobotChoice(make_twin=make, session=router.session),
    )
    path, stop = folder / "run.mcap", threading.Event()
    with server, TwinClient(server.endpoint) as client, open_member(server.endpoint) as session:
        recorder = Recorder(session, "frankie", path)
        thread = threading.Thread(target=recorder.run, args=(stop,))
        thread.start()
        with running_robot(router, scene, clock="shared"):

            def index() -> int:
                tick = client.tick()
                return -1 if tick is None else tick.index

            until(lambda: index() > 10)
            assert client.command(AddObstacle(name="guest", x=float(scene.start[0]) + 2.0, y=0.0)).ok
            assert client.command(SetParameter(name="bezier", value=False)).ok
            until(lambda: index() > PERIODS)
        stop.set()
        thread.join(30.0)
    router.session.close()
    return path


def test_every_period_is_the_recorded_one(recorded: Path) -> None:
    recording = load_recording(recorded)
    (run,) = (run for run in recording.runs if run.indices)
    assert run.plant == "zenoh"
    assert [type(entry.edit) for entry in run.edits] == [AddObstacle, SetParameter]
    report = rerun_run(recording, run)
    assert (report.ok, report.fields, report.text) == (True, [], "")
    assert report.compared == len(run.indices) > PERIODS


def test_what_the_robot_reported_decides(recorded: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Seen a hand's breadth further to the left, the robot would have driven otherwise."""

    def doctored(path: Path, run: Run) -> Iterator[ObservationsMessage]:
        for message in observations_of(path, run):
            if message.index < 30:
                yield message
                continue
            samples = [
                msgspec.structs.replace(one, pose=[one.pose[0], one.pose[1] + 0.1, one.pose[2]])
                for one in message.samples
            ]
            yield msgspec.structs.replace(message, samples=samples)

    monkeypatch.setattr(rerun_file, "observations_of", doctored)
    recording = load_recording(recorded)
    (run,) = (run for run in recording.runs if run.indices)
    report = rerun_run(recording, run)
    assert (report.ok, report.period) == (False, 30)
    assert any(field.startswith("robot.pose") for field in report.fields)
