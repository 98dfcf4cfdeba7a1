"""`bench barn`: the metric of the challenge, and a table of worlds from files and from seeds."""

import io
import json

import pytest
from rich.console import Console

from motm_twin.cli.bench import main
from motm_twin.generate.barn import barn
from motm_twin.model.scene_file import SceneError, load_scene
from motm_twin.studies.barn import bench_barn, limits_of, metric, optimal_time, worlds


@pytest.mark.parametrize(
    ("success", "seconds", "expected"),
    [(True, 5.0, 0.5), (True, 10.0, 0.5), (True, 20.0, 0.25), (True, 90.0, 0.125), (False, 5.0, 0.0)],
)
def test_the_metric_is_that_of_the_challenge(success, seconds, expected):
    assert metric(success, seconds, 5.0) == pytest.approx(expected)


def test_the_optimal_time_is_what_the_file_says_or_that_of_the_shortest_way():
    scene = load_scene("barn:0")
    assert optimal_time(scene, "# BARN world_0, optimal time 6.7961 s (path_0.npy / 2 m/s)\n") == 6.7961
    assert 5.0 <= optimal_time(scene) < 5.05
    assert 5.0 < optimal_time(load_scene("barn:3")) < 5.6


def test_a_profile_takes_the_place_of_the_limits_of_the_file():
    (plain,), (controller,) = worlds(["barn:0"], ["fast"], None), worlds(["barn:0"], ["fast"], "controller")
    assert plain.scene.robot.base.linear_acceleration == 3.0
    assert controller.scene.robot.base == limits_of("controller")
    assert (controller.scene.robot.base.linear_acceleration, controller.scene.robot.base.reverse_speed) == (20.0, 2.0)
    assert controller.scene.robot.lidar == plain.scene.robot.lidar


def test_files_and_seeds_are_run_and_make_one_table(tmp_path):
    path = tmp_path / "easy.yaml"
    path.write_text("# optimal time 5.5 s\n" + barn(16), encoding="utf-8")
    said = io.StringIO()
    assert bench_barn([str(path), "barn:0"], (), None, 1, tmp_path, Console(file=said, width=200))
    report = json.loads((tmp_path / "barn.json").read_text(encoding="utf-8"))
    assert [row["world"] for row in report["rows"]] == ["easy", "barn:0"]
    assert report["rows"][0]["optimal_s"] == 5.5
    assert report["whole"]["fast"]["success_percent"] == 100.0
    assert report["whole"]["fast"]["metric"] == pytest.approx(0.5)
    assert "all 2" in said.getvalue()


def test_what_is_no_world_is_refused(tmp_path, capsys):
    assert main(["barn", "--out", str(tmp_path)]) == 2
    assert main(["barn", "exp1", "--out", str(tmp_path)]) == 2
    assert "is no BARN world" in capsys.readouterr().out
    with pytest.raises(SceneError):
        worlds(["barn:x"], ["fast"], None)
    assert main(["barn", "--worlds", "0"]) == 2
