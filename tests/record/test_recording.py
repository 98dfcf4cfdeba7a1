"""What a twin did, as a recording tells it: complete, valid, the same again, and readable when it broke."""

import json
import random
from pathlib import Path

import jsonschema
import msgspec
import pytest
from fake_twin import FakeTwin, fake_scene
from recordings import Recording, changed, cut, damaged
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import AddObstacle, Branch, Load, MoveBody, SetParameter, Step
from motm_twin.bus.encode import RobotEncoder, tick_message
from motm_twin.bus.library import TwinSetup
from motm_twin.bus.server import TwinServer
from motm_twin.cli.record import recover as recover_command
from motm_twin.cli.run import rerun_file
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene_file import load_scene
from motm_twin.record import channels as ch
from motm_twin.record.foxglove import WORLD, Drawer
from motm_twin.record.mcap_file import Health, read, recover
from motm_twin.record.recording import info, load_recording, show
from motm_twin.record.replay import _differing, rerun_run
from motm_twin.sessions.session import SessionError
from motm_twin.twin import Twin

READY = 240.0  # [s] the first start compiles, on a machine that may be busy
BRANCHED, ENDED = 25, 45
LATE = 12  # period at which the second recorder began, or before


class Library:
    def choices(self):
        return []

    def load(self, scene, variant, seed):
        return load_scene(scene, variant, seed)

    def changed(self):
        return False


@pytest.fixture(scope="module")
def files(tmp_path_factory, clocked):
    """Two recordings of one run with a branch: from the start, and from its middle on."""
    folder = tmp_path_factory.mktemp("recordings")
    first = Load(scene="exp1", variant="trial2", seed=1, method="no_rotation_cost")
    server = TwinServer(TwinSetup(library=Library(), make_twin=clocked, first=first, playing=False), data=folder)
    whole = Recording(server.endpoint, folder / "whole.mcap")  # before there is anything to be recorded
    assert whole.event()["event"] == "recording"
    with server, TwinClient(server.endpoint) as client:
        until(lambda: client.tick() and client.status(), "the twin never started", READY)

        def go_to(index):
            assert client.command(Step(count=index - client.tick().index)).ok
            until(lambda: client.tick().index == index, f"period {index} was not reached", 60.0)

        go_to(5)
        assert client.command(AddObstacle(name="guest", shape="temi", x=2.4, y=0.3)).ok
        go_to(LATE)
        late = Recording(server.endpoint, folder / "late.mcap")
        assert late.event()["event"] == "recording"
        assert client.command(SetParameter(name="next_weight", value=0.5)).ok
        assert client.command(MoveBody(name="guest", x=2.2, y=0.2, held=False)).ok
        go_to(BRANCHED + 10)
        run = client.tick().run
        assert client.command(Branch(index=BRANCHED)).ok
        until(lambda: client.tick().run == run + 1, "the branch did not begin", 60.0)
        go_to(ENDED - 1)
        for recorder in (whole, late):
            code, last = recorder.end()
            assert (code, last["event"], last["lost_periods"]) == (0, "recorded", 0)
    return folder / "whole.mcap", folder / "late.mcap"


@pytest.fixture(scope="module")
def whole(files):
    return files[0]


def test_a_recording_tells_what_is_in_it(whole, capsys, monkeypatch):
    monkeypatch.delenv("COLUMNS", raising=False)
    found = info(whole)
    show(found)
    printed = capsys.readouterr().out
    assert all(word in printed for word in ("simulated", "motm.Tick", *(run.scene for run in found.runs))), "cut"
    assert (found.complete, found.text) == (True, "")
    assert [(run.from_s, run.to_s, run.missing) for run in found.runs] == [
        (0.0, (BRANCHED + 11) * 0.05, 0),
        (BRANCHED * 0.05, ENDED * 0.05, 0),
    ]
    assert [run.edits for run in found.runs] == [3, 0]
    assert all(run.hashes for run in found.runs)
    assert {run.method for run in found.runs} == {"no_rotation_cost"}
    topics = {channel.topic: channel for channel in found.channels}
    assert topics["/motm/tick"].messages >= BRANCHED + 11 + ENDED - BRANCHED
    assert set(topics) >= ch.CHANNELS.keys() - {"/motm/metrics", "/motm/observations"}


def test_every_run_is_the_same_again_with_its_branch_and_with_half_of_its_past(files):
    for path in files:
        recording = load_recording(path)
        assert len(recording.runs) == 2
        reports = [rerun_run(recording, run) for run in recording.runs]
        assert all(report.ok and not report.fields and report.hashes for report in reports)
        assert [report.periods for report in reports] == [BRANCHED + 11, ENDED]
        assert reports[1].compared == ENDED - BRANCHED
    assert reports[0].compared < BRANCHED + 11


def without_session(topic, message):
    return None if topic == "/motm/session" else message


def test_without_any_session_the_ticks_alone_repeat_the_run(whole, tmp_path):
    recording = load_recording(changed(whole, tmp_path / "x.mcap", without_session))
    assert [rerun_run(recording, run).ok for run in recording.runs] == [True, True]


