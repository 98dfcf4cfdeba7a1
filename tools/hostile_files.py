"""Reads many mutated recordings and sessions with everything that reads them, and reports what is not a sentence.

``python tools/hostile_files.py --count 100000`` makes files from the sessions of `tests/recorded` and a recording of
a few periods: values, messages and bytes are others, lists are long, objects stand in wrong places, numbers are odd.
A file may be read or refused with one printable sentence, within 500 MB and 30 s. Anything else is kept in ``--keep``
and named. Files are read in child processes, a batch in each, so that a hang or a crash costs one file. Exit code 0:
nothing was found.
"""

import argparse
import copy
import io
import json
import multiprocessing
import os
import random
import sys
import tempfile
import time
import traceback
from collections import Counter
from contextlib import redirect_stdout, suppress
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import msgspec
from mcap.writer import CompressionType, IndexType, Writer

from motm_twin.bus.encode import ObservationEncoder, tick_message
from motm_twin.cli.run import rerun_file
from motm_twin.record import channels as ch
from motm_twin.record.mcap_file import McapFile, read, recover
from motm_twin.record.player import Frames
from motm_twin.record.recording import info, load_recording, show
from motm_twin.record.replay import player
from motm_twin.sessions.session import SessionError, encode_session, load_session
from motm_twin.twin import Twin

ROOT = Path(__file__).resolve().parents[1]
SECONDS, MEGABYTES = 30.0, 500.0  # that one file may take, with the program
PROGRAM = 250.0  # [MB] of the program before it reads one
PERIODS = 3  # of a session that is read are computed
TICKS = 4  # periods of the recording
BATCH = 200  # files of a child process
GRACE = 5.0  # [s] beyond, until a child is given up
LOST = ("hangs", "ends its process")  # verdicts on files that no answer came for
SESSIONS, RUN = 0.6, 0.1  # shares: of sessions among the files, and of readable files that are computed again

NUMBERS: list[Any] = [
    0, -0.0, -1, 0.5, 1e-320, 1e-9, 1e9, 1e30, 1e308, -1e308, 2**31, 2**53, 2**63, 2**64, -(2**63), 10**30, 10**400,
    float("inf"), float("-inf"), float("nan"),
]  # fmt: skip
TEXTS = [
    "",
    "x" * 100_000,
    "a\x1b]0;x\x07\x1b[2J",
    "\u202eb\x00\x9b31m",
    "[red]c",
    "\ud800",
    "../../x",
    "é" * 300,
    "NaN",
]
THINGS: list[Any] = [None, True, [], {}, [[]], [None], {"type": "pick"}, {"type": "drive_to", "point": [1.0, 0.0]}]
COUNTS = (2, 10, 300, 5_000)  # copies of an entry of a list


def mutated(tree: Any, rng: random.Random, donor: Any) -> Any:
    """The same tree with some values gone, doubled, odd, or from elsewhere in ``donor``."""
    tree = copy.deepcopy(tree)
    for _ in range(rng.choice((1, 1, 1, 2, 4))):
        _change(tree, rng, donor)
    return tree


def _change(tree: Any, rng: random.Random, donor: Any) -> None:
    owner, key = _place(tree, rng)
    if owner is None:
        return
    value = owner[key]
    match rng.randrange(11):
        case 0:
            del owner[key]
        case 1 if isinstance(owner, list):
            owner[key:key] = [copy.deepcopy(value) for _ in range(rng.choice(COUNTS if _small(value) else COUNTS[:2]))]
        case 2 | 9 | 10 if isinstance(value, int | float):
            with suppress(OverflowError, ValueError):  # what is no number any more stays as it is
                scaled = value * rng.choice((-1, 0, 0.5, 0.9, 0.999, 1.01, 1.2, 2, 10, 1000))
                owner[key] = int(scaled) if isinstance(value, int) else scaled
        case 3 | 4:
            other, place = _place(donor, rng)
            owner[key] = value if other is None else copy.deepcopy(other[place])
        case 5:
            owner[key] = rng.choice(TEXTS)
        case 6:
            owner[key] = copy.deepcopy(rng.choice(THINGS))
        case 7 if isinstance(owner, dict):
            owner[rng.choice(TEXTS)] = value
        case _:
            owner[key] = rng.choice(NUMBERS)


