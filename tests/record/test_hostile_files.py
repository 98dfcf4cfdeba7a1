"""The tool that reads mutated recordings and sessions: it finds what it is made to find, and nothing in some files."""

import os
import time

import pytest

from motm_twin.sessions.session import SessionError

TOOL = "hostile_files"  # of the fixture `tool`


def test_mutated_files_are_read_or_refused_with_a_sentence(tool, tmp_path):
    hunt = tool.Hunt(5, tmp_path / "kept", tmp_path)
    hunt.run(0, 120)
    assert hunt.found == []
    assert sum(hunt.verdicts.values()) == 120
    assert set(hunt.verdicts) == {"json read", "json refused", "mcap read", "mcap refused"}


def fails(path, rng):
    raise KeyError("scene")


def hangs(path, rng):
    time.sleep(60.0)


def ends(path, rng):
    os._exit(1)


def is_slow(path, rng):
    time.sleep(0.5)


def takes_memory(path, rng):
    assert len(bytearray(b"x") * 600_000_000) > 0


class Odd(SessionError):
    def __str__(self):
        return "a\x1b[2J"


def says_control_characters(path, rng):
    raise Odd("")


@pytest.mark.parametrize(
    ("use", "words"),
    [
        (fails, "KeyError"),
        (hangs, "hangs"),
        (ends, "ends its process"),
        (is_slow, "took 0"),
        (takes_memory, " MB"),
        (says_control_characters, "not printable"),
    ],
)
def test_what_is_no_sentence_is_found_and_kept_and_the_next_file_is_read(tool, tmp_path, monkeypatch, use, words):
    if use in (hangs, is_slow):
        monkeypatch.setattr(tool, "SECONDS", 0.3)
        monkeypatch.setattr(tool, "GRACE", 0.5)
    hunt = tool.Hunt(5, tmp_path / "kept", tmp_path)
    for kind in hunt._kinds:
        monkeypatch.setattr(kind, "use", lambda path, rng, kind=kind: use(path, rng) if path.read_bytes() else None)
    hunt.run(0, 1)
    (found,) = hunt.found
    assert found.startswith("file 0: ")
    assert words in found
    (kept,) = (tmp_path / "kept").iterdir()
    assert kept.stem == "0"
    for kind in hunt._kinds:
        monkeypatch.setattr(kind, "use", lambda path, rng: None)
    hunt.run(1, 3)
    assert len(hunt.found) == 1
    assert sum(hunt.verdicts.values()) == 3
