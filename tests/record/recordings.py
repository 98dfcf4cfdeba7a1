"""Recordings for tests: a recorder as a process, and files that were changed."""

import json
import subprocess
import sys

from mcap.reader import make_reader

from motm_twin.record.channels import CHANNELS
from motm_twin.record.mcap_file import McapFile, read


class Recording:
    """A recorder process; its events as they come."""

    def __init__(self, endpoint, path, *options, **popen):
        command = [sys.executable, "-m", "motm_twin.record.recorder", "--endpoint", endpoint, "--out", str(path)]
        self.process = subprocess.Popen([*command, *options], stdout=subprocess.PIPE, text=True, **popen)

    def event(self):
        line = self.process.stdout.readline()
        return json.loads(line) if line else None

    def end(self):
        """Ask it to end; the exit code and the last event."""
        self.process.terminate()
        return self.wait()

    def wait(self):
        last = None
        while (event := self.event()) is not None:
            last = event
        return self.process.wait(60), last

    def kill(self):
        self.process.kill()
        self.process.wait(60)
        self.process.stdout.close()


def changed(path, target, change):
    """A copy with messages as ``change`` (topic, message) gives them; None leaves one out."""
    file = McapFile(target)
    for entry in read(path):
        if (message := change(entry.topic, json.loads(entry.data))) is not None:
            file.add(CHANNELS[entry.topic], entry.log_time / 1e9, json.dumps(message).encode())
    file.close()
    return target


def cut(path, target, length):
    """The first bytes of a file."""
    target.write_bytes(path.read_bytes()[:length])
    return target


def damaged(path, target):
    """A copy with one flipped byte, in the middle chunk."""
    data = bytearray(path.read_bytes())
    with path.open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    chunk = chunks[len(chunks) // 2]
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 0xFF
    target.write_bytes(bytes(data))
    return target