def _place(tree: Any, rng: random.Random) -> tuple[Any, Any]:
    """A container in the tree and one of its keys; None when the tree is empty."""
    found: tuple[Any, Any] = (None, None)
    while isinstance(tree, dict | list) and tree:
        key = rng.choice(list(tree)) if isinstance(tree, dict) else rng.randrange(len(tree))
        found, tree = (tree, key), tree[key]
        if rng.random() < 0.15:
            break
    return found


def _small(value: Any) -> bool:
    return len(json.dumps(value)) < 2_000


def dumped(tree: Any) -> bytes:
    """JSON with whatever is in it."""
    return json.dumps(tree).encode("utf-8", "surrogatepass")


def broken(data: bytes, rng: random.Random) -> bytes:
    """Some bytes are others, gone or doubled; the end may be missing."""
    found = bytearray(data)
    for _ in range(rng.randint(1, 8)):
        at = rng.randrange(len(found))
        match rng.randrange(5):
            case 0:
                del found[at : at + rng.randint(1, 64)]
            case 1:
                found[at:at] = found[at : at + rng.randint(1, 512)]
            case 2:
                found[at : at + 8] = rng.choice((b"\xff" * 8, bytes(8), rng.randbytes(8)))
            case _:
                found[at] = rng.randrange(256)
        if not found:
            return b""
    return bytes(found[: rng.randrange(len(found))] if rng.random() < 0.1 else found)


class Sessions:
    """Mutated saved sessions."""

    suffix = ".json"

    def __init__(self) -> None:
        files = sorted((ROOT / "tests" / "recorded").glob("*.json"))
        self.whole = [encode_session(load_session(file)) for file in files]
        self.trees = [json.loads(data) for data in self.whole]

    def make(self, rng: random.Random) -> bytes:
        """One of them."""
        if rng.random() < 0.25:
            return broken(rng.choice(self.whole), rng)
        tree = mutated(rng.choice(self.trees), rng, rng.choice(self.trees))
        if rng.random() < 0.05:
            return _nested(tree, rng)
        return dumped(tree)

    def use(self, path: Path, rng: random.Random) -> None:
        """Read it, compute the begin of some."""
        session = load_session(path)
        if rng.random() < RUN:
            for _ in player(session, until=PERIODS):
                pass


def _nested(tree: Any, rng: random.Random) -> bytes:
    depth = rng.choice((10, 900, 20_000, 400_000))
    return b"[" * depth + dumped(tree) + b"]" * depth


