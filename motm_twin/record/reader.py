"""Reads MCAP files of which the end may be missing or a part be broken: gives what is whole, and says what is not."""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Schema

from motm_twin.sessions.session import SessionError

MAGIC = b"\x89MCAP0\r\n"
MAX_RECORD = 64 * 1024 * 1024  # bytes; a longer one is a broken length
MAX_CHUNK = 64 * 1024 * 1024  # bytes, decompressed
# What a file may hold, by its size: a small one that unpacks to much was made to fill memory, or to take hours. A
# recording has 16 bytes of index for each message, and unpacks to ten or twenty times its size.
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
    """Findings of a reader about its file; complete only when it was read to its end."""

    complete: bool = False  # the file ends as a whole one does
    chunks: int = 0
    broken_chunks: int = 0
    whole: int = 0  # bytes up to the end of the last whole record
    size: int = 0
    text: str = ""  # why it is not complete
    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    messages: int = 0
    unpacked: int = 0  # bytes
    described: int = 0  # bytes of schemas and channels

    def count(self, messages: int, unpacked: int) -> None:
        """Take these into account. Raises Overfull when the file holds more than one of its size can."""
        self.messages, self.unpacked = self.messages + messages, self.unpacked + unpacked
        if self.messages > FREE_MESSAGES + self.size // BYTES_PER_MESSAGE:
            raise Overfull(f"holds more than {self.messages - 1:,} messages in {_megabytes(self.size)}")
        if self.unpacked > FREE_BYTES + MOST_UNPACKED * self.size:
            raise Overfull(f"unpacks to more than {_megabytes(self.unpacked)} from {_megabytes(self.size)}")

    def describe(self, size: int) -> None:
        """Take a schema or channel of so many bytes into account. Raises Overfull."""
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
    """Every message in the order of the file. Raises SessionError for what is no MCAP file or cannot be opened."""
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
        elif opcode in (Opcode.MESSAGE, Opcode.SCHEMA, Opcode.CHANNEL):  # outside of chunks, as others write them
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
    """The messages of a chunk, one after the other; none of one that is broken: none of it can be trusted."""
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
        for _ in _inside(data, health):  # all of it is read before any of it is given
            health.count(1, 0)
    except Overfull:
        raise
    except Exception as error:  # whatever random bytes make the libraries raise
        health.broken_chunks += 1
        health.text = f"the chunk at byte {health.whole} is broken: {error}"
        return
    health.chunks += 1
    yield from _inside(data, health)


def _inside(data: bytes, health: Health) -> Iterator[Entry]:
    """Messages of bytes that are whole; schemas and channels are remembered. Raises Overfull for too many of those."""
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
            channel = Channel.read(stream)
            health.describe(length if health.channels.get(channel.id) != channel else 0)
            health.channels[channel.id] = channel
        elif opcode == Opcode.MESSAGE:
            message = Message.read(stream, length)
            channel = health.channels.get(message.channel_id)
            if channel is None:
                raise ValueError(f"channel {message.channel_id} is unknown")
            schema = health.schemas.get(channel.schema_id)
            yield Entry(
                topic=channel.topic,
                schema="" if schema is None else schema.name,
                log_time=message.log_time,
                publish_time=message.publish_time,
                sequence=message.sequence,
                data=message.data,
            )
