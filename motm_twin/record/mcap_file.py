"""MCAP files: written in small chunks that survive a crash; read even when truncated or damaged; recovered."""

import os
import struct
import threading
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel as ChannelRecord
from mcap.records import Chunk, Message, Schema
from mcap.writer import CompressionType, Writer

from motm_twin.record.channels import Channel
from motm_twin.sessions.session import SessionError

CHUNK_BYTES = 1024 * 1024
MAGIC = b"\x89MCAP0\r\n"
_END = b"".join(  # end of a file without an index: end of data, footer, magic
    (struct.pack("<BQI", Opcode.DATA_END, 4, 0), struct.pack("<BQQQI", Opcode.FOOTER, 20, 0, 0, 0), MAGIC)
)
PROFILE = "motm"
LIBRARY = "motm-twin"


class RecordingFailed(Exception):
    """The recording cannot go on; the message says why. What was written until then can be read."""


class _Raw:
    """The file below the writer: unbuffered; a write is complete or raises OSError.

    A written chunk survives a crash of this program; a thread forces it to the disk, so that it survives a crash of the
    machine as well. A slow disk then delays nothing.
    """

    def __init__(self, path: Path) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o644)
        self._position = 0
        self._problem: OSError | None = None  # error of the thread
        self._written, self._closing = threading.Event(), False
        self._thread = threading.Thread(target=self._sync, name="disk", daemon=True)
        self._thread.start()

    def write(self, data: bytes) -> int:
        """Write all of the data; returns the number of bytes."""
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
        """Have the thread force the data to the disk soon."""
        self._written.set()

    def cut(self, length: int) -> None:
        """Truncate the file to a length [bytes] and continue there."""
        os.ftruncate(self._descriptor, length)
        os.lseek(self._descriptor, length, os.SEEK_SET)
        self._position = length

    def close(self) -> None:
        """Close the file once all data is on the disk."""
        self._closing = True
        self._written.set()
        self._thread.join()
        self._force()  # the thread may have started before the last write
        os.close(self._descriptor)
        if self._problem is not None:
            raise self._problem

    def _sync(self) -> None:
        while self._problem is None:
            self._written.wait()
            self._written.clear()
            if self._closing:
                return
            self._force()

    def _force(self) -> None:
        try:
            os.fdatasync(self._descriptor)
        except OSError as error:
            self._problem = self._problem or error


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
        number = self._sequences[channel.topic] = self._sequences.get(channel.topic, -1) + 1
        logged = max(0, round(log_time * 1e9))
        published = logged if publish_time is None else max(0, round(publish_time * 1e9))
        self._do(lambda: self._writer.add_message(self._channel(channel), logged, data, published, number))

    def save(self) -> None:
        """Close the chunk and hand it to the operating system: from now on it survives any end of this program."""
        self._do(self._writer.flush)
        self.size = self._raw.tell()

    def close(self) -> None:
        """Write the index and close the file; after a failure whole chunks are kept, a file without any is deleted."""
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
            name = channel.schema_name
            if name not in self._schemas:
                self._schemas[name] = self._writer.register_schema(name, "jsonschema", channel.json_schema)
            self._channels[channel.topic] = self._writer.register_channel(channel.topic, "json", self._schemas[name])
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
        """Drop a half-written chunk, which also frees space on a full disk, and end the file with a few bytes."""
        with suppress(OSError):
            self._raw.cut(self.size)
            if not self.size:
                return
            try:
                self._raw.write(_END)
                self.size += len(_END)
            except OSError:
                self._raw.cut(self.size)


MAX_RECORD = 64 * 1024 * 1024  # bytes; a larger length is corrupt
MAX_CHUNK = 64 * 1024 * 1024  # bytes, decompressed
# Limits on the content of a file, by its size: a small file that unpacks to a lot was made to fill memory or to take
# hours. A recording has 16 bytes of index for each message, and unpacks to ten or twenty times its size.
FREE_MESSAGES, BYTES_PER_MESSAGE = 10_000, 16
FREE_BYTES, MOST_UNPACKED = 64 * 1024 * 1024, 40
MAX_NAMES = 1000  # schemas and channels
MAX_DESCRIBED = 16 * 1024 * 1024  # bytes in all schemas and channels
_HEAD = struct.Struct("<BQ")


@dataclass(frozen=True)
class Entry:
    """One message."""

    topic: str
    schema: str
    log_time: int  # [ns]
    publish_time: int  # [ns]
    sequence: int
    data: bytes


