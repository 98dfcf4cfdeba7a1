"""`bench people` and `bench tracker`: cases, the oracle, what the robot imposes, what is matched, and the tables."""

import json
import math

import msgspec
import numpy as np
import pytest

from motm_twin.cli.bench import main
from motm_twin.measures.agents import base_gap
from motm_twin.model.plant import Scan
from motm_twin.model.scene_file import load_scene
from motm_twin.studies.oracle import require_known_future, search
from motm_twin.studies.people import (
    ORACLE,
    SITUATIONS,
    Score,
    Situation,
    alone,
    beams_on,
    bench_people,
    bench_tracker,
    cases,
    imposed,
    matched,
    meet,
    summaries,
)
from motm_twin.twin import Twin

pytestmark = pytest.mark.usefixtures("in_this_process")
BODY = (0.0, 0.7, 0.5)
LIMITS = np.array([1.0, 0.5, 1.75, 1.0, 1.75])
GOAL = np.array([4.0, 0.0, 0.2])


@pytest.fixture
def short(monkeypatch):
    """The situation "turns" ends after 5 s."""
    monkeypatch.setitem(SITUATIONS, "turns", Situation("people", "turns", {"time_limit": 5.0}))


def test_every_situation_is_a_scene():
    for name, situation in SITUATIONS.items():
        (case,) = cases([name], ["fast"], 1)
        assert case.job.scene.agents, name
        assert case.job.spec.method == situation.spec(0, "fast").method


def test_agents_alone_do_not_depend_on_the_robot():
    seen, unseen = (alone(load_scene("circle:2", variant), 40) for variant in ("visible", "invisible"))
    assert all(np.array_equal(seen[name], unseen[name]) for name in seen)


def test_what_the_robot_imposes_is_the_difference_to_the_ways_without_it():
    straight = np.column_stack([0.05 * np.arange(101), np.zeros(101)])
    aside = straight.copy()
    aside[50:, 1] = 0.3
    found = imposed({"a": aside}, {"a": straight})
    assert found["imposed_path_m"] == pytest.approx(np.hypot(0.05, 0.3) - 0.05, abs=1e-3)
    assert found["imposed_velocity_change_mps"] == pytest.approx(2.0 * 0.3 / 0.05, abs=1e-6)
    assert found["imposed_deviation_m"] == pytest.approx(0.3 * 51 / 101, abs=1e-4)
    assert imposed({"a": straight}, {"a": straight})["imposed_path_m"] == 0.0
    assert imposed({}, {})["imposed_deviation_m"] == 0.0


def test_situations_are_run_and_make_one_table(tmp_path, short, console):
    bench_people(["turns"], ["fast"], 1, 1, tmp_path, console)
    report = json.loads((tmp_path / "people.json").read_text(encoding="utf-8"))
    (row,), (whole,) = report["rows"], report["whole"]
    assert row["situation"] == "turns"
    assert row["contacts_base_moved_towards"] <= row["contacts"]
    assert row["least_gap_m"] >= 0.0
    assert whole == summaries([row])[0]
    assert whole["success_interval_percent"][0] <= whole["success_percent"] <= whole["success_interval_percent"][1]
    assert "turns" in console.export_text()


def test_what_was_run_before_is_not_run_again(tmp_path, short, console):
    """Broken off after 42 of 150 trials, it had kept nothing."""
    bench_people(["turns"], ["fast"], 1, 1, tmp_path, console)
    kept, report = tmp_path / "people.jsonl", tmp_path / "people.json"
    first = json.loads(report.read_text(encoding="utf-8"))
    line = kept.read_bytes()
    kept.write_bytes(line.replace(b"turns", b"group") + line + line[:40])  # another case, this one, one that was cut
    bench_people(["turns"], ["fast"], 1, 1, tmp_path, console)
    again = json.loads(report.read_text(encoding="utf-8"))
    assert (again["rows"], again["whole"]) == (first["rows"], first["whole"])
    said = console.export_text()
    assert "1 of 1 are known" in said and said.count("turns seed 0 fast") == 1
    assert len(kept.read_bytes().splitlines()) == 2
    kept.write_bytes(line.replace(line.split(b'"')[1], b"another source"))
    bench_people(["turns"], ["fast"], 1, 1, tmp_path, console)
    assert "turns seed 0 fast" in console.export_text()


@pytest.mark.parametrize(
    ("options", "said"), [("--situations circus", "circle"), ("--methods nobody", "nobody"), ("--trials 0", "0 trials")]
)
def test_names_and_numbers_that_are_none_are_refused(options, said, tmp_path, capsys):
    assert main(["people", *options.split(), "--out", str(tmp_path)]) == 2
    assert said in capsys.readouterr().out


def test_trials_begin_with_the_seed_that_is_named():
    assert [case.job.scene.seed for case in cases(["circle"], ["fast"], 2, 20)] == [20, 21]
    with pytest.raises(ValueError, match="from seed -1"):
        cases(["circle"], ["fast"], 2, -1)


def test_without_anybody_it_drives_straight_on():
    way, found = search(np.zeros(5), GOAL, np.zeros((400, 0, 2)), np.zeros(0), BODY, LIMITS, np.zeros(0))
    assert found
    assert 4.0 <= 0.5 * len(way) <= 5.0
    assert np.abs(way[:, 1]).sum() <= 2.0 * 1.75


