"""The examples for those who build on it run, and what docs/extend.md shows works as it is, in a folder of its own."""

import json
import math
import os
import re
import runpy
import signal
import statistics
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from motm_twin.methods.registry import METHODS, find_method
from motm_twin.model.kinematics import Frankie
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
SHORT = ROOT / "tests" / "studies" / "half_a_metre.yaml"  # a trial of a second
OWN = ("own_placement_rule.py:STRAIGHT", "own_base_controller.py:PURSUIT")


@pytest.fixture
def started(capfd, monkeypatch, tmp_path):
    """An example with these words, in this process and an empty folder: its exit code and what it printed."""

    def called(name, *words):
        monkeypatch.chdir(tmp_path)
        monkeypatch.syspath_prepend(EXAMPLES)
        monkeypatch.setattr(sys, "argv", [str(EXAMPLES / name), *map(str, words)])
        code = 0
        try:
            runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        except SystemExit as end:
            code = end.code or 0
        return code, *capfd.readouterr()

    return called


@pytest.fixture
def run(started):
    """Output of an example that ends well."""

    def called(name, *words):
        code, out, err = started(name, *words)
        assert code == 0, out + err
        return out

    return called


def blocks():
    return re.findall(r"```python\n(.*?)```", (ROOT / "docs" / "extend.md").read_text(encoding="utf-8"), re.S)


def twin_of(method, periods=6):
    """A twin of the method after some periods, which went on from a snapshot as they went at first."""
    twin = Twin(load_scene("exp1", "trial1", 0), method=find_method(method))
    for _ in range(periods):
        tick = twin.advance()
    there = twin.snapshot()
    first = [twin.advance().plan.acceleration.tolist() for _ in range(3)]
    end = twin.state_hash()
    twin.restore(there)
    assert [twin.advance().plan.acceleration.tolist() for _ in range(3)] == first
    assert twin.state_hash() == end
    return twin, tick


@pytest.mark.parametrize("name", OWN)
def test_a_method_in_a_file_drives_and_can_be_copied(name):
    twin, tick = twin_of(str(EXAMPLES / name))
    assert twin.method.name not in METHODS
    assert tick.placement.chosen >= 0
    assert tick.plan.acceleration[0] > 0.0


def test_the_rule_of_the_text_works_as_it_is_shown(tmp_path):
    (tmp_path / "my_rule.py").write_text(blocks()[0], encoding="utf-8")
    _, tick = twin_of(f"{tmp_path / 'my_rule.py'}:MINE")
    _, paper = twin_of("motm")
    own, usual = tick.placement, paper.placement
    assert np.array_equal(own.poses, usual.poses)
    price = own.cost_current[np.isfinite(own.cost)] - usual.cost_current[np.isfinite(own.cost)]
    assert price.min() > -1e-9 and 0.5 < price.max() < 8.0 * 0.25


def test_the_arm_of_the_text_leaves_by_its_own_rule(tmp_path):
    (tmp_path / "early.py").write_text(blocks()[1], encoding="utf-8")
    twin = Twin(load_scene("exp1", "trial1", 0), method=find_method(f"{tmp_path / 'early.py'}:EARLY"))
    ticks = [twin.advance() for _ in range(90)]
    left = next(tick for tick in ticks if tick.arm[0].phase == "transit")
    assert 3.8 < left.plan.time_to_range <= 4.0


def test_the_limit_of_the_text_keeps_the_hand_below_its_ceiling(tmp_path):
    scene = load_scene("exp1", "trial1", 0)
    text = blocks()[2].replace("Ceiling(1.0)", "Ceiling(0.8)")
    (tmp_path / "low.py").write_text(text, encoding="utf-8")
    frankie, highest = Frankie(scene.robot), {}
    for method in ("motm", f"{tmp_path / 'low.py'}:LOW"):
        twin = Twin(scene, method=find_method(method))
        seen = [twin.advance() for _ in range(120)]
        heights = [frankie.tcp_pose(tick.observation.odometry, tick.observation.q)[0][2] for tick in seen[40:]]
        highest[twin.method.name] = max(heights)
    assert any("ceiling" in tick.arm[-1].active for tick in seen)
    assert highest["low"] < 0.8 < highest["motm"] - 0.02


def test_a_first_run_tells_where_the_time_goes(run, tmp_path):
    said = run("first_run.py", "--limit", 2, "--save", "where.png")
    assert re.search(r"time \[s\] for +driving +turning +standing", said)
    assert "0 of 6 placed in 2.0 s" in said
    assert (tmp_path / "where.png").read_bytes().startswith(b"\x89PNG")


def test_the_placement_rule_is_compared_with_the_paper_s(run, in_this_process, tmp_path):
    methods = ("motm", EXAMPLES / "own_placement_rule.py:STRAIGHT")
    few = ("--trials", 1, "--limit", 1, "--workers", 1, "--out", "out")
    said = run("compare_two_controllers.py", *methods, *few)
    assert said.count("0 of 6 placed, success 0 % [0, 98]") == 2
    assert "there are no times to compare" in said
    assert [result["variant"] for result in kept(tmp_path)] == ["random", "random"]


