"""The twin as a whole: it does the job, twice the same, and can be rewound."""

import gc
import weakref

import msgspec
import numpy as np
import pytest
from twin_steps import SHORT, advance, advance_until, caused

from motm_twin.model.edits import AddObstacle, Announce, InjectFault, MoveBody, ReleaseBody, RemoveBody, SetParameter
from motm_twin.model.known import known_world
from motm_twin.model.scene_file import check_all, list_scenes, load_scene
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import Session, decode_session, encode_session
from motm_twin.studies.disturbances import Watch
from motm_twin.trial import run_scene
from motm_twin.twin import Twin


def test_the_first_published_trial_is_done_without_contact_or_false_alarm_faster_than_the_paper(monkeypatch):
    made, watch = [], Watch("none")
    monkeypatch.setattr("motm_twin.trial.Twin", lambda *given, **more: made.append(Twin(*given, **more)) or made[-1])

    def look(tick):
        watch.look(tick, {finding.kind for finding in made[0].loop.self_check.findings})

    result = run_scene(load_scene("exp1", "trial1", 0), on_tick=look)
    assert watch.false == {}
    assert result["success"], result["reason"]
    assert result["picks_done"] == result["places_done"] == 6
    assert result["contacts"] == []
    assert result["plant_faults"] == []
    assert result["mean_closing_base_speed_mps"] >= 0.2
    assert result["min_base_clearance_m"] >= 0.035
    assert result["time_s"] <= 85.6  # of the paper


@pytest.mark.parametrize("listing", list_scenes(), ids=lambda listing: listing.name)
def test_every_variant_of_every_shipped_scene_runs_and_passes_the_checks_of_a_session(listing):
    scenes = check_all(listing.name)
    assert [(scene.name, scene.variant) for scene in scenes] == [(listing.name, name) for name in listing.variants]
    for scene in scenes:
        assert scene.tasks
        assert known_world(scene).tasks == scene.tasks
        session = Session(scene=scene)
        assert decode_session(encode_session(session)) == session
        assert Twin(scene).advance().index == 0


def test_the_same_seed_gives_the_same_state_bit_for_bit():
    hashes = set()
    for _ in range(2):
        twin = Twin(load_scene("exp2", "random", 3))
        advance(twin, 40)
        hashes.add(twin.state_hash())
    assert len(hashes) == 1


def test_a_reset_leaves_nothing_of_the_run_before_to_the_garbage_collection():
    """A run holds robot models and arrays, which Python does not count: it would be kept for hundreds of resets."""
    twin = Twin(load_scene("exp2", "random", 0))
    advance(twin, 5)
    past = [weakref.ref(part) for part in (twin.plant, twin.loop)]
    gc.disable()
    try:
        twin.reset()
        assert [part() for part in past] == [None, None]
    finally:
        gc.enable()


def test_another_seed_gives_another_state():
    hashes = set()
    for seed in (1, 2):
        twin = Twin(load_scene("exp1", "trial1", seed))
        advance(twin, 20)
        hashes.add(twin.state_hash())
    assert len(hashes) == 2


def test_edits_are_applied_at_the_next_period_and_logged_in_its_tick():
    twin = Twin(load_scene("exp1", "trial1", 0))
    twin.post(AddObstacle(name="crate", x=2.0, y=-0.5))
    tick = twin.advance()
    assert [edit.name for edit in tick.edits] == ["crate"]
    assert [body.name for body in tick.truth.obstacles] == ["crate"]
    twin.post(MoveBody(name="crate", x=2.5, y=-0.5))
    twin.post(RemoveBody(name="crate"))
    tick = twin.advance()
    assert len(tick.edits) == 2
    assert tick.truth.obstacles == ()


def test_an_edit_of_an_unknown_body_is_refused_and_changes_nothing():
    twin = Twin(load_scene("exp1", "trial1", 0))
    before = twin.state_hash()
    with pytest.raises(ValueError, match="nobody"):
        twin.post(MoveBody(name="nobody", x=0.0, y=0.0))
    assert twin.state_hash() == before


def test_an_obstacle_dropped_before_the_robot_is_driven_around():
    twin = Twin(load_scene("exp1", "trial1", 0))
    advance(twin, 60)
    twin.post(AddObstacle(name="crate", x=2.3, y=0.2, size=(0.5, 0.5, 0.6)))
    tick = advance_until(twin, lambda tick: tick.truth.picks == 1)
    assert not caused(tick)


def test_a_scene_without_noise_is_completed():
    silent = {name: 0.0 for name in SHORT.noise.__struct_fields__ if name != "localisation_correlation_time"}
    result = run_scene(msgspec.structs.replace(SHORT, noise=msgspec.structs.replace(SHORT.noise, **silent)))
    assert result["success"], result["reason"]


class SolverError(RuntimeError):
    """What a broken library would raise."""


