"""What every server answers: commands, once they have passed the gate, and the schemas of all messages."""

import functools
from collections.abc import Callable
from contextlib import suppress

import msgspec
import zenoh

from motm_twin.bus.commands import COMMAND_NAMES, Answer, Envelope, Refused
from motm_twin.bus.gate import CommandGate
from motm_twin.bus.keys import Keys
from motm_twin.bus.ports import Reply
from motm_twin.bus.quiet import Quiet, QuietQueryable
from motm_twin.bus.schemas import names, schema
from motm_twin.external.schemas import KINDS, plant_schema


@functools.cache
def schemas() -> dict[str, bytes]:
    """All schemas as JSON, made once: it takes 0.02 s of the interpreter, 0.3 s for the first time."""
    made = {name: schema(name) for name in names()} | {f"plant/{name}": plant_schema(name) for name in KINDS}
    return {name: msgspec.json.encode(found) for name, found in made.items()}


class Answering:
    """Queryables of one twin, or of a recording that is played as one, until `close`."""

    def __init__(
        self,
        session: zenoh.Session,
        keys: Keys,
        *,
        now: Callable[[], float],
        request: Callable[[Envelope, Reply], None],
        quiet: Quiet,
    ) -> None:
        """``now``: server time [s]; ``request`` takes a checked command, or raises Refused; ``quiet``: when to."""
        self._keys, self._now, self._request = keys, now, request
        self._gate, self._encode = CommandGate(now), msgspec.json.Encoder().encode
        self._commands = [zenoh.KeyExpr(keys.command(name)) for name in COMMAND_NAMES]
        self._schemas = [(zenoh.KeyExpr(keys.schema(name)), text) for name, text in schemas().items()]
        self._queryables = [
            QuietQueryable(session, [keys.commands], self._on_command, quiet),
            QuietQueryable(session, [keys.schemas], self._on_schema, quiet),
        ]

    def close(self) -> None:
        """Answer no more."""
        for queryable in self._queryables:
            queryable.undeclare()

    def _on_command(self, query: zenoh.Query) -> None:
        key = str(query.key_expr)
        if "*" in key:
            self._refuse_unaddressed(query)
            return
        payload = b"" if query.payload is None else query.payload.to_bytes()

        def reply(reason: str, index: int, path: str = "", /) -> None:
            with suppress(zenoh.ZError), query:  # the asker may be gone
                self._reply(query, key, reason, index, path)

        try:
            self._request(self._gate.admit(self._keys.command_in(key), payload), reply)
        except Refused as refusal:
            reply(str(refusal), -1)

    def _refuse_unaddressed(self, query: zenoh.Query) -> None:
        """A command that may reach several twins: it expires on the clock of one, and one answer is that of one."""
        with suppress(zenoh.ZError), query:
            for key in self._commands:
                if query.key_expr.intersects(key):
                    self._reply(query, key, f"a command is for one twin: send it to {key}, without a wildcard", -1)

    def _reply(self, query: zenoh.Query, key: zenoh.KeyExpr | str, reason: str, index: int, path: str = "") -> None:
        """Always on a key of this twin: of two answers on one key, which a wildcard would be, Zenoh drops one."""
        answer = Answer(ok=not reason, reason=reason, server_time=self._now(), index=index, path=path)
        query.reply(key, self._encode(answer), encoding=zenoh.Encoding.APPLICATION_JSON)

    def _on_schema(self, query: zenoh.Query) -> None:
        """Every schema that the query asks for, each on its own key."""
        with suppress(zenoh.ZError), query:
            for key, text in self._schemas:
                if query.key_expr.intersects(key):
                    query.reply(key, text, encoding=zenoh.Encoding.APPLICATION_JSON)
