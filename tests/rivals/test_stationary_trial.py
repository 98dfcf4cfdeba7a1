"""A whole run: the base stands while fingers close and open, and a copy of the run goes on as the run does."""

import msgspec
import pytest

from motm_twin.control.tick import Tick
from motm_twin.methods.registry import find_method
from motm_twin.model.scene_file import load_scene
from motm_twin.model.state import state_hash
from motm_twin.twin import Twin

LIMIT = 40.0  # [s]
SETTLE = 20  # periods until the last cube has fallen


def moves(tick: Tick) -> bool:
    """Whether the base is seen to move."""
    v, w = tick.observation.twist
    return abs(v) > 0.02 or abs(w) > 0.04


@pytest.mark.parametrize("name", ["irm", "sequential_overlap"])
def test_a_cube_is_picked_and_placed_by_a_base_that_stands_meanwhile(name: str) -> None:
    scene = load_scene("exp1", "trial1")
    scene = msgspec.structs.replace(scene, tasks=scene.tasks[:2])
    twin = Twin(scene, method=find_method(name))
    early, hashes, snapshot = 0, [], None
    tick = twin.advance()
    while not tick.done and tick.time < LIMIT:
        phases = {step.phase for step in tick.arm}
        if "closing" in phases or ("release" in phases and tick.arm[-1].actuation.gripper == "open"):
            assert not moves(tick), tick.time
        early += "transit" in phases and moves(tick)
        if tick.index == 60:
            snapshot = twin.snapshot()
        if tick.index == 100:
            hashes.append(twin.state_hash())
        tick = twin.advance()
    assert tick.success
    for _ in range(SETTLE):
        tick = twin.advance()
    assert tick.truth is not None
    assert tick.truth.places == 1
    assert not [contact for contact in tick.truth.contacts if contact.caused_by_robot]
    assert (early > 10) == (name == "sequential_overlap")
    assert snapshot is not None
    twin.restore(snapshot)
    for _ in range(40):
        twin.advance()
    hashes.append(twin.state_hash())
    assert hashes[0] == hashes[1]
    assert hashes[0] != state_hash(snapshot)
