"""Session files: written whole, read back equal, refused with a sentence; and going back to any kept period."""

import json

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from motm_twin.model.edits import AddObstacle, MoveBody, PushRobot, SetParameter
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import SearchBudget
from motm_twin.record.replay import rerun
from motm_twin.sessions import session as session_module
from motm_twin.sessions.branches import KEPT, SPACING, Branches, Log
from motm_twin.sessions.session import SessionError, decode_session, encode_session, load_session, save_session
from motm_twin.twin import Twin


def test_a_saved_session_is_read_back_equal(recorded, tmp_path):
    path = tmp_path / "run.json"
    save_session(recorded.session, path)
    assert load_session(path) == recorded.session
    assert [entry.name for entry in tmp_path.iterdir()] == ["run.json"]


def test_the_same_session_gives_the_same_bytes_with_one_edit_a_line(recorded):
    data = encode_session(recorded.session)
    assert encode_session(decode_session(data)) == data
    lines = [line for line in data.decode().splitlines() if line.startswith('{"index"') and '"edit"' in line]
    assert len(lines) == len(recorded.session.edits)


def test_sessions_as_other_programs_write_json_are_read_too(recorded):
    assert decode_session(msgspec.json.encode(recorded.session)) == recorded.session


def test_a_failed_write_leaves_the_old_file_and_nothing_else(recorded, tmp_path):
    path = tmp_path / "folder"
    path.mkdir()
    with pytest.raises(SessionError, match="cannot be written"):
        save_session(recorded.session, path)
    assert [entry.name for entry in tmp_path.iterdir()] == ["folder"]
    with pytest.raises(SessionError, match="cannot be written"):
        save_session(recorded.session, tmp_path / "nowhere" / "run.json")


def change(session, **fields):
    return {**json.loads(encode_session(session)), **fields}


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"version": "motm.session/9"}, "motm.session/9"),
        ({"surprise": 1}, "surprise"),
        ({"periods": -1}, "periods"),
        ({"periods": 10}, "edits.*index"),
        ({"state_hash": "abc"}, "64 hexadecimal"),
        ({"parameters": [1]}, "parameters"),
        ({"edits": [{"index": 1, "edit": {"type": "format_disk", "name": "x"}}]}, "format_disk"),
        ({"edits": [{"index": 1, "edit": {"type": "remove_body", "name": "x", "path": "/etc/passwd"}}]}, "path"),
        ({"cuts": [{"index": 3, "expansions": 5}, {"index": 2, "expansions": 5}]}, "sort"),
        ({"cuts": [{"index": 3, "expansions": -5}]}, "expansions"),
    ],
)
def test_what_does_not_fit_is_refused_with_its_place(recorded, fields, words):
    with pytest.raises(SessionError, match=words) as refusal:
        decode_session(json.dumps(change(recorded.session, **fields)).encode(), file="mine.json")
    assert str(refusal.value).startswith("mine.json: ")
    assert "\n" not in str(refusal.value)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("solids", 0, "z_max"), -1.0, r"solids\[0\]"),
        (("solids", 0, "colour"), "red", "unknown key 'colour'"),
        (("objects", 0, "position"), [3.1, 1.47, 0.9], "surface"),
        (("objects", 1, "name"), "drop1", "used twice"),
        (("bounds",), [-1e9, -1e9, 1e9, 1e9], "bounds"),
        (("robot", "lidar", "beams"), 10**9, "beams"),
        (("robot", "base", "forward_speed"), 50.0, "forward_speed"),
        (("tasks", 0, "object"), "cube_of_somebody", "cube_of_somebody"),
        (("seed",), -1, "seed"),
        (("time_limit",), 1e12, "time_limit"),
    ],
)
def test_a_scene_that_no_scene_file_could_have_made_is_refused(recorded, path, value, words):
    raw = json.loads(encode_session(recorded.session))
    target = raw["scene"]
    for step in path[:-1]:
        target = target[step]
    target[path[-1]] = value
    with pytest.raises(SessionError, match=words):
        decode_session(json.dumps(raw).encode())


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"\xff\xfe", b"null", b"[]", b"[" * 200_000, b'{"a":' * 200_000, b'{"version": NaN}', b"PK\x03\x04"],
)
def test_what_is_no_session_at_all_is_refused(data):
    with pytest.raises(SessionError):
        decode_session(data)


def test_too_large_and_missing_files_are_refused_before_they_are_read(tmp_path, monkeypatch):
    with pytest.raises(SessionError, match="no such file"):
        load_session(tmp_path / "none.json")
    with pytest.raises(SessionError, match="no such file"):
        load_session(tmp_path)
    with pytest.raises(SessionError):
        load_session("a\x00b")
    monkeypatch.setattr(session_module, "MAX_BYTES", 100)
    (tmp_path / "large.json").write_bytes(b" " * 101)
    with pytest.raises(SessionError, match="at most"):
        load_session(tmp_path / "large.json")


def run(twin, branches, periods, edits=None):
    """Until period ``periods`` is next, with edits by period."""
    while twin.index < periods:
        branches.note(twin, twin.index)
        for edit in (edits or {}).get(twin.index, []):
            twin.post(edit)
        twin.advance()


@pytest.fixture(scope="module")
def scene():
    return load_scene("exp1", "trial2", 1)


