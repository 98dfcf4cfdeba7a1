"""A session, or what a robot observed, runs again to the same bits, and says so when it does not."""

import msgspec
import pytest

from motm_twin.bus.encode import ObservationEncoder, tick_message
from motm_twin.bus.messages import ObservationsMessage
from motm_twin.model.edits import AddObstacle, MoveBody
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import TRACK_PERIODS, RecordedPlant, player, rerun, updated
from motm_twin.sessions import session as sessions
from motm_twin.sessions.session import SOURCE, LoggedEdit, SessionError, decode_session, encode_session
from motm_twin.twin import Twin

replace = msgspec.structs.replace


@pytest.fixture(scope="module")
def again(recorded):
    """The recorded run, computed once more from its file."""
    return rerun(decode_session(encode_session(recorded.session)))


def test_a_session_with_edits_of_all_kinds_and_cut_searches_reruns_bit_for_bit(recorded, again):
    assert recorded.session.cuts and len(recorded.session.edits) == 12
    assert again.ok and again.state_hash == recorded.session.state_hash
    assert (again.first_sign, again.differences) == ("", ())
    assert len(again.track) == recorded.session.periods // TRACK_PERIODS


def test_the_player_gives_every_period_with_its_edits_and_its_twin_stands_where_the_run_stood(recorded, disturbances):
    seen = {}
    for twin, tick in player(recorded.session, until=45):
        seen[tick.index] = list(tick.edits)
        assert twin.state_hash() == recorded.hashes[tick.index + 1]
    assert seen == {index: disturbances.get(index, []) for index in range(45)}


def test_without_its_cuts_the_run_is_another_one(recorded):
    assert not rerun(replace(recorded.session, cuts=())).ok


def test_where_a_run_without_some_edits_parts_from_the_recording_is_told(recorded, again):
    tracked = updated(recorded.session, again)
    assert tracked.state_hash == recorded.session.state_hash
    late = tuple(entry for entry in tracked.edits if entry.index < 20)
    changed = rerun(replace(tracked, edits=late, made_with={**tracked.made_with, "numpy": "0.1"}))
    assert not changed.ok
    assert "after 2 s the base is" in changed.first_sign
    assert any(said.startswith("numpy 0.1 there") for said in changed.differences)
    other = replace(tracked, state_hash="0" * 64, parts={**tracked.parts, "sequence": "0" * 12})
    assert rerun(other).first_sign.endswith("the state of sequence")
    assert "without a track" in rerun(replace(recorded.session, edits=late)).first_sign


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"edits": (LoggedEdit(index=3, edit=MoveBody(name="nobody", x=0.0, y=0.0)),)}, "period 3: .*MoveBody.*nobody"),
        ({"parameters": {"next_wait": 1.0}}, "next_wait"),
    ],
)
def test_what_the_run_refuses_is_named(recorded, wrong, words):
    with pytest.raises(SessionError, match=words):
        rerun(replace(recorded.session, **wrong))


def test_a_session_of_no_periods_is_its_start(recorded):
    empty = replace(recorded.session, edits=(), cuts=(), periods=0, state_hash=recorded.hashes[0])
    assert rerun(empty).ok


def test_another_state_of_the_code_is_named(tmp_path):
    made, other = sessions.made_with(), "0123456789ab"
    assert sessions.differences(made) == ()
    assert sessions.differences({name: said for name, said in made.items() if name != SOURCE}) == ()  # not known
    told = f"recorded with another motm_twin ({other} → {made[SOURCE]})"
    assert sessions.differences(made | {SOURCE: other}) == (told,)
    (tmp_path / "part").mkdir()
    hashes = []
    for file, text in (("part/a.py", "x = 1\n"), ("notes.txt", "no source"), ("part/a.py", "x = 2\n")):
        (tmp_path / file).write_text(text)
        hashes.append(sessions.source_hash(tmp_path))
    assert hashes[0] == hashes[1] != hashes[2]


PERIODS = 60
OF_THE_TRUTH = ("objects", "agents", "obstacles", "furniture", "removed", "faults", "score", "stage_ms", "robot")


def said(tick):
    """A period without the fields that only a simulated robot knows."""
    message = msgspec.to_builtins(tick_message(tick, 1, 0.0))
    return {name: value for name, value in message.items() if name not in OF_THE_TRUTH}


@pytest.fixture(scope="module")
def robot_run():
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


def test_the_same_observations_give_the_same_periods(robot_run):
    scene, ticks, payloads = robot_run
    twin = Twin(scene, plant=RecordedPlant(decoded(payloads)))
    for index, wanted in enumerate(ticks):
        if index == 10:
            twin.post(AddObstacle(name="guest", shape="temi", x=2.4, y=0.3))
        assert said(twin.advance()) == wanted, index


def test_sweeps_are_kept_once(robot_run):
    samples = [sample for message in decoded(robot_run[2]) for sample in message.samples]
    stamps = [sample.scan.stamp for sample in samples if sample.scan is not None]
    assert len(samples) == 5 * PERIODS and len(set(stamps)) == len(stamps)


def test_a_gap_and_an_end_are_told(robot_run):
    messages = decoded(robot_run[2])
    with pytest.raises(ValueError, match="period 3 are missing"):
        RecordedPlant([*messages[:3], *messages[4:]])
    plant = RecordedPlant(messages[:1])
    for _ in range(5):
        plant.observe()
        plant.step(0.01)
    assert not plant.ready()
    with pytest.raises(ValueError, match="has 5 samples"):
        plant.observe()
