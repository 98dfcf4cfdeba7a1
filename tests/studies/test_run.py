"""A sweep can be stopped, can crash, can lose workers; its results are the same, and none is dropped."""

import io
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import msgspec
import pytest
from joblib.externals.loky import get_reusable_executor
from rich.console import Console

from motm_twin.sessions.session import load_session
from motm_twin.studies.pool import Lost, make_pool, outcomes
from motm_twin.studies.run import Store, TimeLeft, left_text, run
from motm_twin.studies.spec import Experiment, TrialSpec

from .made_results import SCENE

HERE = Path(__file__).parent
QUIET = Console(quiet=True)


def drives(count=3, *more):
    specs = tuple(TrialSpec(SCENE, None, seed, method) for seed in range(count) for method in ("motm", "no_bezier"))
    return Experiment("drives", "Half a metre", (*specs, *more))


@pytest.fixture(scope="module")
def mark(tmp_path_factory):
    """The file of a method that dies once; workers that were started before do not know of it."""
    get_reusable_executor().shutdown(kill_workers=True)
    with pytest.MonkeyPatch.context() as patch:
        path = tmp_path_factory.mktemp("mark") / "mark"
        patch.setenv("MOTM_TEST_MARK", str(path))
        yield path


@pytest.fixture(scope="module")
def by_two(mark, tmp_path_factory):
    """Six trials on two processes: the experiment's folder, and its results."""
    out = tmp_path_factory.mktemp("by_two")
    return out / "drives", run(drives(), out=out, workers=2, console=QUIET)


def same_results(one, other):
    return (one / "results.jsonl").read_bytes() == (other / "results.jsonl").read_bytes()


def test_one_worker_and_another_order_give_the_same_bit_for_bit(by_two, tmp_path):
    folder, results = by_two
    again = run(Experiment("drives", "", drives().specs[::-1]), out=tmp_path, workers=1, console=QUIET)
    without_wall = [[result | {"wall": None} for result in each.of("drives")] for each in (again, results)]
    assert without_wall[0] == without_wall[1][::-1]
    forwards = run(drives(), out=tmp_path, console=QUIET)  # from the store, written in another order
    assert forwards.computed == 0
    assert same_results(folder, tmp_path / "drives")


def test_a_result_says_what_was_run_and_keeps_clocks_apart(by_two):
    (result,) = by_two[1].of("drives", method="no_bezier", seed=1)
    assert result["success"]
    assert result["parameters"] == {}
    assert result["measures"]["phases_s"]["driving"] == pytest.approx(result["time_s"], abs=0.2)
    assert set(result["wall"]) == {"tick_ms", "realtime_factor", "seconds"}
    assert not {"tick_ms", "realtime_factor"} & set(result)


def test_a_run_goes_on_where_it_ended_also_after_half_a_line(by_two, tmp_path):
    folder, _ = by_two
    whole, file = (folder / "trials.jsonl").read_bytes(), tmp_path / "drives" / "trials.jsonl"
    lines = whole.splitlines(keepends=True)
    file.parent.mkdir()
    file.write_bytes(b"".join(lines[:4]) + lines[4][:100])
    assert run(drives(), out=tmp_path, workers=2, console=QUIET).computed == 2
    assert same_results(folder, tmp_path / "drives")
    assert len(file.read_bytes().splitlines()) == 6
    file.write_bytes(whole.replace(b'"key":"', b'"key":"x'))  # trials of another source do not count
    assert run(Experiment("drives", "", drives().specs[:1]), out=tmp_path, console=QUIET).computed == 1


def test_a_trial_that_two_experiments_want_is_run_once(by_two, tmp_path):
    spec = drives().specs[0]
    both = [Experiment("a", "", (spec, spec)), Experiment("b", "", (spec,))]
    results = run(both, out=tmp_path, console=QUIET)
    assert results.computed == 1
    assert results.of("a")[0] == results.of("a")[1] == results.of("b")[0]
    assert run(both[1], out=tmp_path, console=QUIET).computed == 0
    with pytest.raises(ValueError, match="same name"):
        run([both[0], both[0]], out=tmp_path, console=QUIET)


