"""A session runs again to the same bits, and says so when it does not."""

import msgspec
import pytest

from motm_twin.model.edits import MoveBody
from motm_twin.record.replay import TRACK_PERIODS, player, rerun, updated
from motm_twin.sessions.session import (
    SOURCE,
    LoggedEdit,
    SessionError,
    decode_session,
    differences,
    encode_session,
    made_with,
    source_hash,
)

replace = msgspec.structs.replace


@pytest.fixture(scope="module")
def again(recorded):
    """The recorded run, computed once more from its file."""
    return rerun(decode_session(encode_session(recorded.session)))


def test_a_session_with_edits_of_all_kinds_and_cut_searches_reruns_bit_for_bit(recorded, again):
    assert recorded.session.cuts
    assert len(recorded.session.edits) == 12
    assert again.ok
    assert again.state_hash == recorded.session.state_hash
    assert again.first_sign == ""
    assert again.differences == ()
    assert len(again.track) == recorded.session.periods // TRACK_PERIODS


def test_the_player_gives_every_period_with_its_edits(recorded, disturbances):
    seen = {tick.index: list(tick.edits) for _, tick in player(recorded.session, until=45)}
    assert list(seen) == list(range(45))
    assert {index: edits for index, edits in seen.items() if edits} == {
        index: edits for index, edits in disturbances.items() if index < 45
    }


def test_the_twin_of_the_player_stands_where_the_run_stood(recorded):
    for twin, tick in player(recorded.session, until=30):
        assert twin.state_hash() == recorded.hashes[tick.index + 1]


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


def test_an_edit_that_the_run_refuses_is_named_with_its_period(recorded):
    wrong = LoggedEdit(index=3, edit=MoveBody(name="nobody", x=0.0, y=0.0))
    with pytest.raises(SessionError, match=r"period 3: .*MoveBody.*nobody"):
        rerun(replace(recorded.session, edits=(wrong,)))


def test_an_unknown_parameter_is_refused(recorded):
    with pytest.raises(SessionError, match="next_wait"):
        rerun(replace(recorded.session, parameters={"next_wait": 1.0}))


def test_a_session_of_no_periods_is_its_start(recorded):
    empty = replace(recorded.session, edits=(), cuts=(), periods=0, state_hash=recorded.hashes[0])
    assert rerun(empty).ok


def test_another_state_of_the_code_is_named(tmp_path):
    assert differences(made_with()) == ()
    assert differences({name: said for name, said in made_with().items() if name != SOURCE}) == ()  # not known
    assert differences(made_with() | {SOURCE: "0123456789ab"}) == (
        f"recorded with another motm_twin (0123456789ab → {made_with()[SOURCE]})",
    )
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "a.py").write_text("x = 1\n")
    first = source_hash(tmp_path)
    (tmp_path / "notes.txt").write_text("no source")
    assert source_hash(tmp_path) == first
    (tmp_path / "part" / "a.py").write_text("x = 2\n")
    assert source_hash(tmp_path) != first
