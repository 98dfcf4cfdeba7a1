"""The same run under other parameters, beside the run as it was."""

import io
import json
import multiprocessing
import os
import signal
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import msgspec
import pytest
from rich.console import Console
from waiting import until

from motm_twin.cli.run import BothRuns
from motm_twin.model.edits import AddObstacle, InsertTask, MoveBody, SetParameter
from motm_twin.model.scene import DriveTo
from motm_twin.model.scene_file import load_scene
from motm_twin.program import OK
from motm_twin.record import what_if
from motm_twin.record.replay import rerun
from motm_twin.record.what_if import AS_IT_WAS, CHANGED, Outcome, Sample, parse_changes, run_one, start_period
from motm_twin.sessions.session import LoggedEdit, Session, SessionError, encode_session, save_session
from motm_twin.trial import run_scene
from motm_twin.twin import Twin

replace = msgspec.structs.replace
SLOW = {"next_weight": 0.5, "bezier": False}


def drive_scene(tasks=((1.2, 0.0), (1.2, -0.6))):
    """A short job: two places to drive to, for a base without an arm, whose periods cost a third."""
    scene = load_scene("exp1", "trial1", 0)
    robot = replace(scene.robot, has_arm=False)
    return replace(scene, robot=robot, tasks=tuple(DriveTo(point=point) for point in tasks), time_limit=60.0)


def saved(scene, periods=40, edits=None):
    twin = Twin(scene)
    for index in range(periods):
        for edit in (edits or {}).get(index, []):
            twin.post(edit)
        twin.advance()
    return twin.session()


@pytest.fixture(scope="module")
def session():
    return saved(drive_scene(), edits={10: [AddObstacle(name="guest", shape="temi", x=2.0, y=1.0)]})


def ends(session, changes, start=0):
    *samples, end = run_one(session, changes=changes, start=start)
    assert all(isinstance(sample, Sample) for sample in samples) and isinstance(end, Outcome)
    return samples, end


@pytest.fixture(scope="module")
def as_it_was(session):
    return ends(session, {})


@pytest.fixture(scope="module")
def slowed(session):
    """The run with other parameters from its first second on."""
    return ends(session, SLOW, start=20)


def test_the_run_as_it_was_goes_on_to_the_end_of_its_tasks(session, as_it_was):
    samples, end = as_it_was
    assert (end.run, end.success, end.reason, end.skipped) == (AS_IT_WAS, True, "", ())
    assert end.time_s > session.periods * 0.05 and end.path_length > 1.0
    assert [sample.time for sample in samples[:4]] == pytest.approx([0.0, 0.1, 0.2, 0.3])
    assert (len(samples[0].pose), len(samples[0].q)) == (3, 7)
    assert not samples[0].movers  # the guest comes later
    assert samples[-1].movers == ((2.0, 1.0, 0.25, 1.0),), "who moves about is told with the robot"


def test_a_run_that_was_recorded_to_its_end_ends_at_its_recorded_time(clocked):
    twin = clocked(drive_scene())
    ticks = [twin.advance()]
    while not ticks[-1].done:
        ticks.append(twin.advance())
    assert twin.cuts
    finished, at_once = ticks[-1], twin.session()
    for _ in range(45):
        ticks.append(twin.advance())
    for session in (at_once, twin.session()):
        samples, end = ends(session, {})
        assert (end.time_s, end.forecast_from_s) == (round(finished.time, 3), None)
        assert (end.success, end.path_length) == (True, round(finished.truth.path_length, 3))
        assert samples[-1].time == end.time_s
        assert samples[-1].pose == pytest.approx(finished.truth.pose, abs=1e-4)


@pytest.mark.parametrize("limit", [60.0, 1.0])
def test_run_rerun_and_what_if_tell_the_same_time(limit):
    scene = load_scene("generated:41@0")  # a short way from the cube to its bin
    scene = replace(scene, tasks=scene.tasks[:2], time_limit=limit)
    done = []
    report = run_scene(scene, on_tick=lambda tick: done.append(tick.done))
    session = Session(scene=scene, periods=len(done), state_hash=report["state_hash"], method=report["method"])
    assert (report["places_done"], report["time_s"] >= limit) == ((1, False) if limit > 1.0 else (0, True))
    assert sum(done) > 1 or limit == 1.0  # a cube falls when the last task is done
    again, (_, end) = rerun(session), ends(session, {})
    assert again.ok
    assert (again.time_s, end.time_s) == (report["time_s"], report["time_s"])
    assert end.forecast_from_s is None


def test_without_a_terminal_a_what_if_says_how_far_both_runs_are():
    said = io.StringIO()
    with BothRuns(60.0, Console(file=said)) as progress:
        at = {"pose": (0.0,) * 3, "q": (0.0,) * 7, "gripper": 0.0}
        for tenth in range(200):
            for run in (AS_IT_WAS, CHANGED):
                progress.add(Sample(run=run, time=0.1 * tenth, **at))
    assert said.getvalue().splitlines() == [
        "  running both: 60.00 s are recorded",
        "  as it was: 6 s, changed: 6 s",
        "  as it was: 12 s, changed: 12 s",
        "  as it was: 18 s, changed: 18 s",
    ]


