"""The twin as a whole: it does the job, twice the same, and can be rewound."""

import msgspec
import pytest

from motm_twin.model.edits import AddObstacle, MoveBody, RemoveBody
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import SearchBudget
from motm_twin.trial import run_scene
from motm_twin.twin import Twin


def advance(twin, periods):
    for _ in range(periods):
        tick = twin.advance()
    return tick


def test_the_first_published_trial_is_completed_without_contact():
    result = run_scene(load_scene("exp1", "trial1", 0))
    assert result["success"], result["reason"]
    assert result["picks_done"] == result["places_done"] == 6
    assert result["contacts"] == []
    assert result["plant_faults"] == []
    assert result["mean_closing_base_speed_mps"] >= 0.2


def test_the_same_seed_gives_the_same_state_bit_for_bit():
    hashes = set()
    for _ in range(2):
        twin = Twin(load_scene("exp2", "random", 3))
        advance(twin, 200)
        hashes.add(twin.state_hash())
    assert len(hashes) == 1


def test_another_seed_gives_another_state():
    hashes = set()
    for seed in (1, 2):
        twin = Twin(load_scene("exp1", "trial1", seed))
        advance(twin, 20)
        hashes.add(twin.state_hash())
    assert len(hashes) == 2


def test_a_rewound_twin_repeats_what_it_did():
    twin = Twin(load_scene("exp2", "random", 5))
    advance(twin, 60)
    saved, before = twin.snapshot(), twin.state_hash()
    advance(twin, 100)
    after = twin.state_hash()
    twin.restore(saved)
    assert twin.state_hash() == before
    advance(twin, 100)
    assert twin.state_hash() == after


def test_a_snapshot_continues_in_another_twin_of_the_scene():
    scene = load_scene("exp1", "trial2", 5)
    one, other = Twin(scene), Twin(scene)
    advance(one, 150)
    other.restore(one.snapshot())
    advance(one, 50)
    advance(other, 50)
    assert one.state_hash() == other.state_hash()


def test_a_search_cut_by_the_clock_is_repeated_by_its_expansion_count():
    scene = load_scene("exp1", "trial1", 0)
    now = iter(0.004 * i for i in range(10**9))
    cut = Twin(scene, budget=SearchBudget(expansions=400, seconds=0.02), clock=lambda: next(now))
    ticks = [cut.advance() for _ in range(120)]
    assert any(tick.plan.cut_by_clock for tick in ticks)
    again = Twin(scene)
    for tick in ticks:
        again.advance(SearchBudget(expansions=tick.plan.expansions) if tick.plan.cut_by_clock else None)
    assert again.state_hash() == cut.state_hash()


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
    tick = advance(twin, 500)
    assert not [contact for contact in tick.truth.contacts if contact.caused_by_robot]
    assert tick.truth.picks >= 1


def test_a_scene_without_noise_is_completed():
    scene = load_scene("exp1", "trial1", 0)
    silent = {name: 0.0 for name in scene.noise.__struct_fields__ if name != "localisation_correlation_time"}
    result = run_scene(msgspec.structs.replace(scene, noise=msgspec.structs.replace(scene.noise, **silent)))
    assert result["success"], result["reason"]