@dataclass
class Health:
    """Findings of a reader about its file; final only when it was read to its end."""

    complete: bool = False  # the file ends properly
    chunks: int = 0
    broken_chunks: int = 0
    whole: int = 0  # bytes up to the end of the last whole record
    size: int = 0
    text: str = ""  # why it is not complete
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, ChannelRecord] = field(default_factory=dict)
    messages: int = 0
    unpacked: int = 0  # bytes
    described: int = 0  # bytes of schemas and channels

    def count(self, messages: int, unpacked: int) -> None:
        """Add to the counts. Raises Overfull when the file holds more than a file of its size can."""
        self.messages, self.unpacked = self.messages + messages, self.unpacked + unpacked
        if self.messages > FREE_MESSAGES + self.size // BYTES_PER_MESSAGE:
            raise Overfull(f"holds more than {self.messages - 1:,} messages in {_megabytes(self.size)}")
        if self.unpacked > FREE_BYTES + MOST_UNPACKED * self.size:
            raise Overfull(f"unpacks to more than {_megabytes(self.unpacked)} from {_megabytes(self.size)}")

    def describe(self, size: int) -> None:
        """Count a schema or channel of ``size`` bytes. Raises Overfull."""
        self.described += size
        if len(self.schemas) + len(self.channels) >= MAX_NAMES or self.described > MAX_DESCRIBED:
            raise Overfull(f"describes more than {MAX_NAMES} topics, or with more than {_megabytes(MAX_DESCRIBED)}")


class Overfull(SessionError):
    """A file that was made to fill memory."""

    def __init__(self, problem: str) -> None:
        super().__init__(f"{problem}: it is no recording of a twin")


def _megabytes(size: int) -> str:
    return f"{size / 1e6:.3g} MB"


def read(path: str | Path, health: Health | None = None) -> Iterator[Entry]:
    """Every message in the order of the file. Raises SessionError for a file that is not MCAP or cannot be opened."""
    path, health = Path(path), health if health is not None else Health()
    try:
        with path.open("rb") as file:
            health.size = path.stat().st_size
            if file.read(len(MAGIC)) != MAGIC:
                raise SessionError("is no recording: it does not begin as an MCAP file does", file=str(path))
            health.whole = len(MAGIC)
            yield from _records(file, health)
    except Overfull as error:
        raise SessionError(error.problem, file=str(path)) from error
    except FileNotFoundError as error:
        raise SessionError("there is no such file", file=str(path)) from error
    except OSError as error:
        raise SessionError(f"cannot be read: {error.strerror or error}", file=str(path)) from error


def _records(file: BinaryIO, health: Health) -> Iterator[Entry]:
    while True:
        head = file.read(_HEAD.size)
        if len(head) < _HEAD.size:
            health.text = "its end is missing"
            return
        opcode, length = _HEAD.unpack(head)
        if length > MAX_RECORD or health.whole + _HEAD.size + length > health.size:
            health.text = "its end is missing" if length <= MAX_RECORD else f"it is broken at byte {health.whole}"
            return
        body = file.read(length)
        if opcode == Opcode.CHUNK:
            yield from _chunk(body, health)
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):  # outside of chunks: from other programs
            yield from _loose(_HEAD.pack(opcode, length) + body, health)
        health.whole += _HEAD.size + length
        if opcode == Opcode.FOOTER:
            ended = file.read(len(MAGIC)) == MAGIC
            health.whole += len(MAGIC) if ended else 0
            health.complete = ended and not health.text
            health.text = health.text or ("" if ended else "its end is missing")
            return


def _loose(record: bytes, health: Health) -> Iterator[Entry]:
    try:
        entries = list(_inside(record, health))
        health.count(len(entries), len(record))
    except Overfull:
        raise
    except Exception as error:  # as in `_chunk`
        health.text = f"the record at byte {health.whole} is broken: {error}"
        return
    yield from entries


def _chunk(body: bytes, health: Health) -> Iterator[Entry]:
    """The messages of a chunk in order; none of a broken chunk, as nothing in it can be trusted."""
    try:
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        if chunk.uncompressed_size > MAX_CHUNK:
            raise ValueError("too large")
        if chunk.compression == "zstd":
            if zstandard.frame_content_size(chunk.data) > MAX_CHUNK:
                raise ValueError("too large")
            data = zstandard.ZstdDecompressor().decompress(chunk.data, max_output_size=chunk.uncompressed_size)
        elif chunk.compression == "":
            data = chunk.data
        else:
            raise ValueError(f"compressed with {chunk.compression!r}")
        if chunk.uncompressed_crc and zlib.crc32(data) != chunk.uncompressed_crc:
            raise ValueError("the checksum differs")
        if len(data) > MAX_CHUNK:
            raise ValueError("too large")
        health.count(0, len(data))
        for _ in _inside(data, health):  # the whole chunk is checked before its first message is yielded
            health.count(1, 0)
    except Overfull:
        raise
    except Exception as error:  # random bytes can make the libraries raise anything
        health.broken_chunks += 1
        health.text = f"the chunk at byte {health.whole} is broken: {error}"
        return
    health.chunks += 1
    yield from _inside(data, health)


