"""Both ends of every bound of the scene format and of the parameters: a robot that runs, or one clear sentence."""

import itertools

import numpy as np
import pytest
from bounds_of_scenes import ROOM, ends

from motm_twin.control.tuning import PARAMETERS
from motm_twin.model.names import SceneError
from motm_twin.model.scene_file import load_scene
from motm_twin.sessions.session import decode_session, encode_session
from motm_twin.twin import Twin

PERIODS = 2
CASES = dict(ends())
GROUPS = {key: list(names) for key, names in itertools.groupby(CASES, key=lambda name: name.rpartition(".")[0])}


def runs(twin: Twin) -> None:
    for _ in range(PERIODS):
        tick = twin.advance()
        for step in tick.arm:
            assert np.isfinite(step.actuation.twist).all()
            assert np.isfinite(step.actuation.joint_velocity).all()
        assert np.isfinite(tick.plan.acceleration).all()
        assert tick.truth is not None and np.isfinite(tick.truth.pose).all()
        assert not tick.truth.plant_faults


@pytest.mark.parametrize("group", GROUPS)
def test_both_ends_of_every_bound_of_a_scene_run_or_are_refused_in_one_sentence(group, tmp_path):
    path, ran = tmp_path / "room.yaml", 0
    for name in GROUPS[group]:
        path.write_text(CASES[name], encoding="utf-8")
        try:
            scene = load_scene(str(path))
        except SceneError as refused:
            assert "\n" not in str(refused), name
            continue
        runs(Twin(scene))
        ran += 1
    assert ran, group


def test_both_ends_of_every_parameter_run(tmp_path):
    path = tmp_path / "room.yaml"
    path.write_text(ROOM, encoding="utf-8")
    scene = load_scene(str(path))
    for entry in PARAMETERS:
        values = {"number": (entry.low, entry.high), "switch": (False, True)}.get(entry.kind, entry.choices)
        for value in values:
            runs(Twin(scene, parameters={entry.name: value}))


def test_a_base_that_cannot_reverse_gets_to_a_point_behind_it(tmp_path):
    path = tmp_path / "forwards.yaml"
    path.write_text(
        "format: motm-scene/1\n"
        "robot: {name: forwards, base: {reverse_speed_mps: 0, yaw_rate_dps: 300, forward_speed_mps: 1.0}}\n"
        "tasks: [{drive_to: {x: -0.8, y: 0.0}}]\n",
        encoding="utf-8",
    )
    twin = Twin(load_scene(str(path)))
    slowest = 0.0
    while not twin.done and twin.index < 300:
        tick = twin.advance()
        slowest = min(slowest, float(twin.loop.monitor.twist[0]))
        assert tick.plan.local_poses[:, 3].min(initial=0.0) >= 0.0
    assert twin.done
    assert slowest >= -1e-6


def test_a_scene_holds_more_than_200_pieces_and_20_agents(tmp_path):
    lines = ["format: motm-scene/1", "bounds: [-2, -2, 50, 50]", "furniture:"]
    lines += [
        f"  p{k}: {{shape: cylinder, centre: [{2 + k % 30}, {2 + k // 30}], radius: 0.05, z: [0, 1]}}"
        for k in range(240)
    ]
    lines += ["agents:", *(f"  a{k}: {{start: {{x: {2.5 + k}, y: 20.5}}, radius: 0.2}}" for k in range(25))]
    lines += ["tasks: [{drive_to: {x: 1, y: 0}}]"]
    path = tmp_path / "hall.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    scene = load_scene(str(path))
    assert (len(scene.solids), len(scene.agents)) == (240, 25)
    twin = Twin(scene)
    runs(twin)
    assert decode_session(encode_session(twin.session())).scene == scene
