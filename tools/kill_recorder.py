"""Kills a recorder at random moments, many times, and looks at what is left of each file.

``python tools/kill_recorder.py --times 100`` serves exp2 (or what ``--endpoint`` names), and for each kill reports the
newest period that was sent before it and the newest one that can be read. Exit code 0: every file can be read, no more
than a second is lost of any, and every one is recovered to a whole file.
"""

import argparse
import random
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Play
from motm_twin.bus.connection import free_port
from motm_twin.record.channels import TICK
from motm_twin.record.mcap_file import Health, read, recover

MOST_LOST = 1.0  # [s]
READY = 240.0  # [s] for the twin and its first compilation


class _Stamp(msgspec.Struct):
    server_time: float


def main() -> int:
    """Serve, kill, look."""
    options = _options()
    server = None
    endpoint = options.endpoint
    if endpoint is None:
        port = free_port()
        endpoint = f"tcp/127.0.0.1:{port}"
        command = ["-m", "motm_twin.server_process", "exp2", "--port", str(port), "--twin", options.twin]
        server = subprocess.Popen([sys.executable, *command], stdout=subprocess.DEVNULL)
    try:
        with TwinClient(endpoint, options.twin) as client, tempfile.TemporaryDirectory() as folder:
            _until(lambda: client.tick() is not None)
            lost = [_kill(client, options.twin, Path(folder) / f"{n}.mcap") for n in range(options.times)]
    finally:
        if server is not None:
            server.terminate()
            server.wait()
    lost.sort()
    print(
        f"{len(lost)} kills, all files read and recovered: lost median {statistics.median(lost):.3f} s, "
        f"p90 {lost[int(0.9 * (len(lost) - 1))]:.3f} s, most {lost[-1]:.3f} s"
    )
    return 0 if lost[-1] <= MOST_LOST else 1


def _kill(client: TwinClient, twin: str, path: Path) -> float:
    """Seconds between the newest period at the kill and the newest that can be read."""
    arguments = ["--endpoint", client.endpoint, "--twin", twin, "--out", str(path)]
    command = [sys.executable, "-m", "motm_twin.record.recorder", *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as recorder:
        assert recorder.stdout is not None
        recorder.stdout.readline()
        status = client.status()
        if status is not None and status.state == "done":  # begin again: where nothing happens nothing is lost
            client.command(Play())
            _until(lambda: (status := client.status()) is not None and status.state == "playing")
        began = client.tick()
        time.sleep(random.uniform(1.0, 3.0))
        newest = client.tick()
        recorder.kill()
    assert began is not None
    assert newest is not None
    health = Health()
    times = [
        msgspec.json.decode(entry.data, type=_Stamp).server_time
        for entry in read(path, health)
        if entry.topic == TICK.topic
    ]
    if health.broken_chunks:
        raise SystemExit(f"{path.name} of {health.size} bytes: {health.text}")
    whole = recover(path)
    Path(whole.file).unlink()
    path.unlink()
    lost = max(0.0, newest.server_time - (times[-1] if times else began.server_time))
    if lost > MOST_LOST:
        print(f"{path.name}: {len(times)} periods, {health.size} bytes, {lost:.2f} s lost")
    return lost


def _until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + READY
    while not condition():
        if time.monotonic() > deadline:
            raise SystemExit("the twin never started")
        time.sleep(0.1)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python tools/kill_recorder.py", description=__doc__)
    parser.add_argument("--times", type=int, default=100)
    parser.add_argument("--endpoint", help="a server that runs already; without it exp2 is served")
    parser.add_argument("--twin", default="killed", help="name in the keys")
    return parser.parse_args()


if __name__ == "__main__":
    sys.exit(main())