def test_the_last_two_minutes_are_kept():
    assert SPACING * 0.05 == 2.0
    assert (KEPT - 1) * SPACING * 0.05 == 120.0


@pytest.mark.slow
def test_back_to_any_period_and_on_with_the_same_edits_gives_the_same_run(recorded, clocked_twin, disturbances):
    twin, branches = clocked_twin, Branches(spacing=16)
    periods = recorded.session.periods
    run(twin, branches, periods, disturbances)
    assert twin.session().state_hash == recorded.session.state_hash

    @settings(max_examples=5, deadline=None, derandomize=True)
    @given(index=st.integers(0, periods))
    def back_and_on(index):
        branches.branch(twin, index)
        assert twin.index == index
        assert twin.state_hash() == recorded.hashes[index]
        assert [cut for cut in recorded.session.cuts if cut.index < index] == twin.cuts
        assert [entry for entry in recorded.session.edits if entry.index < index] == twin.edits
        log = Log(recorded.session.edits, recorded.session.cuts)
        while twin.index < periods:
            branches.note(twin, twin.index)
            log.advance(twin, twin.index)
        assert twin.session().state_hash == recorded.session.state_hash

    back_and_on()


@pytest.mark.slow
@settings(max_examples=3, deadline=None, derandomize=True)
@given(
    back=st.lists(st.integers(0, 60), min_size=1, max_size=3),
    kind=st.sampled_from(["push", "temi", "parameter"]),
    noted=st.booleans(),
)
def test_back_and_on_with_other_edits_is_a_session_that_reruns_to_the_same_bits(scene, back, kind, noted):
    twin, branches = Twin(scene), Branches(spacing=20)
    run(twin, branches, 60, {10: [AddObstacle(name="crate", x=2.5, y=0.3)], 30: [MoveBody(name="crate", x=2.2, y=0.1)]})
    for round_, index in enumerate(back):
        branches.branch(twin, min(index, twin.index))
        other = {
            "push": PushRobot(dx=0.02, dy=0.01),
            "temi": AddObstacle(name=f"temi{round_}", shape="temi", x=1.5, y=0.8),
            "parameter": SetParameter(name="next_weight", value=0.25 * round_),
        }[kind]
        if noted:
            branches.note(twin, twin.index)
        twin.post(other)
        twin.advance()
        run(twin, branches, min(index + 15, 60))
    session = twin.session()
    assert session.periods == twin.index
    assert rerun(session).ok


def test_a_twin_whose_searches_are_bounded_otherwise_reruns_to_the_same_bits(scene):
    twin = Twin(scene, budget=SearchBudget(expansions=20))
    run(twin, Branches(), 30)
    assert rerun(twin.session()).ok


def test_edits_that_wait_are_forgotten_when_going_back(scene):
    twin, branches = Twin(scene), Branches()
    run(twin, branches, 3)
    before = twin.state_hash()
    twin.post(PushRobot(dx=0.1, dy=0.0))
    branches.branch(twin, 3)
    assert twin.state_hash() == before
    assert twin.advance().edits == ()


def test_only_kept_periods_can_be_gone_back_to(scene):
    twin, branches = Twin(scene), Branches(spacing=2, kept=3)
    with pytest.raises(ValueError, match="nothing is kept"):
        branches.branch(twin, 0)
    run(twin, branches, 9)
    assert branches.oldest == 4
    for wrong in (-1, 3, 10):
        with pytest.raises(ValueError, match="from 4 to 9"):
            branches.branch(twin, wrong)
    assert twin.index == 9
    branches.branch(twin, 5)
    assert (twin.index, branches.oldest) == (5, 4)
    branches.clear()
    with pytest.raises(ValueError, match="nothing is kept"):
        branches.branch(twin, 5)


def test_a_period_that_is_noted_too_late_is_refused(scene):
    twin, branches = Twin(scene), Branches()
    twin.advance()
    with pytest.raises(ValueError, match="stands before period 1"):
        branches.note(twin, 0)


def test_an_undone_branch_is_as_if_it_had_not_been_and_is_set_aside_in_its_place(scene):
    twin, branches = Twin(scene), Branches(spacing=4)
    with pytest.raises(ValueError, match="no run is set aside"):
        branches.undo(twin)
    run(twin, branches, 14, {9: [AddObstacle(name="crate", x=2.5, y=0.3)]})
    end, oldest = twin.state_hash(), branches.oldest
    branches.branch(twin, 6)
    assert branches.aside == 14
    run(twin, branches, 9, {7: [PushRobot(dx=0.02, dy=0.01)]})
    other = twin.state_hash()
    branches.undo(twin)
    assert (twin.index, twin.state_hash(), branches.oldest, branches.aside) == (14, end, oldest, 9)
    assert [entry.index for entry in twin.edits] == [9]
    branches.branch(twin, 11)  # its snapshots are there again
    branches.undo(twin)
    assert twin.state_hash() == end
    branches.branch(twin, 6)
    run(twin, branches, 9, {7: [PushRobot(dx=0.02, dy=0.01)]})
    assert twin.state_hash() == other
    branches.undo(twin)
    branches.undo(twin)
    assert (twin.index, twin.state_hash()) == (9, other)
    run(twin, branches, 12)
    assert rerun(twin.session()).ok
    branches.clear()
    assert branches.aside is None