def test_the_first_period_that_differs_is_named_with_its_fields(whole, tmp_path, capsys):
    def shift(topic, message):
        if topic == "/motm/tick" and message["index"] >= 17:
            message["robot"]["pose"][0] += 1e-6
            message["plan"]["expansions"] += 1
        return message

    path = changed(whole, tmp_path / "x.mcap", shift)
    recording = load_recording(path)
    report = rerun_run(recording, recording.runs[0])
    assert (report.ok, report.period) == (False, 17)
    assert [line.split(":")[0] for line in report.fields] == ["robot.pose[0]", "plan.expansions"]
    assert rerun_file(str(path)) == 1
    assert "first in period 17" in capsys.readouterr().out


@pytest.mark.parametrize(("error", "ok"), [(1.5e-15, True), (1e-3, False)])
def test_times_with_all_their_digits_are_the_same_times(whole, tmp_path, error, ok):
    def unrounded(topic, message):
        if topic == "/motm/tick":
            for timed in (message, *message["arm"], *message["events"]):
                timed["time"] += error
        return message

    recording = load_recording(changed(whole, tmp_path / "x.mcap", unrounded))
    assert rerun_run(recording, recording.runs[0]).ok is ok


def test_another_state_behind_equal_periods_is_found_by_its_hash(whole, tmp_path):
    def other(topic, message):
        if topic == "/motm/session":
            message["session"]["state_hash"] = "0" * 64
        return message

    recording = load_recording(changed(whole, tmp_path / "x.mcap", other))
    report = rerun_run(recording, recording.runs[0])
    assert not report.ok and report.fields[0].startswith("state hash: recorded 000000000000")


def test_an_edit_in_a_period_that_is_missing_is_not_made_up(whole, tmp_path):
    def thin(topic, message):
        return None if topic == "/motm/session" or (topic == "/motm/tick" and message["index"] == 20) else message

    recording = load_recording(changed(whole, tmp_path / "x.mcap", thin))
    report = rerun_run(recording, recording.runs[0])
    assert (report.ok, report.periods) == (True, 20)
    assert report.text.startswith("periods 20 to 35 were not computed")


def test_an_edit_that_is_refused_now_is_a_difference(whole, tmp_path, capsys):
    def to_nobody(topic, message):
        if topic == "/motm/tick" and message["index"] == 8:
            message["edits"] = [{"type": "move_body", "name": "nobody", "x": 0.0, "y": 0.0}]
        return None if topic == "/motm/session" else message

    assert rerun_file(str(changed(whole, tmp_path / "x.mcap", to_nobody))) == 1
    assert "different first in period 8 (0.40 s):\n  period 8: the edit MoveBody is refused" in capsys.readouterr().out


def test_a_run_of_which_only_the_end_is_known_is_not_computed_and_is_no_difference(files, tmp_path):
    words = "on, and of what was done before the file tells nothing; run 2: it goes on"
    with pytest.raises(SessionError, match=words):
        rerun_file(str(changed(files[1], tmp_path / "x.mcap", without_session)))


def test_every_message_fits_its_schema(whole):
    health, seen = Health(), {}
    entries = list(read(whole, health))
    schemas = {channel.topic: health.schemas[channel.schema_id] for channel in health.channels.values()}
    validators = {topic: jsonschema.Draft202012Validator(json.loads(schema.data)) for topic, schema in schemas.items()}
    for entry in entries:
        seen[entry.topic] = seen.get(entry.topic, 0) + 1
        if seen[entry.topic] <= 12:
            validators[entry.topic].validate(json.loads(entry.data))
    assert set(seen) == set(schemas)


def test_foxglove_messages_have_every_field_and_no_other(whole):
    def check(value, schema, place):
        if schema.get("type") == "object":
            assert set(value) == set(schema["properties"]), place
            for name, inner in schema["properties"].items():
                check(value[name], inner, f"{place}.{name}")
        elif schema.get("type") == "array":
            for item in value[:3]:
                check(item, schema["items"], place)

    for entry in read(whole):
        if entry.schema.startswith("foxglove."):
            check(json.loads(entry.data), ch.CHANNELS[entry.topic].schema, entry.topic)


def test_a_server_whose_clock_is_earlier_is_drawn_at_once():
    """After a restart with the clock set back, bodies, paths and plots were missing until the old time had come."""
    drawn = []
    drawer = Drawer(lambda channel, *_: drawn.append(channel.topic))
    tick = Twin(load_scene("exp1", "trial1")).advance()
    for server_time, wanted in ((1000.0, True), (1000.02, False), (500.0, True), (500.02, False), (500.1, True)):
        assert drawer.wants_tick(server_time) == wanted
        if wanted:
            drawer.tick(tick_message(tick, 1, server_time))
    assert drawn.count(ch.PLOTS.topic) == 3


def test_viewers_that_know_no_references_find_plain_fields_in_front():
    def plain(schema):
        assert "$ref" not in schema
        assert schema["type"] in ("object", "array", "number", "integer", "string", "boolean")
        for inner in schema.get("properties", {}).values():
            plain(inner)
        if schema["type"] == "array":
            assert schema["items"]["type"] != "array"
            plain(schema["items"])

    for channel in (channel for channel in ch.CHANNELS.values() if channel.struct):
        schema = msgspec.json.decode(channel.json_schema)
        assert schema["type"] == "object" and schema["properties"]
        for inner in schema["properties"].values():
            plain(inner)