@pytest.mark.parametrize("where", ["planner", "map"])
def test_a_run_whose_period_broke_off_is_saved_until_then_without_a_hash(monkeypatch, where):
    twin = Twin(load_scene("exp1", "trial1", 0))

    def broken(*_given):
        raise SolverError

    twin.post(AddObstacle(name="crate", x=2.0, y=-0.5))
    advance(twin, 12)
    kept, before = twin.snapshot(), twin.state_hash()
    with monkeypatch.context() as patch:
        if where == "planner":
            patch.setattr(type(twin.loop.planner), "place", broken)
        else:  # the control loop is half built
            patch.setattr(type(twin.loop.mapper), "adopt", broken)
        twin.post(MoveBody(name="table", x=2.6, y=1.9))
        twin.post(Announce(name="table"))
        with pytest.raises(SolverError):
            twin.advance()
    session = decode_session(encode_session(twin.session("mine")))
    assert (session.periods, session.state_hash) == (12, "")
    assert [entry.edit.name for entry in session.edits] == ["crate"]
    assert session.title == "mine (until period 12, which broke off: no state hash)"
    again = rerun(session)
    assert not again.ok
    assert again.state_hash == before
    assert "no state hash" in again.first_sign
    with pytest.raises(RuntimeError, match="period 12 has broken off"):
        twin.advance()
    twin.restore(kept)
    advance(twin, 3)
    assert rerun(twin.session()).ok


def test_a_period_that_broke_off_is_forgotten_by_a_reset(monkeypatch):
    twin = Twin(load_scene("exp1", "trial1", 0))
    monkeypatch.setattr(twin.loop.planner, "place", None)
    with pytest.raises(TypeError):
        twin.advance()
    twin.reset()
    assert twin.session().state_hash == twin.state_hash()
    assert advance(twin, 2).index == 1


def test_snapshots_of_a_run_share_its_log():
    twin = Twin(load_scene("exp1", "trial1", 0))
    kept = []
    for k in range(5):
        twin.post(InjectFault(fault="lidar_off", seconds=0.1 + 0.1 * k))
        twin.advance()
        kept.append(twin.snapshot())
    assert {id(entries) for state in kept for entries, _ in state["log"]} == {id(twin.edits), id(twin.cuts)}
    assert [[count for _, count in state["log"]] for state in kept] == [[k, 0] for k in range(1, 6)]


def test_every_snapshot_keeps_its_own_history_whatever_was_restored_since():
    def done(twin):
        return [entry.edit.seconds for entry in twin.edits]

    def go_on(twin, seconds):
        twin.post(InjectFault(fault="lidar_off", seconds=seconds))
        twin.advance()
        return twin.snapshot(), twin.state_hash()

    scene = load_scene("exp1", "trial1", 0)
    twin, other = Twin(scene), Twin(scene)
    kept = {(seconds,): go_on(twin, seconds) for seconds in (1.0,)}
    kept[(1.0, 2.0)] = go_on(twin, 2.0)
    kept[(1.0, 2.0, 3.0)] = go_on(twin, 3.0)
    twin.restore(kept[(1.0,)][0])
    kept[(1.0, 4.0)] = go_on(twin, 4.0)
    kept[(1.0, 4.0, 5.0)] = go_on(twin, 5.0)
    other.restore(kept[(1.0, 4.0)][0])  # the log of the first twin
    kept[(1.0, 4.0, 6.0)] = go_on(other, 6.0)
    twin.reset()
    for one in (twin, other):
        for history, (state, known) in kept.items():
            one.restore(state)
            assert tuple(done(one)) == history
            session = one.session()
            assert session.state_hash == known
            assert rerun(session).ok


def test_numbers_of_numpy_and_whole_numbers_are_kept_as_a_session_has_them():
    twin = Twin(load_scene("exp1", "trial1", 0), parameters={"next_weight": np.float64(0.5)})
    twin.post(AddObstacle(name="crate", x=np.float32(2.0), y=-1, size=tuple(np.array([0.5, 0.5, 0.6]))))
    twin.post(MoveBody(name=np.str_("crate"), x=2, y=np.int64(-1), held=np.bool_(False)))
    twin.post(ReleaseBody(name="crate", velocity=np.array([0.2, 0.0])))
    twin.post(SetParameter(name="bezier", value=np.bool_(False)))
    tick = advance(twin, 5)
    assert type(tick.truth.obstacles[0].position[0]) is float
    assert rerun(decode_session(encode_session(twin.session()))).ok


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (MoveBody(name="table", x="far", y=0.0), "MoveBody.*float.*x"),
        (MoveBody(name="table", x=object(), y=0.0), "object is neither a number"),
        (MoveBody(name="table", x=10**400, y=0.0), "MoveBody"),
        (SetParameter(name="next_weight", value=[1.0]), "SetParameter.*value"),
        ("stop", "str is no edit: use one of AddObstacle"),
    ],
)
def test_an_edit_that_no_session_could_keep_is_refused(edit, words):
    twin = Twin(load_scene("exp1", "trial1", 0))
    with pytest.raises(ValueError, match=words):
        twin.post(edit)
    assert twin.advance().edits == ()
