"""The blocks of docs/tutorial.md, run from the first to the last as they stand, in an empty folder."""

import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "tutorial.md"
START = 120.0  # [s] for `serve` on a busy machine
BLOCK = re.compile(r'^```(\w+)(?: title="([\w.]+)")?\n(.*?)^```$', re.S | re.M)


class Block(NamedTuple):
    """A block of the page: its language, the file that it is saved as ("": it is run), and its text."""

    language: str
    file: str
    text: str


def blocks():
    return [Block(*found) for found in BLOCK.findall(PAGE.read_text(encoding="utf-8"))]


class Reader:
    """Does what the page says, in one folder and one Python."""

    def __init__(self, folder, capfd, call):
        self.folder, self._capfd, self._call = folder, capfd, call
        self._names = {"__name__": "__tutorial__"}
        self._log = folder / "serve.log"
        self._served = []
        self._env = os.environ | {
            "PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": str(ROOT),
            "TMPDIR": str(folder),  # twins of other tests are not found
            "COLUMNS": "200",
        }

    def do(self, block):
        """Output of a block."""
        if block.file:
            (self.folder / block.file).write_text(block.text, encoding="utf-8")
            return ""
        if block.language == "python":
            exec(block.text, self._names)  # noqa: S102 - our own text
            return self._capfd.readouterr().out
        if block.text.startswith("motm-twin serve"):
            return self._serve(block.text)
        (command,) = block.text.splitlines()
        program, *words = shlex.split(command)
        assert program == "motm-twin"
        done = self._call(*words, COLUMNS="200")
        assert not done.returncode, f"{block.text}{done.stdout}{done.stderr}"
        return done.stdout

    def _serve(self, command):
        """In a second terminal, until the page is there and the scene is loaded."""
        with self._log.open("w", encoding="utf-8") as log:
            self._served.append(
                subprocess.Popen(command.split(), cwd=self.folder, env=self._env, stdout=log, stderr=log)
            )
        deadline = time.monotonic() + START
        while not all(word in (said := self._log.read_text(encoding="utf-8")) for word in ("Page:", "paused:")):
            assert self._served[-1].poll() is None, said
            assert time.monotonic() < deadline, said
            time.sleep(0.1)
        return said

    def close(self):
        for process in self._served:
            process.terminate()
            process.wait(20.0)


@pytest.fixture
def reader(tmp_path, capfd, monkeypatch, call):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setenv("MPLBACKEND", "Agg")
    does = Reader(tmp_path, capfd, call)
    yield does
    does.close()


def test_the_tutorial_has_ten_steps():
    assert re.findall(r"^## (\d+)\.", PAGE.read_text(encoding="utf-8"), re.M) == [str(n) for n in range(1, 11)]


@pytest.mark.slow
def test_every_block_of_the_tutorial_runs_and_says_what_the_page_shows(reader):
    said = ""
    for block in blocks():
        if block.language == "text":
            place = 0
            for line in block.text.splitlines():  # in this order
                place = said.find(line, place)
                assert place >= 0, f"{line!r} is not in:\n{said}"
                place += len(line)
        else:
            said = reader.do(block)
    assert (reader.folder / "speed.png").read_bytes().startswith(b"\x89PNG")
    assert (reader.folder / "mine.json").is_file()
