"""Session files: written whole, read back equal, refused with a sentence when something is wrong with them."""

import json

import msgspec
import pytest

from motm_twin.model.scene_file import check_all, list_scenes
from motm_twin.sessions import session as session_module
from motm_twin.sessions.session import Session, SessionError, decode_session, encode_session, load_session, save_session


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


def test_every_variant_of_every_shipped_scene_passes_the_checks_of_a_session():
    for listing in list_scenes():
        for scene in check_all(listing.name):
            session = Session(scene=scene)
            assert decode_session(encode_session(session)) == session


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