def test_it_waits_or_goes_round_one_who_crosses_its_way_just_then():
    times = 0.05 * np.arange(600)
    tracks = np.column_stack([np.full(600, 2.0), -2.0 + 0.8 * times])[:, None]
    way, found = search(np.zeros(5), GOAL, tracks, np.array([0.3]), BODY, LIMITS, np.array([0.1]))
    assert found
    state, least = np.zeros(5), np.inf
    for k, push in enumerate(np.repeat(way, 10, axis=0)):
        state[3] = np.clip(state[3] + 0.05 * push[0], -0.5, 1.0)
        state[4] = np.clip(state[4] + 0.05 * push[1], -1.75, 1.75)
        state[2] += 0.05 * state[4]
        state[:2] += 0.05 * state[3] * np.array([np.cos(state[2]), np.sin(state[2])])
        least = min(least, base_gap(BODY, state[:3], *tracks[k + 1, 0], 0.3))
    assert least > 0.0


def test_it_crosses_a_circle_of_people_who_do_not_see_it():
    (case,) = cases(["circle_invisible"], [ORACLE], 1)
    result = meet(case)
    assert result["method"] == ORACLE
    assert result["success"], result["reason"]
    assert result["least_gap_m"] > 0.0


def test_it_refuses_agents_whose_future_depends_on_the_robot_and_rooms_with_furniture():
    with pytest.raises(ValueError, match="do not see the robot"):
        require_known_future(load_scene("circle:0", "visible"))
    with pytest.raises(ValueError, match="only drives"):
        require_known_future(load_scene("exp2", "blind"))


def test_beams_that_end_on_an_agent_are_counted_from_the_true_pose():
    step = math.radians(1.0)
    ranges = np.full(360, np.inf)
    for i in range(360):  # a disc of 0.25 m, 2 m to the left of a base that looks along y
        off = math.remainder(-math.pi + i * step - math.pi / 2, 2.0 * math.pi)
        if abs(2.0 * math.sin(off)) < 0.25 and abs(off) < 1.0:
            ranges[i] = 2.0 * math.cos(off) - math.sqrt(0.25**2 - (2.0 * math.sin(off)) ** 2)
    scan = Scan(stamp=0.0, ranges=ranges, angle_min=-math.pi, angle_step=step, origin=np.zeros(2), range_min=0.05,
                range_max=15.0, pose=np.zeros(3))  # fmt: skip
    pose = np.array([1.0, 1.0, math.pi / 2])
    assert beams_on(scan, pose, (-1.0, 1.0, 0.25)) == np.isfinite(ranges).sum() >= 10
    assert beams_on(scan, pose, (-1.0, 2.0, 0.25)) == 0


def test_most_pairs_within_the_gate_are_matched():
    rows, columns = matched(np.array([[0.0, 0.0], [0.45, 0.0]]), np.array([[0.2, 0.0], [-0.4, 0.0], [9.0, 0.0]]))
    assert list(zip(rows.tolist(), columns.tolist(), strict=True)) == [(0, 1), (1, 0)]
    assert len(matched(np.zeros((0, 2)), np.zeros((3, 2)))[0]) == 0


def test_a_perfect_tracker_scores_one_and_one_that_sees_nothing_zero():
    scene = load_scene("people", "crossing")
    perfect, blind, twin = Score(scene), Score(scene), Twin(scene)
    places = [agent.start[:2] for agent in scene.agents]
    for _ in range(60):
        tick = twin.advance()
        tracks = np.array([(x, y, 0.0, 0.0, 0.25, 0.02, number) for number, (x, y) in enumerate(places)])
        places = [body.position[:2] for body in tick.truth.agents]
        perfect.add(msgspec.structs.replace(tick, map=msgspec.structs.replace(tick.map, tracks=tracks)))
        blind.add(msgspec.structs.replace(tick, map=msgspec.structs.replace(tick.map, tracks=tracks[:0])))
    best, worst = perfect.report(), blind.report()
    assert best["num_objects"] > 100
    assert (best["mota"], best["num_switches"]) == (1.0, 0)
    assert best["motp"] == pytest.approx(0.0, abs=1e-9)
    assert worst["mota"] == 0.0


def test_a_run_is_scored_and_makes_a_table(tmp_path, short, console):
    assert bench_tracker(["turns"], 1, 1, tmp_path, console)
    report = json.loads((tmp_path / "tracker.json").read_text(encoding="utf-8"))
    (row,), (whole, everything) = report["rows"], report["whole"]
    assert whole["mota"] == pytest.approx(row["mota"])
    assert everything["situation"] == "all"
    assert 0.0 < row["scan_ms"]["p50"] < 50.0
    assert "MOTA" in console.export_text()


def test_without_motmetrics_it_says_what_to_install(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("motm_twin.studies.people.find_spec", lambda name: None)
    assert main(["tracker", "--out", str(tmp_path)]) == 2
    assert 'pip install "motm_twin[people]"' in capsys.readouterr().out.replace("\n", "")