def test_a_file_that_is_cut_anywhere_gives_what_is_before(whole, tmp_path):
    entries, size = list(read(whole)), whole.stat().st_size
    dice = random.Random(5)
    for length in [9, 30, size - 1, *(dice.randrange(8, size) for _ in range(80))]:
        health = Health()
        found = list(read(cut(whole, tmp_path / "cut.mcap", length), health))
        assert health.text and not health.complete
        assert found == entries[: len(found)]


def test_what_is_no_recording_is_refused_with_a_sentence(tmp_path):
    for content in (b"", b"hello", b"\x89MCAP"):
        (tmp_path / "x.mcap").write_bytes(content)
        with pytest.raises(SessionError, match="is no recording"):
            info(tmp_path / "x.mcap")
    with pytest.raises(SessionError, match="no such file"):
        info(tmp_path / "none.mcap")


def test_a_cut_file_is_recovered_and_the_proof_is_read(whole, tmp_path):
    path = cut(whole, tmp_path / "cut.mcap", whole.stat().st_size * 2 // 3)
    before, found = len(list(read(path))), recover(path)
    assert found.file == str(tmp_path / "cut.recovered.mcap")
    assert (found.messages, found.was_complete, found.broken_chunks) == (before, False, 0)
    again = info(found.file)
    assert again.complete and sum(channel.messages for channel in again.channels) == before
    recording = load_recording(found.file)
    assert rerun_run(recording, recording.runs[0]).ok
    with pytest.raises(SessionError, match="exists already"):
        recover(path)
    assert recover(whole, tmp_path / "same.mcap").was_complete


def test_of_a_file_that_is_damaged_in_its_middle_is_said_what_is_true(whole, tmp_path, capsys):
    path = damaged(whole, tmp_path / "damaged.mcap")
    last = load_recording(whole).runs[-1].indices[-1]
    assert rerun_file(str(path), report=str(tmp_path / "report.json")) == 0
    report = json.loads((tmp_path / "report.json").read_text())
    assert report["runs"][-1]["periods"] == last + 1, "what comes after was not compared"
    said = capsys.readouterr().out
    assert "is broken" in said and "only what is whole in it could be compared" in said
    found = recover(path)
    assert (found.lost_bytes, found.broken_chunks, found.was_complete) == (0, 1, False)
    assert recover_command(str(path), str(tmp_path / "again.mcap")) == 0
    assert capsys.readouterr().out.endswith("verified; left out: 1 broken chunk\n")


def test_when_the_work_was_done_is_of_the_server_and_no_part_of_the_run():
    tick = FakeTwin(fake_scene()).advance()
    payload = msgspec.json.encode(tick_message(tick, 1, 0.0, ended=0.05))
    assert _differing(payload, tick, of_truth=True) == []
    moved = msgspec.structs.replace(tick, why=Reason(kind=Kind.NO_TARGET))
    assert _differing(payload, moved, of_truth=True) != []


LAYOUT = json.loads((Path(__file__).parents[2] / "docs" / "foxglove_layout.json").read_text())
PANELS = LAYOUT["configById"]


def leaves(node):
    return [node] if isinstance(node, str) else [*leaves(node["first"]), *leaves(node["second"])]


def test_every_panel_is_placed_and_every_placed_panel_is_there():
    placed = leaves(LAYOUT["layout"])
    tabs = [leaf for tab in PANELS["Tab!right"]["tabs"] for leaf in leaves(tab["layout"])]
    assert sorted([*placed, *tabs]) == sorted(PANELS)


def test_the_scene_shows_every_drawn_topic_and_no_other():
    shown = set(PANELS["3D!motm"]["topics"])
    drawn = {topic for topic, channel in ch.CHANNELS.items() if channel.schema}
    assert shown == drawn - {ch.DRAWN_FRAMES.topic, ch.DRAWN_LOG.topic}
    assert PANELS["RosOut!log"]["topicToRender"] == ch.DRAWN_LOG.topic
    assert PANELS["RawMessages!tick"]["topicPath"] == ch.TICK.topic


def test_no_frame_is_drawn_over_the_robot():
    """Foxglove draws axes at every frame that is not hidden, and a line from it to its parent."""
    hidden = {name for name, frame in PANELS["3D!motm"]["transforms"].items() if not frame["visible"]}
    robot = RobotEncoder(RobotProfile()).state(Twin(load_scene("exp1", "trial1", 0)).advance().observation, 1, 0.0)
    assert hidden == {f"frame:{name}" for name in (WORLD, *robot.frames)}


def test_every_curve_is_a_field_of_the_plots():
    fields = {field.name for field in msgspec.structs.fields(ch.PlotsMessage)}
    paths = [path["value"] for name, panel in PANELS.items() if name.startswith("Plot!") for path in panel["paths"]]
    assert paths and set(paths) <= {f"{ch.PLOTS.topic}.{name}" for name in fields}
