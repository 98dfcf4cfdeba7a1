"""`bench tracker`: which agents can be tracked, what is matched, and the table."""

import io
import json
import math

import msgspec
import numpy as np
import pytest
from rich.console import Console

from motm_twin.cli.bench import main
from motm_twin.model.plant import Scan
from motm_twin.model.scene_file import load_scene
from motm_twin.studies.people import SITUATIONS, Situation
from motm_twin.studies.tracker import Score, beams_on, bench_tracker, matched
from motm_twin.twin import Twin


def scan_of(ranges):
    count = len(ranges)
    return Scan(
        stamp=0.0, ranges=np.array(ranges), angle_min=-math.pi, angle_step=2.0 * math.pi / count, origin=np.zeros(2),
        range_min=0.05, range_max=15.0, pose=np.zeros(3),
    )  # fmt: skip


def test_beams_that_end_on_an_agent_are_counted_from_the_true_pose():
    step = math.radians(1.0)
    ranges = np.full(360, np.inf)
    for i in range(360):  # a disc of 0.25 m, 2 m to the left of a base that looks along y
        off = math.remainder(-math.pi + i * step - math.pi / 2, 2.0 * math.pi)
        if abs(2.0 * math.sin(off)) < 0.25 and abs(off) < 1.0:
            ranges[i] = 2.0 * math.cos(off) - math.sqrt(0.25**2 - (2.0 * math.sin(off)) ** 2)
    pose = np.array([1.0, 1.0, math.pi / 2])
    assert beams_on(scan_of(ranges), pose, (-1.0, 1.0, 0.25)) == np.isfinite(ranges).sum() >= 10
    assert beams_on(scan_of(ranges), pose, (-1.0, 2.0, 0.25)) == 0


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


def test_a_run_is_scored_and_makes_a_table(tmp_path, monkeypatch):
    monkeypatch.setitem(SITUATIONS, "turns", Situation("people", "turns", {"time_limit": 5.0}))
    said = io.StringIO()
    assert bench_tracker(["turns"], 1, 1, tmp_path, Console(file=said, width=200))
    report = json.loads((tmp_path / "tracker.json").read_text(encoding="utf-8"))
    (row,), (whole, everything) = report["rows"], report["whole"]
    assert whole["mota"] == pytest.approx(row["mota"])
    assert everything["situation"] == "all"
    assert 0.0 < row["scan_ms"]["p50"] < 50.0
    assert "MOTA" in said.getvalue()


def test_without_motmetrics_it_says_what_to_install(monkeypatch, tmp_path, capsys):
    monkeypatch.setattr("motm_twin.studies.tracker.find_spec", lambda name: None)
    assert main(["tracker", "--out", str(tmp_path)]) == 2
    assert 'pip install "motm_twin[people]"' in capsys.readouterr().out.replace("\n", "")
