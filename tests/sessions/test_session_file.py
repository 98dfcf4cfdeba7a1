"""Session files: written whole, read back equal, refused with a sentence when something is wrong with them."""

import copy
import json
import random

import msgspec
import pytest

from motm_twin.model.scene_file import check_all, list_scenes
from motm_twin.record.replay import player
from motm_twin.sessions import session as session_module
from motm_twin.sessions.session import Session, SessionError, decode_session, encode_session, load_session, save_session

FUZZ_DECODED, FUZZ_RUN = 400, 12
ODD_VALUES = (
    None, True, 0, -1, 1e300, -1e9, 10**30, 1e-300, "", "temi", "drop1", "\x00\x1b[2J", "a" * 500,
    [], {}, [[0, 0]] * 4, {"type": "box"},
)  # fmt: skip


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


def places(value, path=()):
    """The path of every value in a JSON tree."""
    if path:
        yield path
    children = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, item in children:
        yield from places(item, (*path, key))


def mutated(raw, rng):
    """A copy in which one value is gone, doubled, scaled or something odd."""
    raw = copy.deepcopy(raw)
    *way, last = rng.choice([path for path in places(raw) if path[0] != "made_with"])
    owner = raw
    for step in way:
        owner = owner[step]
    kind = rng.randrange(4)
    if kind == 0:
        del owner[last]
    elif kind == 1 and isinstance(owner, list):
        owner.insert(last, copy.deepcopy(owner[last]))
    elif kind == 2 and isinstance(owner[last], int | float):
        owner[last] *= rng.choice([-1, 0, 0.5, 1.01, 2, 1000])
    else:
        owner[last] = rng.choice(ODD_VALUES)
    return raw


def test_mutated_files_are_read_run_or_refused_but_never_crash(recorded):
    rng, raw = random.Random(7), json.loads(encode_session(recorded.session))
    readable = []
    for _ in range(FUZZ_DECODED):
        data = json.dumps(mutated(raw, rng)).encode()
        try:
            readable.append(decode_session(data))
        except SessionError as refusal:
            assert str(refusal).isprintable()
    assert readable
    for session in readable[:FUZZ_RUN]:
        try:
            for _ in player(session, until=15):
                pass
        except SessionError as refusal:
            assert str(refusal).isprintable()


def test_bytes_changed_at_random_are_read_or_refused(recorded):
    rng, data = random.Random(11), encode_session(recorded.session)
    for _ in range(FUZZ_DECODED):
        broken = bytearray(data)
        for _ in range(rng.randint(1, 4)):
            broken[rng.randrange(len(broken))] = rng.randrange(256)
        if rng.random() < 0.2:
            del broken[rng.randrange(len(broken)) :]
        try:
            decode_session(bytes(broken))
        except SessionError as refusal:
            assert str(refusal).isprintable()
