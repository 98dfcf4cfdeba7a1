"""A whole file, with its index, from a recording that was cut off or broken; and the proof that it can be read."""

from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from motm_twin.record.mcap_file import LIBRARY, PROFILE
from motm_twin.record.reader import Health, read
from motm_twin.sessions.session import SessionError


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
    """Write the whole file beside the broken one. Raises SessionError, also when what was written cannot be read."""
    path = Path(path)
    target = Path(out) if out is not None else path.with_name(f"{path.stem}.recovered.mcap")
    health = Health()
    try:
        with target.open("xb") as file:
            messages, first, last = _copy(path, file, health)
    except FileExistsError as error:
        raise SessionError("exists already: choose another name with --out", file=str(target)) from error
    except OSError as error:
        target.unlink(missing_ok=True)
        raise SessionError(f"cannot be written: {error.strerror or error}", file=str(target)) from error
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    try:
        _verify(target, messages)
    except BaseException:
        target.unlink(missing_ok=True)
        raise
    return Recovered(
        file=str(target),
        messages=messages,
        seconds=(last - first) / 1e9,
        lost_bytes=0 if health.complete else health.size - health.whole,
        broken_chunks=health.broken_chunks,
        was_complete=health.complete,
    )


def _copy(path: Path, file: BinaryIO, health: Health) -> tuple[int, int, int]:
    writer = Writer(file, compression=CompressionType.ZSTD, enable_data_crcs=True)
    writer.start(PROFILE, LIBRARY)
    schemas: dict[str, int] = {"": 0}
    channels: dict[str, int] = {}
    messages, first, last = 0, 0, 0
    for entry in read(path, health):
        if entry.topic not in channels:
            found = next(channel for channel in health.channels.values() if channel.topic == entry.topic)
            # A file may name one that it does not hold, and one topic may have several channels.
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
    """By our reader and by that of the mcap package, which uses the index."""
    health = Health()
    ours = sum(1 for _ in read(path, health))
    try:
        with path.open("rb") as file:
            theirs = sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    except Exception as error:  # whatever the package raises: the file is not good
        raise SessionError(f"was written, but cannot be read again: {error}", file=str(path)) from error
    if not health.complete or not ours == theirs == messages:
        raise SessionError(
            f"was written, but of {messages} messages only {min(ours, theirs)} can be read", file=str(path)
        )
