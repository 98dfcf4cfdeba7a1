"""Finished trials on disk: one JSON line each, written through to the disk before the next one counts.

A line that was cut off by a crash is left out and cut away; everything before it holds. One process writes at a time.
"""

import fcntl
import os
from pathlib import Path
from typing import Any, Self

import msgspec

from motm_twin.sessions.session import Session, save_session
from motm_twin.studies.spec import TrialSpec

TRIALS = "trials.jsonl"
RESULTS = "results.jsonl"
SESSIONS = "sessions"


class Record(msgspec.Struct, frozen=True, kw_only=True):
    """A line of the store."""

    key: str  # of `Job.key`
    spec: TrialSpec
    result: dict[str, Any]  # with its "wall": what a clock measured
    session: str = ""  # of a trial without success, for `motm-twin rerun`: file beside the store
    made_with: dict[str, str]  # where it was run


class Store:
    """The trials of one experiment in a folder of their own, which is made when it is not there."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.path = folder / TRIALS

    def read(self) -> dict[str, Record]:
        """Records by key; of two with the same key the newer one."""
        if not self.path.is_file():
            return {}
        found = (_decoded(line) for line in self.path.read_bytes().split(b"\n"))
        return {record.key: record for record in found if record is not None}

    def __enter__(self) -> Self:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._file = self.path.open("a+b")
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            self._file.close()
            raise ValueError(
                f"{self.path}: another run writes to it now; wait for it, or give another --out"
            ) from error
        self._cut_half_line()
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def append(self, record: Record) -> None:
        """Add a record; when this returns it is on the disk."""
        self._file.write(msgspec.json.encode(record) + b"\n")
        self._file.flush()
        os.fsync(self._file.fileno())

    def keep_session(self, key: str, session: Session | None) -> str:
        """Save the session of a trial that went wrong; its name relative to the folder, "" for none."""
        if session is None:
            return ""
        name = f"{SESSIONS}/{key}.json"
        (self.folder / SESSIONS).mkdir(exist_ok=True)
        save_session(session, self.folder / name)
        return name

    def write_results(self, results: list[dict[str, Any]]) -> None:
        """All results in the experiment's order, without what a clock measured: equal runs give equal files."""
        lines = [{key: value for key, value in result.items() if key != "wall"} for result in results]
        text = b"".join(msgspec.json.encode(line, order="sorted") + b"\n" for line in lines)
        temporary = self.folder / f".{RESULTS}"
        temporary.write_bytes(text)
        temporary.replace(self.folder / RESULTS)

    def _cut_half_line(self) -> None:
        data = self.path.read_bytes()
        if data and not data.endswith(b"\n"):
            self._file.truncate(data.rfind(b"\n") + 1)


def _decoded(line: bytes) -> Record | None:
    try:
        return msgspec.json.decode(line, type=Record) if line else None
    except msgspec.MsgspecError:
        return None  # cut off, or written by another version: the trial is run again
