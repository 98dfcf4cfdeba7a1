"""Writes MCAP files that survive a crash with little loss: small chunks, each forced to disk."""

import os
import struct
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer

from motm_twin.record.channels import Channel
from motm_twin.sessions.session import SessionError

CHUNK_BYTES = 1024 * 1024
_END = b"".join(  # of a file without an index: end of data, footer, and the magic
    (struct.pack("<BQI", Opcode.DATA_END, 4, 0), struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0), b"\x89MCAP0\r\n")
)
PROFILE = "motm"
LIBRARY = "motm-twin"


class RecordingFailed(Exception):
    """The recording cannot go on; the message says why. What was written until then can be read."""


class _Raw:
    """The file below the writer: unbuffered; a write is complete or raises OSError.

    A written chunk survives the end of this program; a thread forces it to the disk, so that it survives the end of the
    machine as well. A slow disk then delays nothing.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._position = 0
        self._problem: OSError | None = None  # of the thread
        self._written, self._closing = threading.Event(), False
        self._thread = threading.Thread(target=self._sync, name="disk", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> int:
        """Write all of it."""
        if self._problem is not None:
            raise self._problem
        rest = memoryview(data)
        while rest:
            written = os.write(self._descriptor, rest)
            rest = rest[written:]
            self._position += written
        return len(data)

    def tell(self) -> int:
        """Bytes written."""
        return self._position

    def flush(self) -> None:
        """Onto the disk, soon."""
        self._written.set()

    def cut(self, length: int) -> None:
        """Forget what comes after, and go on there."""
        os.ftruncate(self._descriptor, length)
        os.lseek(self._descriptor, length, os.SEEK_SET)
        self._position = length

    def close(self) -> None:
        """Close it, with all of it on the disk."""
        self._closing = True
        self._written.set()
        self._thread.join()
        os.close(self._descriptor)
        if self._problem is not None:
            raise self._problem

    def _sync(self) -> None:
        while not self._closing and self._problem is None:
            self._written.wait()
            self._written.clear()
            try:
                os.fdatasync(self._descriptor)
            except OSError as error:
                self._problem = error


class McapFile:
    """A recording that is being written. Every method raises RecordingFailed when the disk refuses."""

    def __init__(self, path: str | Path) -> None:
        """Raises SessionError when the file exists already or can not be made."""
        self.path = Path(path)
        try:
            self._raw = _Raw(self.path)
        except FileExistsError as error:
            raise SessionError("exists already: choose another name", file=str(path)) from error
        except OSError as error:
            raise SessionError(f"cannot be written: {error.strerror or error}", file=str(path)) from error
        self._writer = Writer(
            self._raw,  # type: ignore[arg-type] - it needs write, tell and flush only
            chunk_size=CHUNK_BYTES,
            compression=CompressionType.ZSTD,
            enable_crcs=True,
            enable_data_crcs=True,
        )
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._sequences: dict[str, int] = {}
        self.size = 0  # bytes up to the end of the last chunk on the disk
        self._failed = False
        try:
            self._do(lambda: self._writer.start(PROFILE, LIBRARY))
        except RecordingFailed as error:
            with suppress(RecordingFailed):
                self._close_raw()
            self.path.unlink(missing_ok=True)
            why = getattr(error.__cause__, "strerror", None) or error.__cause__
            raise SessionError(f"cannot be written: {why}", file=str(path)) from error

    def add(self, channel: Channel, log_time: float, data: bytes, publish_time: float | None = None) -> None:
        """Take a message; times [s] on the server's clock."""
        topic = channel.topic
        number = self._sequences[topic] = self._sequences.get(topic, -1) + 1
        logged = max(0, round(log_time * 1e9))
        published = logged if publish_time is None else max(0, round(publish_time * 1e9))
        self._do(
            lambda: self._writer.add_message(
                channel_id=self._channel(channel), log_time=logged, data=data, publish_time=published, sequence=number
            )
        )

    def save(self) -> None:
        """Close the chunk and hand it to the system: from now on no end of this program loses it."""
        self._do(self._writer.flush)
        self.size = self._raw.tell()

    def close(self) -> None:
        """Write the index and close the file; after a failure only what is whole stays, if anything is."""
        try:
            if not self._failed:
                self._do(self._writer.finish)
                self.size = self._raw.tell()
        finally:
            self._close_raw()
            if self._failed and not self.size:
                self.path.unlink(missing_ok=True)

    def _close_raw(self) -> None:
        try:
            self._raw.close()
        except OSError as error:
            if not self._failed:
                self._failed = True
                raise RecordingFailed(f"{self.path}: {error.strerror or error}") from error

    def _channel(self, channel: Channel) -> int:
        if channel.topic not in self._channels:
            if channel.schema_name not in self._schemas:
                schema = self._writer.register_schema(channel.schema_name, "jsonschema", channel.json_schema())
                self._schemas[channel.schema_name] = schema
            schema = self._schemas[channel.schema_name]
            self._channels[channel.topic] = self._writer.register_channel(channel.topic, "json", schema)
        return self._channels[channel.topic]

    def _do(self, work: Callable[[], object]) -> None:
        if self._failed:
            raise RecordingFailed(f"{self.path}: the recording has stopped already")
        try:
            work()
        except OSError as error:
            self._failed = True
            self._end_early()
            raise RecordingFailed(f"{self.path}: {error.strerror or error}") from error

    def _end_early(self) -> None:
        """Drop a half-written chunk, which also frees space on a full disk; a few bytes make the rest a whole file."""
        with suppress(OSError):
            self._raw.cut(self.size)
            if not self.size:
                return
            try:
                self._raw.write(_END)
                self.size += len(_END)
            except OSError:
                self._raw.cut(self.size)