class Recordings:
    """Mutated recordings."""

    suffix = ".mcap"

    def __init__(self, folder: Path) -> None:
        session = load_session(ROOT / "tests" / "recorded" / "branch_with_other_parameters.json")
        twin, encoder = Twin(session.scene), ObservationEncoder()
        file = McapFile(folder / "base.mcap")
        file.add(ch.SCENE, 4.0, msgspec.json.encode(ch.RecordedScene(scene=session.scene)))
        for index in range(TICKS):
            now, tick = 5.0 + 0.05 * index, twin.advance()
            file.add(ch.TICK, now, msgspec.json.encode(tick_message(tick, 1, now, began=1.0)))
            file.add(ch.OBSERVATIONS, now, msgspec.json.encode(encoder.message(tick, 1, now)))
        started = msgspec.structs.replace(twin.session(), state_hash="")
        file.add(ch.SESSION, 6.0, dumped({"run": 1, "began": 1.0, "session": json.loads(encode_session(started))}))
        file.close()
        self.entries = [(entry.topic, entry.log_time, entry.data) for entry in read(folder / "base.mcap")]
        self.whole = (folder / "base.mcap").read_bytes()
        self.plain = written(self.entries, chunks=False)
        self.donors = [json.loads(data) for _, _, data in self.entries]

    def make(self, rng: random.Random) -> bytes:
        """One of them."""
        match rng.randrange(10):
            case 0:
                return broken(self.whole, rng)
            case 1 | 2 | 3:  # nothing is checked by a sum there
                return broken(self.plain, rng)
            case 4 if rng.random() < 0.05:
                topic, at, data = rng.choice(self.entries)
                small = rng.choice((b"", b"{}", b"[]", data[:50]))
                return written([(topic, at, small)] * rng.choice((1_000, 100_000)), chunks=True)
        entries = list(self.entries)
        for _ in range(rng.choice((1, 1, 2, 5))):
            at = rng.randrange(len(entries))
            topic, stamp, data = entries[at]
            match rng.randrange(6):
                case 0:
                    del entries[at]
                case 1:
                    entries[at:at] = [entries[at]] * rng.choice(COUNTS[:3])
                case 2:
                    entries[at] = (rng.choice(list(ch.CHANNELS)), rng.choice((0, 1, stamp, 2**63)), data)
                case _:
                    entries[at] = (topic, stamp, dumped(mutated(json.loads(data), rng, rng.choice(self.donors))))
            if not entries:
                break
        return written(entries, chunks=rng.random() < 0.5)

    def use(self, path: Path, rng: random.Random) -> None:
        """Everything that reads a recording; each may refuse it."""
        out = path.with_name("recovered.mcap")
        uses = [
            lambda: show(info(path)),
            lambda: load_recording(path),
            lambda: Frames(path),
            lambda: recover(path, out),
        ]
        if rng.random() < RUN:
            uses.append(lambda: rerun_file(str(path)))
        refused: SessionError | None = None
        for use in uses:
            try:
                use()
            except SessionError as error:
                _require_sentence(error)
                refused = error
            out.unlink(missing_ok=True)
        if refused is not None:
            raise refused


def written(entries: list[tuple[str, int, bytes]], *, chunks: bool) -> bytes:
    """A file of these messages, as another program writes it."""
    out = io.BytesIO()
    options = {"compression": CompressionType.ZSTD if chunks else CompressionType.NONE, "use_chunking": chunks}
    writer = Writer(out, index_types=IndexType.NONE, enable_crcs=chunks, **options)  # type: ignore[arg-type]
    writer.start("", "somebody")
    numbers: dict[str, int] = {}
    for topic, stamp, data in entries:
        if topic not in numbers:
            numbers[topic] = writer.register_channel(topic, "json", 0)
        writer.add_message(numbers[topic], stamp, data, stamp)
    writer.finish()
    return out.getvalue()


def _require_sentence(error: SessionError) -> None:
    if not str(error).isprintable():
        raise AssertionError(f"not printable: {str(error)[:200]!r}") from error


def judge(kind: Sessions | Recordings, path: Path, rng: random.Random, parent: float) -> str:
    """Read one file; "read", "refused", or what is wrong with how it was read.

    ``parent`` [MB]: memory that this process began with, as the child of another.
    """
    _forget_peak()
    began, said = time.monotonic(), io.StringIO()
    try:
        with redirect_stdout(said):
            kind.use(path, rng)
        verdict = "read"
    except SessionError as error:
        verdict = "refused" if str(error).isprintable() else f"not printable: {str(error)[:200]!r}"
    except BaseException:
        return traceback.format_exc()
    if (seconds := time.monotonic() - began) > SECONDS:
        return f"took {seconds:.1f} s"
    if (most := _peak_mb() - parent + PROGRAM) > MEGABYTES:
        return f"took {most:.0f} MB"
    return verdict


def _forget_peak() -> None:
    Path("/proc/self/clear_refs").write_text("5")