def test_what_was_not_recorded_is_called_a_forecast(session, as_it_was, slowed):
    assert as_it_was[1].forecast_from_s == 2.0
    assert slowed[1].forecast_from_s == 1.0
    assert ends(replace(session, periods=20), {})[1].forecast_from_s == 1.0


def test_the_changed_run_is_the_same_until_its_moment_and_another_from_then_on(as_it_was, slowed):
    was, _ = as_it_was
    changed, end = slowed
    assert end.run == CHANGED
    same = [(one.pose, one.q) == (other.pose, other.q) for one, other in zip(was, changed, strict=False)]
    assert all(same[:10])
    assert not all(same[10:])


def test_recorded_settings_of_a_changed_parameter_do_not_undo_the_change():
    edits = {5: [SetParameter(name="bezier", value=False)], 10: [SetParameter(name="bezier")]}
    session = saved(drive_scene(), periods=20, edits=edits)
    stays = ends(session, {"bezier": False}, start=0)[0]
    alone = ends(replace(session, edits=()), {"bezier": False}, start=0)[0]
    assert [one.pose for one in stays] == [one.pose for one in alone]


def test_an_edit_that_only_the_recorded_run_could_take_is_left_out_and_named(session):
    tail = LoggedEdit(index=30, edit=MoveBody(name="nobody", x=1.0, y=1.0))
    session = replace(session, edits=(*session.edits, tail))
    _, end = ends(session, SLOW, start=20)
    assert len(end.skipped) == 1
    assert end.skipped[0].startswith("1.50 s: MoveBody")
    for changes, start in (({}, 0), (SLOW, 35)):
        with pytest.raises(SessionError, match=r"1\.50 s: MoveBody.*nobody"):
            ends(session, changes, start)


def test_a_run_waits_for_tasks_that_a_person_adds_later():
    session = saved(drive_scene(tasks=((0.4, 0.0),)), periods=140)
    assert ends(session, {})[1].time_s < 5.0
    added = LoggedEdit(index=120, edit=InsertTask(tasks=(DriveTo(point=(1.2, 0.0)),)))
    _, end = ends(replace(session, edits=(added,)), {})
    assert end.success
    assert end.time_s > 6.0


def fenced(session):
    """The session with walls round the robot."""
    walls = [(0.85, 0.0, 0.3, 1.8), (-0.85, 0.0, 0.3, 1.8), (0.0, 0.8, 1.3, 0.3), (0.0, -0.8, 1.3, 0.3)]
    solid = [AddObstacle(name=f"wall{i}", x=x, y=y, size=(sx, sy, 0.8)) for i, (x, y, sx, sy) in enumerate(walls)]
    return replace(session, edits=tuple(LoggedEdit(index=0, edit=wall) for wall in solid))


def test_a_run_whose_tasks_are_given_up_ends_with_their_reasons(session):
    _, end = ends(fenced(session), {})
    assert not end.success and end.time_s < 25.0
    assert end.reason.count("not free for 10 s") == 2  # one drive after the other


def test_a_run_that_gets_nowhere_ends_with_the_reason(session, monkeypatch):
    monkeypatch.setattr("motm_twin.record.what_if.PATIENCE", 5.0)
    _, end = ends(fenced(session), {})
    assert not end.success and end.time_s == pytest.approx(7.0, abs=0.2)
    assert "nothing was achieved for 5 s during drive_to" in end.reason


@pytest.mark.parametrize(
    ("texts", "words"),
    [
        ([], "at least one"),
        (["next_weight"], "name=value"),
        (["next_wait=1"], "next_weight"),
        (["next_weight=heavy"], "heavy"),
        (["next_weight=nan"], "number"),
        (["next_weight=99"], "out of range"),
        (["bezier=perhaps"], "perhaps"),
        (["termination=never"], "pass"),
        (["bezier=on", "bezier=off"], "twice"),
    ],
)
def test_changes_that_cannot_be_are_refused_with_what_is_allowed(texts, words):
    with pytest.raises(SessionError, match=words):
        parse_changes(texts)


def test_changes_are_read_by_the_kind_of_their_parameter():
    changes = {"next_weight": 0.5, "bezier": False, "termination": "pass"}
    assert parse_changes(["next_weight=0.5", "bezier=off", "termination=pass"]) == changes


def test_the_moment_of_the_change_must_be_in_the_session(session):
    assert [start_period(session, seconds) for seconds in (1.0, 2.0)] == [20, 40]
    for wrong in (-1.0, 2.1, float("nan"), float("inf")):
        with pytest.raises(SessionError, match="0 to 2 s"):
            start_period(session, wrong)


