"""The run of a robot of which only the observations are known is computed again, bit for bit."""

import msgspec
import pytest

from motm_twin.bus.encode import ObservationEncoder, ObservationsMessage, tick_message
from motm_twin.model.edits import AddObstacle
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import RecordedPlant
from motm_twin.twin import Twin

PERIODS = 60
OF_THE_TRUTH = ("objects", "agents", "obstacles", "furniture", "removed", "faults", "score", "stage_ms", "robot")


def said(tick):
    """What a period says, without what only a simulated robot knows."""
    message = msgspec.to_builtins(tick_message(tick, 1, 0.0))
    return {name: value for name, value in message.items() if name not in OF_THE_TRUTH}


@pytest.fixture(scope="module")
def recorded():
    """Scene, what was said, and the observations as bytes."""
    scene, encoder = load_scene("exp1", "trial2", 1), ObservationEncoder()
    twin, ticks, payloads = Twin(scene), [], []
    for index in range(PERIODS):
        if index == 10:
            twin.post(AddObstacle(name="guest", shape="temi", x=2.4, y=0.3))
        tick = twin.advance()
        ticks.append(said(tick))
        payloads.append(msgspec.json.encode(encoder.message(tick, 1, 0.0)))
    return scene, ticks, payloads


def decoded(payloads):
    return [msgspec.json.decode(payload, type=ObservationsMessage) for payload in payloads]


def test_the_same_observations_give_the_same_periods(recorded):
    scene, ticks, payloads = recorded
    twin = Twin(scene, plant=RecordedPlant(decoded(payloads)))
    for index, wanted in enumerate(ticks):
        if index == 10:
            twin.post(AddObstacle(name="guest", shape="temi", x=2.4, y=0.3))
        assert said(twin.advance()) == wanted, index


def test_sweeps_are_kept_once(recorded):
    _, _, payloads = recorded
    samples = [sample for message in decoded(payloads) for sample in message.samples]
    assert len(samples) == 5 * PERIODS
    sweeps = [sample.scan for sample in samples if sample.scan is not None]
    assert len({sweep.stamp for sweep in sweeps}) == len(sweeps)


def test_a_gap_and_an_end_are_told(recorded):
    _, _, payloads = recorded
    messages = decoded(payloads)
    with pytest.raises(ValueError, match="period 3 are missing"):
        RecordedPlant([*messages[:3], *messages[4:]])
    plant = RecordedPlant(messages[:1])
    for _ in range(5):
        plant.observe()
        plant.step(0.01)
    assert not plant.ready()
    with pytest.raises(ValueError, match="has 5 samples"):
        plant.observe()