def _inside(data: bytes, health: Health) -> Iterator[Entry]:
    """Messages in intact bytes; schemas and channels are stored. Raises Overfull for too many of these."""
    at = 0
    while at < len(data):
        opcode, length = _HEAD.unpack_from(data, at)
        at += _HEAD.size
        stream = ReadDataStream(BytesIO(data[at : at + length]))
        at += length
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(stream)
            health.describe(length if health.schemas.get(schema.id) != schema else 0)
            health.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = ChannelRecord.read(stream)
            health.describe(length if health.channels.get(channel.id) != channel else 0)
            health.channels[channel.id] = channel
        elif opcode == Opcode.MESSAGE:
            message = Message.read(stream, length)
            channel = health.channels.get(message.channel_id)
            if channel is None:
                raise ValueError(f"channel {message.channel_id} is unknown")
            schema = health.schemas.get(channel.schema_id)
            name = "" if schema is None else schema.name
            yield Entry(channel.topic, name, message.log_time, message.publish_time, message.sequence, message.data)


@dataclass(frozen=True)
class Recovered:
    """The result of a recovery."""

    file: str
    messages: int
    seconds: float
    lost_bytes: int  # after the last whole record
    broken_chunks: int
    was_complete: bool


def recover(path: str | Path, out: str | Path | None = None) -> Recovered:
    """Write an intact copy beside a broken file. Raises SessionError, also when the copy cannot be read."""
    path = Path(path)
    target = Path(out) if out is not None else path.with_name(f"{path.stem}.recovered.mcap")
    health = Health()
    try:
        file = target.open("xb")
    except FileExistsError as error:
        raise SessionError("exists already: choose another name with --out", file=str(target)) from error
    except OSError as error:
        raise SessionError(f"cannot be written: {error.strerror or error}", file=str(target)) from error
    try:
        with file:
            messages, first, last = _copy(path, file, health)
        _verify(target, messages)
    except BaseException as error:
        target.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise SessionError(f"cannot be written: {error.strerror or error}", file=str(target)) from error
        raise
    lost = 0 if health.complete else health.size - health.whole
    return Recovered(str(target), messages, (last - first) / 1e9, lost, health.broken_chunks, health.complete)


def _copy(path: Path, file: BinaryIO, health: Health) -> tuple[int, int, int]:
    writer = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(PROFILE, LIBRARY)
    schemas: dict[str, int] = {"": 0}
    channels: dict[str, int] = {}
    messages, first, last = 0, 0, 0
    for entry in read(path, health):
        if entry.topic not in channels:
            found = next(channel for channel in health.channels.values() if channel.topic == entry.topic)
            # A file may name a schema that it does not hold, and one topic may have several channels.
            schema = next((schema for schema in health.schemas.values() if schema.name == entry.schema), None)
            if schema is not None and entry.schema not in schemas:
                schemas[entry.schema] = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[entry.topic] = writer.register_channel(
                entry.topic, found.message_encoding, schemas.get(entry.schema, 0), found.metadata
            )
        writer.add_message(
            channels[entry.topic], entry.log_time, entry.data, entry.publish_time, sequence=entry.sequence
        )
        first, last = entry.log_time if messages == 0 else min(first, entry.log_time), max(last, entry.log_time)
        messages += 1
    writer.finish()
    return messages, first, last


def _verify(path: Path, messages: int) -> None:
    """Check a file with our reader and with that of the mcap package, which uses the index."""
    health = Health()
    ours = sum(1 for _ in read(path, health))
    try:
        with path.open("rb") as file:
            theirs = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    except Exception as error:  # any exception of the package means a bad file
        raise SessionError(f"was written, but cannot be read again: {error}", file=str(path)) from error
    if not health.complete or not ours == theirs == messages:
        raise SessionError(
            f"was written, but of {messages} messages only {min(ours, theirs)} can be read", file=str(path)
        )