@pytest.fixture
def stream(tmp_path, monkeypatch, capfd):
    """Output of the program about a session, and its exit code."""
    monkeypatch.setattr(what_if, "_end_with_input", lambda: None)  # it would end this process

    def called(session, changes, start=0.0, file="run.json"):
        save_session(session, tmp_path / "run.json")
        (tmp_path / "empty.json").write_text("{}")
        code = what_if.stream(str(tmp_path / file), changes, start)
        out, err = capfd.readouterr()
        assert "Traceback" not in err
        return code, [json.loads(line) for line in out.splitlines()]

    return called


def test_both_runs_are_streamed_as_json_lines(session, as_it_was, slowed, stream):
    code, lines = stream(session, ["next_weight=0.5", "bezier=off"], 1.0)
    assert code == 0
    for run, (samples, end) in ((AS_IT_WAS, as_it_was), (CHANGED, slowed)):
        mine = [line for line in lines if line["run"] == run]
        assert mine[-1]["done"] is True
        assert mine == json.loads(msgspec.json.encode([*samples, end]))


@pytest.mark.parametrize(
    ("file", "changes", "seconds", "words"),
    [
        ("none.json", ["bezier=off"], 0.0, "no such file"),
        ("empty.json", ["bezier=off"], 0.0, "session"),
        ("run.json", ["bezeer=off"], 0.0, "bezier"),
        ("run.json", ["bezier=off"], 99.0, "0 to 2 s"),
        ("run.json", [], 0.0, "at least one"),
    ],
)
def test_bad_input_is_one_json_line_and_exit_code_two(session, stream, file, changes, seconds, words):
    code, (line,) = stream(session, changes, seconds, file)
    assert code == 2
    assert words in line["error"]


def test_a_session_that_one_of_the_processes_cannot_run_is_bad_input(session, stream, monkeypatch):
    def compare(session, values, start, method):
        """The run as it was, here."""
        read, write = multiprocessing.Pipe(duplex=False)
        what_if._work(encode_session(session), {}, start, AS_IT_WAS, method, write)
        yield from what_if._lines({read: AS_IT_WAS})

    monkeypatch.setattr(what_if, "compare", compare)
    monkeypatch.setattr(what_if, "end_with_parent", lambda: None)
    monkeypatch.setattr(what_if, "NICE", 0)
    wrong = LoggedEdit(index=0, edit=MoveBody(name="nobody", x=0.0, y=0.0))
    code, lines = stream(Session(scene=session.scene, edits=(wrong,), periods=5), ["bezier=off"])
    assert code == 2
    (line,) = (line for line in lines if "error" in line)
    assert "nobody" in line["error"]


linux = pytest.mark.skipif(not Path("/proc/self/task").exists(), reason="needs Linux's /proc")


def gone(pids):
    """Wait until none of the processes is there; a zombie of somebody else's child does not count."""
    until(lambda: not [pid for pid in pids if Path(f"/proc/{pid}").exists() and _state(pid) not in ("Z", "")], "left")


def _state(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rpartition(")")[2].split()[0]
    except OSError:
        return ""


@pytest.fixture
def both_run(tmp_path):
    """A program that runs both, and its processes; nobody reads what it writes, so it is never done."""
    path = tmp_path / "run.json"
    save_session(Session(scene=drive_scene(tasks=((1.2, 0.0), (1.2, -0.6)) * 20), periods=4), path)
    options = [str(path), "--set", "bezier=off", "--from", "0.1", "--stream"]
    pipes = dict.fromkeys(("stdin", "stdout", "stderr"), subprocess.PIPE)
    process = subprocess.Popen([sys.executable, "-m", "motm_twin.record.what_if", *options], text=True, **pipes)
    try:
        assert "pose" in json.loads(process.stdout.readline())
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
        assert len(children) >= 2
        yield process, [process.pid, *map(int, children)]
    finally:
        process.kill()
        process.wait()


@linux
def test_both_runs_end_with_whoever_started_them(both_run):
    process, pids = both_run
    process.stdin.close()
    process.wait(timeout=30)
    gone(pids)


def test_it_ends_when_nobody_reads_its_output(monkeypatch):
    read, write = os.pipe()
    os.close(read)
    monkeypatch.setattr(what_if, "os", SimpleNamespace(_exit=sys.exit))
    with os.fdopen(write, "wb", buffering=0) as output, pytest.raises(SystemExit) as end:
        monkeypatch.setattr(sys, "stdout", SimpleNamespace(buffer=output))
        what_if._print({"error": "nobody reads"})
    assert end.value.code == OK


@linux
def test_a_run_whose_process_dies_is_told_and_takes_the_other_with_it(both_run):
    process, pids = both_run
    run = next(pid for pid in pids if "spawn_main" in Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8"))
    os.kill(run, signal.SIGKILL)
    out = process.stdout.read()  # its standard input stays open
    assert process.wait(timeout=30) == 1
    assert "ended before it was done" in json.loads(out.splitlines()[-1])["error"]
    gone(pids)
