"""`motm-twin send`: a command from words."""

import sys
from typing import Any, get_type_hints

import msgspec

from motm_twin.bus import commands
from motm_twin.client.discover import OPTIONS, NoTwin, find
from motm_twin.client.twin import Twin
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.model.names import hint
from motm_twin.program import BAD_INPUT, FAILED, OK

_ALL = (*commands.SERVER_COMMANDS, *commands.EDITS)
KINDS: dict[str, type[Any]] = dict(zip(commands.COMMAND_NAMES, _ALL, strict=True))


def send(
    command: str, fields: list[str], *, json: str | None, timeout: float, endpoint: str | None, twin: str | None
) -> int:
    """Send it and print the answer; the exit code."""
    try:
        wanted = parse(command, fields, json)
    except ValueError as error:
        print(f"motm-twin send: {error}", file=sys.stderr)
        return BAD_INPUT
    try:
        with Twin(*find(endpoint, twin, how=OPTIONS), name="motm-twin send") as handle:
            return _sent(handle, wanted, timeout)
    except (NoTwin, TimeoutError) as error:
        print(f"motm-twin send: {error}", file=sys.stderr)
        return FAILED


def parse(command: str, fields: list[str], json: str | None = None) -> commands.Command:
    """The command of this name with fields "name=value", or as JSON. Raises ValueError with what is allowed.

    A load that names no method means the default one, as with `serve` and in Python, and says so in the message.
    """
    kind = KINDS.get(command)
    if kind is None:
        raise ValueError(f"there is no command {command!r}; {hint(command, KINDS)}")
    types = get_type_hints(kind)
    try:
        values = {} if json is None else msgspec.json.decode(json, type=dict[str, Any])
    except (msgspec.DecodeError, UnicodeError) as error:
        raise ValueError(f"--json: give an object of fields: {error}") from error
    for word in fields:
        name, equals, text = word.partition("=")
        if not equals:
            raise ValueError(f"{word!r}: write the fields of {command!r} as name=value")
        if name not in types:
            raise ValueError(f"{command!r} has no field {name!r}; it has: {', '.join(types) or 'none'}")
        values[name] = _value(name, text, types[name])
    if kind is commands.Load:
        values.setdefault("method", DEFAULT_METHOD)
    try:
        return msgspec.convert({**values, "type": command}, type=kind)
    except msgspec.ValidationError as error:
        raise ValueError(f"{command!r}: {error}") from error


def _value(name: str, text: str, kind: Any) -> Any:
    """A word as the type of its field: as JSON where that fits, a list without its brackets, or as it stands."""
    for candidate in (text, f"[{text}]"):
        try:
            return msgspec.to_builtins(msgspec.json.decode(candidate, type=kind))
        except (msgspec.DecodeError, UnicodeError):
            continue
    try:
        return msgspec.to_builtins(msgspec.convert(text, type=kind, strict=False))
    except msgspec.ValidationError as error:
        raise ValueError(f"{name}={text}: {error}") from error


def _sent(handle: Twin, command: commands.Command, timeout: float) -> int:
    try:
        answer = handle.send(command, timeout)
    except commands.Refused as refusal:
        print(msgspec.json.encode({"ok": False, "reason": str(refusal)}).decode())
        return FAILED
    print(msgspec.json.encode(answer).decode())
    if not isinstance(command, commands.TakeWheel | commands.HandOver | commands.Inspect | commands.Audience):
        handle.client.command(commands.HandOver())  # this program ends now: others need not wait for its silence
    return OK
