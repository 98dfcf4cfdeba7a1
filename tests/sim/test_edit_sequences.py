"""Any sequence of edits: refused with a ValueError or applied; and the state alone decides what comes."""

import math

import numpy as np
from edit_scenes import room
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from sim_hands import act
from sim_scenes import Noise

from motm_twin.model.edits import (
    AddObstacle,
    FreezeBody,
    InjectFault,
    MoveBody,
    MoveObject,
    PushRobot,
    ReleaseBody,
    RemoveBody,
    SendAgent,
    SetBehaviour,
)
from motm_twin.model.faults import NAMES as FAULTS
from motm_twin.model.state import state_hash
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.world_edits import Effects

NAMES = ("table", "stand", "cabinet", "crate", "temi", "new1", "new2", "cube1", "cube2", "slab", "bin", "nobody", "")
name = st.sampled_from(NAMES)
place = st.floats(-4.0, 4.0) | st.sampled_from((math.nan, 1e9, 0.0, 3.0))
turn = st.none() | st.floats(-7.0, 7.0)
speed = st.floats(-6.0, 6.0) | st.just(math.inf)
edits = st.one_of(
    st.builds(
        AddObstacle,
        name=st.sampled_from(("new1", "new2", "temi")),
        shape=st.sampled_from(("box", "cylinder", "temi", "person", "cone")),
        x=place,
        y=place,
        heading=st.floats(-7.0, 7.0),
        size=st.tuples(st.floats(0.05, 1.0), st.floats(0.05, 1.0), st.floats(0.0, 1.0)),
    ),
    st.builds(MoveBody, name=name, x=place, y=place, heading=turn, held=st.booleans()),
    st.builds(ReleaseBody, name=name, velocity=st.tuples(speed, speed)),
    st.builds(FreezeBody, name=name, frozen=st.booleans()),
    st.builds(SendAgent, name=name, x=place, y=place),
    st.builds(SetBehaviour, name=name, behaviour=st.sampled_from(("yield", "blind"))),
    st.builds(RemoveBody, name=name),
    st.builds(MoveObject, name=name, x=place, y=place),
    st.builds(PushRobot, dx=st.floats(-0.5, 0.5), dy=st.floats(-0.5, 0.5), turn=st.floats(-1.2, 1.2)),
    st.builds(InjectFault, fault=st.sampled_from((*FAULTS, "x")), seconds=st.floats(0, 2), delay=st.floats(0, 0.5)),
)
steps = st.tuples(st.lists(edits, max_size=3), st.integers(1, 10), st.floats(-0.5, 0.5), st.booleans())


def run(plant, sequence):
    """Apply and step; what was refused is told, and has changed nothing."""
    refusals = []
    for batch, substeps, twist, close in sequence:
        for edit in batch:
            try:
                plant.apply(edit)
            except ValueError as refusal:
                refusals.append(str(refusal))
        plant.command(act((twist, twist), 0.5 * np.ones(7) * twist, "close" if close else "open"))
        plant.step(0.01 * substeps)
    return refusals


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(first=st.lists(steps, max_size=8), second=st.lists(steps, max_size=8))
def test_random_edits_are_refused_or_applied_and_a_snapshot_has_one_future(first, second):
    plant = SimulatedPlant(room(noise=Noise()))
    refusals = run(plant, first)
    assert all(refusals)
    kept = plant.snapshot()
    here = state_hash(kept)
    told = run(plant, second)
    there = state_hash(plant.snapshot())
    plant.restore(kept)
    assert state_hash(plant.snapshot()) == here
    assert run(plant, second) == told
    assert state_hash(plant.snapshot()) == there
    fresh = SimulatedPlant(room(noise=Noise()))
    fresh.restore(kept)
    run(fresh, second)
    assert state_hash(fresh.snapshot()) == there
    truth = plant.truth()
    assert truth.plant_faults == ()
    assert np.isfinite([item.position for item in truth.objects]).all()
    assert all(item.position[2] > 0.0 for item in truth.objects)


@settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
@given(sequence=st.lists(edits, min_size=1, max_size=12))
def test_checking_edits_ahead_says_what_applying_them_says_and_changes_nothing(sequence):
    plant = SimulatedPlant(room())
    before = state_hash(plant.snapshot())
    said, rehearsal = [], plant.rehearsal()
    for edit in sequence:
        try:
            rehearsal.accept(edit)
            said.append("")
        except ValueError as refusal:
            said.append(str(refusal))
    assert state_hash(plant.snapshot()) == before
    for edit, expected in zip(sequence, said, strict=True):
        try:
            plant.apply(edit)
            assert expected == ""
        except ValueError as refusal:
            assert str(refusal) == expected


def test_a_thousand_moves_wait_and_each_is_tried_once(monkeypatch):
    plant, tried = SimulatedPlant(room()), []
    apply = Effects.apply
    monkeypatch.setattr(Effects, "apply", lambda *given: tried.append(given[-1]) or apply(*given))
    rehearsal = plant.rehearsal()
    moves = [MoveBody(name="table", x=1.0 + 0.001 * k, y=2.0) for k in range(1000)]
    for move in moves:
        rehearsal.accept(move)
    assert tried == moves[:-1]


@settings(max_examples=12, deadline=None, suppress_health_check=list(HealthCheck))
@given(sequence=st.lists(steps, max_size=6))
def test_two_plants_with_the_same_edits_are_the_same(sequence):
    hashes = []
    for _ in range(2):
        plant = SimulatedPlant(room(noise=Noise()))
        run(plant, sequence)
        hashes.append(state_hash(plant.snapshot()))
    assert hashes[0] == hashes[1]