def test_what_breaks_is_kept_with_its_reason_and_session_and_run_again_only_when_asked(mark, tmp_path):
    names = ("DIES_ONCE", "DIES", "RAISES")
    once, *bad = [TrialSpec(SCENE, None, 0, f"{HERE / 'broken_methods.py'}:{name}") for name in names]
    impatient = TrialSpec(SCENE, None, 0, changes={"time_limit": 0.2})
    said = Console(file=io.StringIO())
    (died_once,) = run(Experiment("once", "", (once,)), out=tmp_path, workers=2, console=said).of("once")
    assert "a process died" in said.file.getvalue()
    assert mark.exists()
    assert died_once["success"]  # it was killed from outside, as it were, and is begun again
    experiment = Experiment("drives", "", (*bad, impatient))
    results = run(experiment, out=tmp_path, workers=2, console=QUIET)
    dies, raises, late = results.of("drives")
    assert "the process died" in dies["reason"]
    assert "no planner today (broken_methods.py" in raises["reason"]
    assert "time limit" in late["reason"]
    records = Store(tmp_path / "drives").read().values()
    sessions = {record.spec.method.rpartition(":")[2]: record.session for record in records if record.session}
    assert set(sessions) == {"DIES", "RAISES", "motm"}
    kept = load_session(tmp_path / "drives" / sessions["motm"])
    assert kept.state_hash == late["state_hash"]
    assert kept.periods == round(late["time_s"] * 20) + 1
    assert load_session(tmp_path / "drives" / sessions["DIES"]).periods == 100
    assert run(experiment, out=tmp_path, workers=2, console=QUIET).computed == 0
    again = run(Experiment("drives", "", (impatient,)), out=tmp_path, console=QUIET, retry_failed=True)
    assert again.computed == 1


@pytest.mark.parametrize(("send", "number"), [(os.killpg, signal.SIGINT), (os.kill, signal.SIGTERM)])
def test_ctrl_c_ends_at_once_and_says_how_to_go_on(send, number, tmp_path):  # to the group, as a terminal does
    entry = f"Entry(title='t', specs=lambda methods, trials: (TrialSpec({SCENE!r}, None, s) for s in range(100)))"
    program = (
        "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"  # ignored in a background job
        "from motm_twin.studies.catalogue import EXPERIMENTS, Entry;"
        "from motm_twin.cli.bench import main; from motm_twin.studies.spec import TrialSpec;"
        f"EXPERIMENTS['exp1'] = {entry};"
        f"sys.exit(main(['exp1', '--methods', 'motm', '--out', {str(tmp_path)!r}]))"
    )
    process = subprocess.Popen(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
        start_new_session=True, cwd=HERE.parents[1],
    )  # fmt: skip
    store = tmp_path / "exp1" / "trials.jsonl"
    while not (store.is_file() and store.stat().st_size) and process.poll() is None:
        time.sleep(0.05)
    send(process.pid, number)
    said = process.communicate(timeout=60)[0]
    assert process.returncode == 130, said
    assert "resumes there" in said
    assert "Traceback" not in said
    assert 1 <= len(Store(tmp_path / "exp1").read()) < 100
    deadline = time.monotonic() + 60.0
    with pytest.raises(ProcessLookupError):  # no process of the group lives
        while time.monotonic() < deadline:
            os.killpg(process.pid, 0)
            time.sleep(0.05)


def test_a_second_run_on_the_same_folder_is_refused(tmp_path):
    with Store(tmp_path), pytest.raises(ValueError, match="another run writes"), Store(tmp_path):
        pass


def test_bad_input_is_refused_before_anything_runs(tmp_path):
    wrong = Experiment("x", "", (TrialSpec(SCENE), TrialSpec(SCENE, parameters={"next_weigth": 1.0})))
    with pytest.raises(ValueError, match="next_weigth"):
        run(wrong, out=tmp_path, console=QUIET)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("given", "said"),
    [((1, "dask"), "backend 'dask'"), ((0,), "at least 1"), ((1, "loky", "auto"), "--backend ray"),
     ((2, "ray"), r"motm-twin\[cluster\]")],
)  # fmt: skip
def test_a_pool_that_cannot_be_is_refused_and_without_ray_it_is_said_what_to_install(given, said, monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ValueError, match=said):
        make_pool(*given)


def test_time_left_is_that_of_each_method():
    left = TimeLeft(workers=2, remaining=Counter({"fast": 3, "slow": 3, "unseen": 1}))
    assert left.left() is None
    left.add("fast", 10.0)
    left.add("slow", 50.0)
    assert left.left() == (2 * 10.0 + 2 * 50.0 + 30.0) / 2
    assert left_text(3900.0) == "1 h 05 min left"


def test_a_store_reads_what_it_wrote_and_nothing_else(by_two):
    folder, results = by_two
    records = Store(folder).read().values()
    wrote, read = results.of("drives"), [record.result for record in records]
    assert sorted(map(msgspec.json.encode, read)) == sorted(map(msgspec.json.encode, wrote))
    assert len(records) == 6
    assert all(record.made_with["numpy"] for record in records)


def _square_or_die(number):
    return number * number if number != 3 else os._exit(1)


def test_only_the_call_that_kills_its_process_is_given_up():
    told = []
    found = dict(outcomes(_square_or_die, range(6), make_pool(2), told.append))
    assert isinstance(found.pop(3), Lost)
    assert found == {number: number**2 for number in (0, 1, 2, 4, 5)}
    assert told
