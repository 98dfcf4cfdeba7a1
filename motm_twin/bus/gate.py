"""The gate that every command passes before it can have an effect: size, form, ranges, freshness, order."""

from collections.abc import Callable

import msgspec

from motm_twin.bus.commands import COMMAND_NAMES, MAX_COMMAND_BYTES, NAME_MAX, Envelope, Refused, command_name
from motm_twin.bus.ranges import MAX_NAME, check_command
from motm_twin.model.names import hint

MAX_SENDERS = 1000
MAX_LIFETIME = 60.0  # [s] an expiry further away does not bound a replay


class CommandGate:
    """Checks envelopes; remembers the last sequence number of each sender. ``now`` is the server's clock [s]."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._decoder = msgspec.json.Decoder(Envelope, strict=True)
        self._last: dict[str, tuple[int, float]] = {}

    def admit(self, name: str, payload: bytes) -> Envelope:
        """The envelope of a command sent to ``cmd/<name>``. Raises Refused."""
        if name not in COMMAND_NAMES:
            raise Refused(f"unknown command {name[:MAX_NAME]!r}; {hint(name, COMMAND_NAMES)}")
        if len(payload) > MAX_COMMAND_BYTES:
            raise Refused(f"oversized: {len(payload)} bytes, at most {MAX_COMMAND_BYTES}")
        try:
            envelope = self._decoder.decode(payload)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise Refused(f"malformed: {error}") from error
        if command_name(envelope.command) != name:
            raise Refused(f"malformed: a {command_name(envelope.command)!r} command was sent to the key of {name!r}")
        check_command(envelope.command)
        self._check_order(envelope)
        return envelope

    def _check_order(self, envelope: Envelope) -> None:
        now = self._now()
        if not 1 <= len(envelope.sender) <= MAX_NAME or not envelope.sender.isprintable():
            raise Refused(f"malformed: the sender needs 1 to {MAX_NAME} printable characters")
        if not 0 <= envelope.seq < 2**63:
            raise Refused("malformed: seq must be 0 to 2^63 - 1")
        if len(envelope.name) > NAME_MAX or not envelope.name.isprintable():
            raise Refused(f"malformed: the name of a person has at most {NAME_MAX} printable characters")
        if envelope.expires <= now:
            raise Refused(f"stale: expired {now - envelope.expires:.3f} s ago")
        if envelope.expires > now + MAX_LIFETIME:
            raise Refused(f"expires in {envelope.expires - now:.0f} s; at most {MAX_LIFETIME:.0f} s ahead is taken")
        last = self._last.get(envelope.sender)
        if last is not None and envelope.seq <= last[0]:
            raise Refused(f"replayed: seq {envelope.seq} of {envelope.sender!r}, {last[0]} was seen already")
        if last is None and len(self._last) >= MAX_SENDERS:
            self._last = {sender: seen for sender, seen in self._last.items() if seen[1] > now}
            if len(self._last) >= MAX_SENDERS:
                raise Refused(f"more than {MAX_SENDERS} senders within {MAX_LIFETIME:.0f} s")
        self._last[envelope.sender] = (envelope.seq, now + MAX_LIFETIME)
