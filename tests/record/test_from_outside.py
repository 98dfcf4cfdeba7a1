"""Files from anybody are bounded by their size, and what is broken is said; so the tool finds that mutates files."""

import json
import os
import struct
import time

import msgspec
import pytest
from mcap.writer import CompressionType, IndexType, Writer
from rich.table import Table

from motm_twin.bus.commands import Refused
from motm_twin.bus.data_folder import DataFolder
from motm_twin.bus.encode import ObservationEncoder, tick_message
from motm_twin.cli.run import rerun_file
from motm_twin.program import plain_console, printable, table_console
from motm_twin.record import channels as ch
from motm_twin.record.mcap_file import FREE_MESSAGES, MAX_NAMES, McapFile, read, recover
from motm_twin.record.player import Frames
from motm_twin.record.recording import info, load_recording, show
from motm_twin.record.replay import RecordedPlant
from motm_twin.sessions import session as session_module
from motm_twin.sessions.session import SessionError, decode_session, encode_session, save_session
from motm_twin.twin import Twin

DEEP = b"[" * 5_000 + b"]" * 5_000


def written(path, messages, topic=ch.TICK.topic, topics=1):
    """A file of these payloads, whatever they are, as another program writes it."""
    with path.open("wb") as file:
        options = {"compression": CompressionType.ZSTD, "chunk_size": 64 * 1024 * 1024, "index_types": IndexType.NONE}
        writer = Writer(file, **options)
        writer.start("", "somebody")
        numbers = [writer.register_channel(topic + "x" * k, "json", 0) for k in range(topics)]
        for payload in messages:
            writer.add_message(numbers[0], 1, payload, 1)
        writer.finish()
    return path


@pytest.fixture(scope="module")
def ticks(recorded):
    """The payloads of some ticks of a run, and its scene."""
    twin = Twin(recorded.session.scene)
    return [msgspec.json.encode(tick_message(twin.advance(), 1, 5.0 + 0.05 * k, began=1.0)) for k in range(6)]


def recording(path, scene, ticks):
    """A small whole recording, with a scene as JSON takes it."""
    file = McapFile(path)
    file.add(ch.SCENE, 4.0, msgspec.json.encode({"scene": scene}))
    for payload in ticks:
        file.add(ch.TICK, 5.0, payload)
    file.close()
    return path


def uses(path, tmp_path):
    """Everything that reads a recording, one after the other."""
    out = tmp_path / "out.mcap"
    for use in (info, load_recording, Frames, lambda file: recover(file, out)):
        yield use, path
        out.unlink(missing_ok=True)


def test_a_small_file_that_unpacks_to_millions_of_messages_is_refused_as_it_is_read(tmp_path):
    bomb = written(tmp_path / "bomb.mcap", [b""] * (10 * FREE_MESSAGES), topic="/x")
    for use, path in uses(bomb, tmp_path):
        words = r"bomb\.mcap: holds more than [0-9,]+ messages in .* MB: it is no recording"
        with pytest.raises(SessionError, match=words):
            use(path)
    assert sorted(file.name for file in tmp_path.iterdir()) == ["bomb.mcap"]
    seen = 0
    with pytest.raises(SessionError):
        for _ in read(bomb):
            seen += 1
    assert seen <= 2 * FREE_MESSAGES  # none of a chunk is kept in a list, or given before it is known to be whole


def test_a_file_that_unpacks_to_more_than_its_size_can_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("motm_twin.record.mcap_file.FREE_BYTES", 1_000_000)
    bomb = written(tmp_path / "bomb.mcap", [bytes(1_000_000)] * 8, topic="/x")
    with pytest.raises(SessionError, match=r"unpacks to more than .* MB from .* MB"):
        info(bomb)


def test_a_file_with_more_topics_than_a_twin_has_is_refused(tmp_path):
    with pytest.raises(SessionError, match=f"describes more than {MAX_NAMES} topics"):
        info(written(tmp_path / "many.mcap", [b"{}"], topics=MAX_NAMES + 1))


def test_a_file_with_more_edits_than_anybody_makes_is_refused(ticks, tmp_path, monkeypatch):
    monkeypatch.setattr("motm_twin.record.recording.MAX_EDITS", 10)
    tick = json.loads(ticks[0]) | {"edits": [{"type": "remove_body", "name": "x"}] * 11}
    with pytest.raises(SessionError, match=r"odd\.mcap: has more than 10 edits"):
        info(written(tmp_path / "odd.mcap", [json.dumps(tick).encode()]))