def _peak_mb() -> float:
    (line,) = (line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1000.0


class Hunt:
    """Batches in child processes."""

    def __init__(self, seed: int, keep: Path, folder: Path) -> None:
        self._seed, self._keep, self._folder = seed, keep, folder
        self._kinds = (Sessions(), Recordings(folder))
        self.verdicts: Counter[str] = Counter()
        self.found: list[str] = []
        self.slowest, self.largest = (0.0, -1), (0.0, -1)  # and the number of the file

    def report(self) -> str:
        """What became of the files so far."""
        verdicts = ", ".join(f"{count:,} {verdict}" for verdict, count in sorted(self.verdicts.items()))
        worst = (
            f"slowest {self.slowest[0]:.1f} s (file {self.slowest[1]}), "
            f"largest {self.largest[0]:.0f} MB (file {self.largest[1]})"
        )
        return f"{verdicts}; {worst}; {len(self.found)} found"

    def run(self, first: int, count: int) -> None:
        """Read files number ``first`` to ``first + count``."""
        at = first
        while at < first + count:
            at = self._batch(at, min(at + BATCH, first + count))

    def _batch(self, at: int, end: int) -> int:
        """Read until ``end`` in a child; the first number that was not read."""
        here, there = multiprocessing.Pipe(duplex=False)
        child = multiprocessing.get_context("fork").Process(target=self._read, args=(at, end, there))
        child.start()
        there.close()
        while at < end:
            verdict, seconds, peak = self._heard(here)
            if verdict in LOST:
                child.kill()
            self._note(at, verdict, seconds, peak)
            at += 1
            if verdict in LOST:
                break
        child.join()
        return at

    @staticmethod
    def _heard(pipe: Connection) -> tuple[str, float, float]:
        """Verdict, time [s] and memory [MB] of the next file."""
        try:
            return pipe.recv() if pipe.poll(SECONDS + GRACE) else (LOST[0], SECONDS, 0.0)
        except EOFError:
            return LOST[1], 0.0, 0.0

    def _note(self, number: int, verdict: str, seconds: float, peak: float) -> None:
        self.slowest, self.largest = max(self.slowest, (seconds, number)), max(self.largest, (peak, number))
        kind = self._kind(number)
        if verdict in ("read", "refused"):
            self.verdicts[f"{kind.suffix[1:]} {verdict}"] += 1
            return
        self.found.append(f"file {number}: {verdict}")
        self._keep.mkdir(parents=True, exist_ok=True)
        (self._keep / f"{number}{kind.suffix}").write_bytes(kind.make(self._rng(number)))
        print(f"file {number}{kind.suffix}: {verdict}", flush=True)

    def _read(self, at: int, end: int, pipe: Connection) -> None:
        sys.stderr = open(os.devnull, "w")  # noqa: PTH123 - until the child ends
        _forget_peak()
        parent = _peak_mb()
        for number in range(at, end):
            kind, rng = self._kind(number), self._rng(number)
            path = self._folder / f"mutated{kind.suffix}"
            path.write_bytes(kind.make(rng))
            began = time.monotonic()
            verdict = judge(kind, path, rng, parent)
            pipe.send((verdict, time.monotonic() - began, _peak_mb() - parent + PROGRAM))
        pipe.close()

    def _rng(self, number: int) -> random.Random:
        return random.Random(f"{self._seed} {number}")

    def _kind(self, number: int) -> Sessions | Recordings:
        return self._kinds[self._rng(-number - 1).random() >= SESSIONS]


def main() -> int:
    """Make, read, report."""
    options = _options()
    with tempfile.TemporaryDirectory() as folder:
        hunt = Hunt(options.seed, options.keep, Path(folder))
        began = time.monotonic()
        for at in range(options.first, options.first + options.count, 10 * BATCH):
            hunt.run(at, min(10 * BATCH, options.first + options.count - at))
            print(f"{hunt.report()} in {time.monotonic() - began:.0f} s", flush=True)
    return 1 if hunt.found else 0


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=2_000, help="files (default 2,000)")
    parser.add_argument("--first", type=int, default=0, help="number of the first one")
    parser.add_argument("--seed", type=int, default=1, help="of all mutations")
    parser.add_argument("--keep", type=Path, default=Path("out/hostile"), help="folder of what was found")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
