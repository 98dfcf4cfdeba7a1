"""What `motm-twin serve` writes as it looks after its processes."""

import io
from pathlib import Path

import pytest
from rich.console import Console

from motm_twin.cli.serve import BAD_INPUT, OK, _Supervisor, serve
from motm_twin.cli.settings import ServeSettings


@pytest.mark.parametrize(
    ("state", "text", "line"),
    [
        ("paused", "", "paused"),
        ("paused", "the robot was lost", "paused: the robot was lost"),
        ("playing", "", "playing: the robot moves"),
    ],
)
def test_a_state_is_told_once(state, text, line):
    said = io.StringIO()
    supervisor = _Supervisor(Console(file=said, soft_wrap=True), "frankie", 7447, None)
    supervisor._tell({"event": "state", "state": state, "text": text})
    assert said.getvalue().rstrip("\n").partition(" s  ")[2] == line


@pytest.mark.parametrize(
    ("option", "place", "words"),
    [
        ("record", "/proc/x.mcap", "--record /proc/x.mcap: /proc cannot be written to: give another folder"),
        ("record", "no/folder/x.mcap", "in a folder that exists"),
        ("record", "file/x.mcap", "file is a file: give a folder"),
        ("data", "/proc/1/x", "--data /proc/1/x: /proc/1 cannot be written to: give another folder"),
        ("data", "file", "file is a file: give a folder"),
        ("data", "file/x", "file is a file: give a folder"),
    ],
)
def test_where_nothing_can_be_written_is_refused_before_anything_begins(
    option, place, words, tmp_path, monkeypatch, capsys
):
    (tmp_path / "file").write_text("a file where the folder should be")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(_Supervisor, "run", lambda _: pytest.fail("it began"))
    assert serve(ServeSettings(headless=True, zenoh_port=0, **{option: Path(place)})) == BAD_INPUT
    assert words in capsys.readouterr().out


def test_folders_that_can_be_written_need_not_exist_and_are_left_as_they_are(tmp_path, monkeypatch):
    monkeypatch.setattr(_Supervisor, "run", lambda _: OK)
    assert (
        serve(ServeSettings(headless=True, zenoh_port=0, data=tmp_path / "new" / "data", record=tmp_path / "x.mcap"))
        == OK
    )
    assert list(tmp_path.iterdir()) == []