def test_a_file_that_names_a_schema_that_it_does_not_hold_is_recovered(tmp_path):
    """Two channels of one topic: the schema of the first is missing."""
    path = tmp_path / "odd.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.NONE, use_chunking=False)
        writer.start("", "")
        schema = writer.register_schema("motm.Event", "jsonschema", b"{}")
        writer.register_channel("/x", "json", schema)
        writer.add_message(writer.register_channel("/x", "json", schema), 1, b"{}", 1)
        writer.finish()
    data = bytearray(path.read_bytes())
    first = data.index(b"\x04" + struct.pack("<QHH", 2 + 2 + 4 + 2 + 4 + 4 + 4, 1, schema))
    data[first + 11 : first + 13] = struct.pack("<H", 77)
    path.write_bytes(bytes(data))
    assert recover(path).messages == 1


def of_run(run, index, past, first):
    """As much of a tick as tells how its run began."""
    plan = {"expansions": 1, "cut_by_clock": False}
    tick = {"run": run, "index": index, "time": 0.05 * index, "plan": plan, "began": 1.0, "first": first, "past": past}
    return json.dumps(tick).encode()


def test_runs_that_name_each_other_as_their_past_are_refused(tmp_path, capsys):
    """It was a RecursionError with its traceback."""
    path = written(tmp_path / "circle.mcap", [of_run(1, 5, 2, 5), of_run(2, 5, 1, 5), of_run(3, 5, 2, 5)])
    with pytest.raises(SessionError, match="run 3: the file does not tell how it began"):
        rerun_file(str(path))


def test_a_run_of_a_thousand_branches_is_known_from_its_start(recorded, tmp_path):
    """Each branch took two levels of Python's stack, of which there are a thousand."""
    ticks = [of_run(run, run, run - 1, run) for run in range(1000)]
    found = load_recording(recording(tmp_path / "long.mcap", recorded.session.scene, ticks))
    assert found.session_of(found.runs[-1]).periods == 1000


@pytest.mark.parametrize("out", ["a_file/x.mcap", "no_folder/x.mcap"])
def test_a_recovered_file_that_cannot_be_made_is_refused(ticks, out, tmp_path):
    """Removing what was not there raised NotADirectoryError, with its traceback."""
    path = written(tmp_path / "a_file", ticks)
    with pytest.raises(SessionError, match=f"{out}: cannot be written: "):
        recover(path, tmp_path / out)


@pytest.mark.parametrize("payload", [DEEP, b'{"run":' + DEEP + b"}", b"\xff\xfe", b"null", b'{"plan": 1}'])
def test_a_message_that_cannot_be_read_is_said_to_be_that(payload, tmp_path):
    path = written(tmp_path / "odd.mcap", [payload])
    for use in (info, Frames, rerun_file):
        with pytest.raises(SessionError) as refusal:
            use(str(path))
        assert str(refusal.value).startswith(f"{path}: ")


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"plan": {"expansions": 1, "cut_by_clock": False}}, "different first in period 0"),
        ({"robot": 7}, "different first in period 0"),
        ({"tasks": 7}, "different first in period 0"),
        ({"robot": "BROKEN"}, "what was recorded of it cannot be read"),  # only the comparison reads it
    ],
)
def test_a_tick_without_what_is_compared_or_that_is_read_only_in_part_is_a_difference(
    recorded, ticks, change, said, tmp_path, capsys
):
    changed = [json.dumps(json.loads(tick) | change).encode().replace(b"BROKEN", b"\xff") for tick in ticks]
    assert rerun_file(str(recording(tmp_path / "changed.mcap", recorded.session.scene, changed))) == 1
    assert said in capsys.readouterr().out


@pytest.mark.parametrize(("name", "value"), [("index", 10**400), ("index", -5), ("run", 2**60), ("first", 10**9)])
def test_numbers_that_no_twin_gives_are_refused(ticks, name, value, tmp_path):
    path = written(tmp_path / "odd.mcap", [json.dumps(json.loads(ticks[0]) | {name: value}).encode()])
    with pytest.raises(SessionError, match="is not one of this version"):
        info(path)


def test_a_scene_in_a_recording_is_checked_as_that_of_a_session(recorded, ticks, tmp_path, capsys):
    scene = json.loads(msgspec.json.encode(recorded.session.scene))
    scene["robot"]["lidar"]["beams"] = 10**9
    with pytest.raises(SessionError, match="beams"):
        rerun_file(str(recording(tmp_path / "large.mcap", scene, ticks[:1])))