def kept(folder):
    """Results that a comparison left behind, in the order in which they were run."""
    lines = (folder / "out" / "compare" / "trials.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line)["result"] for line in lines]


def test_two_controllers_are_compared_by_seed_with_an_interval(run, in_this_process, tmp_path):
    """In a scene without variants, whose trials end within a second or two: the difference needs trials that end."""
    few = ("--trials", 3, "--workers", 1, "--out", "out")
    said = run("compare_two_controllers.py", "motm", "staa", "--scene", SHORT, *few)
    assert said.count("0 of 0 placed, success 100 % [29, 100]") == 2
    times = {method: [r["time_s"] for r in kept(tmp_path) if r["method"] == method] for method in ("motm", "staa")}
    for seed, (ours, theirs) in enumerate(zip(*times.values(), strict=True)):
        assert f"seed {seed:3}: {ours:6.1f} s and {theirs:6.1f} s" in said
    by_seed = [theirs - ours for ours, theirs in zip(*times.values(), strict=True)]
    half = 4.303 * statistics.stdev(by_seed) / math.sqrt(3)  # Student's t of two degrees of freedom
    (line,) = [line for line in said.splitlines() if "longer than" in line]
    found = re.fullmatch(r"staa takes (\S+) \[(\S+), (\S+)\] s longer than motm \(3 seeds\)", line)
    assert found, line
    middle = statistics.mean(by_seed)
    assert abs(middle) > 0.05  # or the sign could not be wrong
    wanted = (middle, middle - half, middle + half)
    assert [float(number) for number in found.groups()] == pytest.approx(wanted, abs=0.051)


WEIGHTS = {"W0": 0.0, "W1": 1.0, "W2": 2.0, "W10": 10.0, "W20": 20.0, "W40": 40.0, "EARLY2": 2.0, "EARLY10": 10.0}


@pytest.mark.parametrize("name", WEIGHTS)
def test_the_weights_of_sequential_are_what_their_names_say(name):
    method = find_method(f"{EXAMPLES / 'sequential_weights.py'}:{name}")
    twin = Twin(load_scene("exp1", "trial1", 0), method=method)
    placement = twin.advance().placement
    strategy, controller = twin.loop.planner.placement, twin.loop.planner.controller
    assert strategy.stationary.manipulability_weight == WEIGHTS[name]
    beside = placement.cost[placement.chosen] - placement.cost_current[placement.chosen]
    beside -= placement.cost_next[placement.chosen]  # what is left is the manipulability's
    assert -1e-9 <= beside <= WEIGHTS[name] + 1e-9
    assert controller._overlap == name.startswith("EARLY")


@pytest.mark.parametrize(
    ("example", "name", "own"),
    [("own_placement_rule.py", "STRAIGHT", "straight_lines"), ("own_base_controller.py", "PURSUIT", "pursuit")],
)
def test_a_method_s_script_runs_one_trial_by_it_and_one_by_the_paper_s(example, name, own, run):
    lines = run(example, "--limit", 1).splitlines()
    assert [line.split(":")[0] for line in lines[:2]] == [own, "motm"]
    assert all("0 of 6 placed in 1.00 s" in line for line in lines[:2])
    assert lines[2].endswith(f"motm-twin bench exp1 --methods motm {EXAMPLES / example}:{name}")


@pytest.mark.parametrize(
    ("example", "given", "said"),
    [
        ("one_trial.py", ["nosuch"], "there is no method 'nosuch'"),
        ("first_run.py", ["nosuch"], "no scene is called 'nosuch'"),
        ("compare_two_controllers.py", ["motm", "nosuch.py:MINE"], "nosuch.py: there is no such file"),
    ],
)
def test_what_its_user_gave_wrong_is_one_sentence(example, given, said, started):
    code, _, err = started(example, *given)
    assert code == 2
    (line,) = err.splitlines()
    assert line.startswith(said)


def test_an_example_that_is_stopped_says_so():
    code = (
        "import runpy, signal, sys;"
        "signal.signal(signal.SIGINT, signal.default_int_handler);"  # ignored in a background job
        "sys.argv = sys.argv[1:]; runpy.run_path(sys.argv[0], run_name='__main__')"
    )
    command = [sys.executable, "-c", code, EXAMPLES / "one_trial.py", "motm"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        assert process.stdout.read(5) == "motm:"
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=60.0)[1]
    assert (process.returncode, said) == (130, "stopped\n")


def test_every_example_ends_with_one_sentence():
    for example in EXAMPLES.glob("*.py"):
        text = example.read_text(encoding="utf-8")
        if "\ndef main(" in text and "motm_twin" in re.findall(r"^(?:from|import) (\w+)", text, re.M):
            assert "\n@clean_exit()\ndef main(" in text, example.name


def test_without_gymnasium_the_policies_say_what_to_install(tmp_path):
    """As if it was not there: a module of its name that cannot be imported comes first on the path."""
    (tmp_path / "gymnasium.py").write_text("raise ModuleNotFoundError(\"No module named 'gymnasium'\")\n")
    command = [sys.executable, EXAMPLES / "gym_policies.py", "towards"]
    there = {**os.environ, "PYTHONPATH": f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False, env=there)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.endswith(f"which is not installed: {sys.executable} -m pip install 'gymnasium>=1.0'")


@pytest.mark.parametrize("policy", ["towards", "expert"])
def test_a_policy_runs_in_the_environment(policy, run, tmp_path):
    pytest.importorskip("gymnasium")
    said = run("gym_policies.py", policy, "--steps", 20, "--save", "last.png")
    assert said.startswith(f"{policy}: 0 picked, 0 placed, 0 contacts caused in 1.0 s")
    assert (tmp_path / "last.png").is_file()


@pytest.mark.parametrize("name", ["first_run.py", "own_placement_rule.py", "own_base_controller.py", "gym_policies.py"])
def test_the_texts_lead_to_the_examples(name):
    texts = "".join((ROOT / "docs" / text).read_text(encoding="utf-8") for text in ("extend.md", "gym.md"))
    assert f"](../examples/{name})" in texts
