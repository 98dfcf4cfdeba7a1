"""The gate for every command: size, form, ranges, freshness and order are checked before it has an effect."""

from collections.abc import Callable

import msgspec

from motm_twin.bus.commands import (
    COMMAND_NAMES,
    MAX_COMMAND_BYTES,
    MAX_NAME,
    NAME_MAX,
    Envelope,
    Refused,
    check_command,
    command_name,
)
from motm_twin.model.names import hint

MAX_SENDERS = 1000
MAX_LIFETIME = 60.0  # [s] a later expiry would not bound replay attacks
ORDER = 16  # a number this far below a sender's last one is refused, seen or not
MAX_SEEN = 4096  # numbers of one sender that have not expired


class _Sender:
    """Sequence numbers admitted from one sender. An outlier, perhaps forged, blocks no others."""

    def __init__(self) -> None:
        self.last, self._seen = -1, dict[int, float]()  # expiry [s] of each number
        self.forget_at = 0.0  # [s]

    def check(self, seq: int, name: str, now: float) -> None:
        """Raise Refused for a number that was seen, or overtaken."""
        if seq in self._seen or self.last - ORDER < seq <= self.last:
            raise Refused(f"replayed: seq {seq} of {name!r}, {self.last} was seen already")
        if len(self._seen) >= MAX_SEEN:
            self._seen = {number: until for number, until in self._seen.items() if until > now}
            if len(self._seen) >= MAX_SEEN:
                raise Refused(f"more than {MAX_SEEN} commands of {name!r} within {MAX_LIFETIME:.0f} s")

    def admit(self, seq: int, expires: float, forget_at: float) -> None:
        """Remember it."""
        self.last, self._seen[seq], self.forget_at = seq, expires, forget_at


class CommandGate:
    """Checks envelopes; remembers the sequence numbers of each sender. ``now`` is the server's clock [s]."""

    def __init__(self, now: Callable[[], float]) -> None:
        self._now = now
        self._decoder = msgspec.json.Decoder(Envelope, strict=True)
        self._senders: dict[str, _Sender] = {}

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
        sender = self._senders.get(envelope.sender)
        if sender is None:
            if len(self._senders) >= MAX_SENDERS:
                self._senders = {name: known for name, known in self._senders.items() if known.forget_at > now}
                if len(self._senders) >= MAX_SENDERS:
                    raise Refused(f"more than {MAX_SENDERS} senders within {MAX_LIFETIME:.0f} s")
            sender = self._senders[envelope.sender] = _Sender()
        sender.check(envelope.seq, envelope.sender, now)
        sender.admit(envelope.seq, envelope.expires, now + MAX_LIFETIME)