@pytest.mark.parametrize(
    ("name", "value"), [("q", [0.0] * 3), ("pose", [1e300, 0.0, 0.0]), ("twist", []), ("time", 1e30), ("dq", [1e9] * 7)]
)
def test_what_no_robot_reports_is_not_computed_with(recorded, name, value):
    twin = Twin(recorded.session.scene)
    message = ObservationEncoder().message(twin.advance(), 1, 0.0)
    sample = msgspec.structs.replace(message.samples[0], **{name: value})
    with pytest.raises(ValueError, match="period 0: "):
        RecordedPlant([msgspec.structs.replace(message, samples=[sample])])


def test_a_session_of_more_values_than_memory_is_for_is_refused_before_it_is_read(recorded, monkeypatch):
    monkeypatch.setattr(session_module, "MAX_VALUES", 50_000)
    with pytest.raises(SessionError, match="values: at most 50,000 are taken"):
        decode_session(b'{"version": [' + b"[]," * 60_000 + b"[]]}")
    assert decode_session(encode_session(recorded.session)) == recorded.session


ODD = "a\x1b]0;owned\x07\x1b[2J\u202eb\x00\x9b31m [red]c"


def test_no_control_character_of_a_file_reaches_the_terminal(recorded, ticks, tmp_path, capsys):
    session = msgspec.structs.replace(recorded.session, title=ODD, method="motm", edits=(), cuts=(), periods=0)
    save_session(session, tmp_path / "odd.json")
    rerun_file(str(tmp_path / "odd.json"))
    scene = msgspec.structs.replace(recorded.session.scene, name=ODD, variant=ODD)
    show(info(recording(tmp_path / "odd.mcap", scene, ticks[:1])))
    said = capsys.readouterr().out
    assert printable(said) == said and "[red]c" in said


def test_what_is_styled_or_in_a_table_is_cleaned_too(capsys):
    table = Table("a\x1b[31m")
    table.add_row("b\x9b")
    for console in (plain_console(), table_console()):
        console.print("x\x1b[2J", style="bold")
        console.print(table)
    said = capsys.readouterr().out
    assert printable(said) == said


@pytest.mark.parametrize("suffix", [".json", ".mcap"])
@pytest.mark.parametrize("there", [False, True])
def test_save_and_record_follow_no_link_out_of_their_folder(tmp_path, suffix, there):
    folder, elsewhere = tmp_path / "data", tmp_path / "elsewhere"
    folder.mkdir()
    if there:
        elsewhere.write_text("mine")
    (folder / f"run{suffix}").symlink_to(elsewhere)
    folder_of_server = DataFolder(folder, "tcp/127.0.0.1:1", "frankie", lambda: None)
    with pytest.raises(Refused, match="is there already"):
        folder_of_server._new("run", suffix)
    assert elsewhere.exists() is there
    folder_of_server.close()


TOOL = "hostile_files"  # of the fixture `tool`


def test_mutated_files_are_read_or_refused_with_a_sentence(tool, tmp_path):
    hunt = tool.Hunt(5, tmp_path / "kept", tmp_path)
    hunt.run(0, 120)
    assert hunt.found == [] and sum(hunt.verdicts.values()) == 120
    assert set(hunt.verdicts) == {"json read", "json refused", "mcap read", "mcap refused"}


class Odd(SessionError):
    def __str__(self):
        return "a\x1b[2J"


def says_control_characters():
    raise Odd("")


@pytest.mark.parametrize(
    ("use", "words"),
    [
        pytest.param(lambda: {}["scene"], "KeyError", id="fails"),
        pytest.param(lambda: time.sleep(60.0), "hangs", id="hangs"),
        pytest.param(lambda: os._exit(1), "ends its process", id="ends"),
        pytest.param(lambda: time.sleep(0.5), "took 0", id="is slow"),
        pytest.param(lambda: len(bytearray(b"x") * 600_000_000), " MB", id="takes memory"),
        (says_control_characters, "not printable"),
    ],
)
def test_what_is_no_sentence_is_found_and_kept_and_the_next_file_is_read(tool, tmp_path, monkeypatch, use, words):
    if words in ("hangs", "took 0"):
        monkeypatch.setattr(tool, "SECONDS", 0.3)
        monkeypatch.setattr(tool, "GRACE", 0.5)
    hunt = tool.Hunt(5, tmp_path / "kept", tmp_path)
    for kind in hunt._kinds:
        monkeypatch.setattr(kind, "use", lambda path, rng: use() if path.read_bytes() else None)
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
