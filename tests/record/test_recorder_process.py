"""The recorder as a process: whatever ends it, what it wrote can be read, and the twin does not notice."""

import json
import random
import resource
import signal
import time

import pytest
from fake_twin import fake_server
from recordings import Recording, unprivileged
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Speed, Step
from motm_twin.bus.connection import free_port
from motm_twin.bus.queries import LatestValues
from motm_twin.record.channels import STATUS
from motm_twin.record.mcap_file import Health, McapFile, RecordingFailed, read
from motm_twin.record.recording import info

MOST_LOST = 1.0  # [s]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with fake_server(data=data) as running:
        until(lambda: running.loop.status().state == "playing", "the twin never started")
        yield running


@pytest.fixture
def client(server):
    with TwinClient(server.endpoint) as connected:
        until(connected.tick, "no tick")
        yield connected


def started(server, path, **options):
    recorder = Recording(server.endpoint, path, **options)
    assert recorder.event()["event"] == "recording"
    return recorder


def test_killed_at_any_moment_it_loses_less_than_a_second(server, client, tmp_path):
    dice, newest = random.Random(7), {}
    recorders = {tmp_path / f"{number}.mcap": started(server, tmp_path / f"{number}.mcap") for number in range(2)}
    time.sleep(1.0)
    for path, recorder in recorders.items():
        time.sleep(0.2 + 0.3 * dice.random())  # the moment is what is tested
        newest[path] = client.tick().server_time
        recorder.kill()
    for path in recorders:
        health = Health()
        times = [json.loads(entry.data)["server_time"] for entry in read(path, health) if entry.topic == "/motm/tick"]
        assert not health.complete
        assert newest[path] - times[-1] <= MOST_LOST


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_well(server, client, tmp_path, number):
    recorder = started(server, tmp_path / "x.mcap")
    index = client.tick().index
    until(lambda: client.tick().index > index + 20, "no ticks")
    recorder.process.send_signal(number)
    code, last = recorder.wait()
    assert (code, last["event"]) == (0, "recorded")
    found = info(tmp_path / "x.mcap")
    assert found.complete
    assert found.runs[0].missing == 0


def test_a_full_disk_ends_the_recording_and_nothing_else(server, client, tmp_path):
    limit = 400_000

    def no_more():
        resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))

    recorder = started(server, tmp_path / "x.mcap", preexec_fn=no_more)
    assert client.command(Speed(factor=8.0)).ok
    code, last = recorder.wait()
    assert client.command(Speed(factor=1.0)).ok
    assert (code, last["event"]) == (1, "failed")
    assert "File too large" in last["text"]
    index = client.tick().index
    until(lambda: client.tick().index > index + 5, "the robot stands")
    health = Health()
    assert list(read(tmp_path / "x.mcap", health))
    assert health.whole == health.size  # nothing half is left
    assert health.complete
    assert last["bytes"] == health.size <= limit


def test_a_disk_that_is_full_from_the_start_is_said_and_nothing_is_left(server, tmp_path):
    def nothing():
        resource.setrlimit(resource.RLIMIT_FSIZE, (4, 4))

    code, last = Recording(server.endpoint, tmp_path / "x.mcap", preexec_fn=nothing).wait()
    assert (code, last["event"]) == (2, "refused")
    assert last["text"].endswith("x.mcap: cannot be written: File too large")
    assert list(tmp_path.iterdir()) == []


def test_a_disk_that_is_full_before_anything_is_whole_leaves_nothing(tmp_path):
    def full(_):
        raise OSError(28, "No space left on device")

    file = McapFile(tmp_path / "x.mcap")
    file.add(STATUS, 1.0, b"{}")
    file._raw.write = full
    with pytest.raises(RecordingFailed, match="No space left on device"):
        file.save()
    file.close()
    assert list(tmp_path.iterdir()) == []


def test_what_cannot_be_written_is_refused_before_it_begins(server, tmp_path):
    (tmp_path / "there.mcap").write_bytes(b"mine")
    (tmp_path / "closed").mkdir(mode=0o500)
    places = {"there.mcap": "exists already", "none/x.mcap": "No such file", "there.mcap/x.mcap": "Not a directory"}
    if unprivileged():
        places["closed/x.mcap"] = "Permission denied"
    for place, words in places.items():
        code, last = Recording(server.endpoint, tmp_path / place).wait()
        assert (code, last["event"]) == (2, "refused")
        assert words in last["text"]
    assert (tmp_path / "there.mcap").read_bytes() == b"mine"


def test_nobody_to_record_is_bad_input(tmp_path):
    nobody = Recording(f"tcp/127.0.0.1:{free_port()}", tmp_path / "x.mcap", "--wait", "0.2")
    code, last = nobody.wait()
    assert (code, last["event"]) == (2, "refused")
    assert not (tmp_path / "x.mcap").exists()


def test_a_server_that_answers_slowly_is_recorded_from_the_start(tmp_path, monkeypatch):
    """On a busy machine what is asked at first is answered after the run has begun, or ended."""
    answer = LatestValues._answer

    def slowly(*arguments):
        time.sleep(0.1)
        answer(*arguments)

    monkeypatch.setattr(LatestValues, "_answer", slowly)
    with fake_server(playing=False, data=tmp_path) as server, TwinClient(server.endpoint) as client:
        until(lambda: client.tick() and client.status(), "no tick")
        recorder = started(server, tmp_path / "slow.mcap")
        assert client.command(Step(count=20)).ok
        until(lambda: client.tick().index == 20, "the steps were not made")
        recorder.end()
    entries = list(read(tmp_path / "slow.mcap"))
    assert [json.loads(entry.data)["index"] for entry in entries if entry.topic == "/motm/tick"] == list(range(21))
    assert {"/motm/scene", "/motm/grid"} <= {entry.topic for entry in entries}
