"""A recording on Zenoh, under the keys of a twin; commands only as checked queries, as for a twin.

As a program: ``python -m motm_twin.record.player_server run.mcap --port 7447``.
"""

import argparse
import sys
import threading
from contextlib import suppress
from pathlib import Path

import msgspec
import zenoh

from motm_twin.bus.connection import DEFAULT_PORT, DEFAULT_TWIN, LOOPBACK, Keys, PortTaken, open_server
from motm_twin.bus.events import EventLog
from motm_twin.bus.messages import NumberedEvent
from motm_twin.bus.private_folder import forget
from motm_twin.bus.queries import Answering, Idle, LatestValues
from motm_twin.bus.server import HEARTBEAT, Server, server_clock
from motm_twin.processes import Reporter, leave, stop_event
from motm_twin.program import BAD_INPUT
from motm_twin.record import channels as ch
from motm_twin.record.player import AS_IT_WAS, Frames, Playback, Player
from motm_twin.sessions.session import SessionError

WATCH = 0.1  # [s] between checks of the state for the report


class PlayerServer(Server):
    """Serves one recording."""

    def __init__(
        self,
        path: str | Path,
        *,
        twin: str = "frankie",
        port: int = 0,
        playback: Playback = AS_IT_WAS,
        open_bus: bool = False,
    ) -> None:
        """Raises SessionError for a file that can not be played, PortTaken for the port."""
        frames = Frames(path)
        super().__init__(port)
        keys = self.keys = Keys(twin)
        self._session = open_server(self.port, LOOPBACK, keys.own, open_bus=open_bus)
        clock, self._encode = server_clock(), msgspec.json.encode
        idle = Idle()  # always set: nothing is computed here
        self._values = LatestValues(self._session, keys, idle)
        played = (ch.TICK, ch.GRID, ch.SCENE, ch.ROBOT, ch.SCAN, ch.EVENT, ch.METRICS)
        key_of = {channel.topic: getattr(keys, channel.topic.removeprefix("/motm/")) for channel in played}

        def put(topic: str, payload: bytes, attachment: bytes | None) -> None:
            self._put(key_of[topic], payload, attachment)

        name, changed = Path(path).name, self._send_status
        self.player = Player(frames, name=name, twin=twin, put=put, now=clock, changed=changed, playback=playback)
        self._log = EventLog(clock, lambda event: self._values.put(keys.event, self._encode(event)))
        self._values.answer(keys.event, self._log.answer)
        self._values.answer(keys.status, lambda _: self._encode(self.player.status()))
        self._answering = Answering(self._session, keys, now=clock, request=self.player.request, idle=idle)
        self._queryable = self._session.declare_queryable(keys.session, self._on_session)
        self._token = self._session.liveliness().declare_token(keys.alive)
        self._threads = [
            threading.Thread(target=self.player.run, name="player", daemon=True),
            threading.Thread(target=self._heartbeat, name="heartbeat", daemon=True),
        ]

    def close(self) -> bool:
        """Stop playing and withdraw all keys."""
        self._stop.set()
        self.player.stop()
        self._token.undeclare()
        self._answering.close()
        self._queryable.undeclare()
        for thread in self._threads:
            thread.join(1.0)
        self._values.close()
        self._session.close()
        forget(self.port)
        return True

    def _put(self, key: str, payload: bytes, attachment: bytes | None) -> None:
        """Send a message; events get new numbers, because the file's may repeat."""
        if key == self.keys.event:
            self._log.tell_again(msgspec.json.decode(payload, type=NumberedEvent))
        else:
            self._values.put(key, payload, attachment)

    def _send_status(self) -> None:
        self._values.put(self.keys.status, self._encode(self.player.status()))

    def _heartbeat(self) -> None:
        while not self._stop.wait(HEARTBEAT):
            self._send_status()

    @staticmethod
    def _on_session(query: zenoh.Query) -> None:
        with suppress(zenoh.ZError), query:
            query.reply_err("this is a recording: its file has the session, see `motm-twin rerun`")


def main() -> None:
    """Play until a signal or the end of the parent."""
    options = _options()
    report, stop = Reporter(options.report), stop_event(options.report is not None)
    playback = Playback(speed=options.speed, loop=options.loop, playing=not options.paused)
    try:
        server = PlayerServer(
            options.file, twin=options.twin, port=options.port, playback=playback, open_bus=options.open_bus
        )
    except (SessionError, PortTaken, ValueError) as error:
        report("refused", text=str(error))
        leave(BAD_INPUT)
        return
    report("listening", endpoint=server.endpoint)
    server.start()
    reported = ""
    while not stop.wait(WATCH):
        if server.player.state != reported:
            status = server.player.status()
            reported = status.state
            report("state", state=reported, text=status.text or status.plant_text)
    server.close()
    leave(0)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m motm_twin.record.player_server", description=__doc__)
    parser.add_argument("file")
    parser.add_argument("--port", type=int, default=DEFAULT_PORT, help="TCP port of Zenoh, 0 takes any free one")
    parser.add_argument("--twin", default=DEFAULT_TWIN, help="name in the keys")
    parser.add_argument("--speed", type=float, default=1.0, help="1 as it was, 1/8 to 8")
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument("--paused", action="store_true", help="do not play at the start")
    parser.add_argument("--open-bus", action="store_true", help="anybody on this machine is let in")
    parser.add_argument("--report", type=int, help=argparse.SUPPRESS)
    return parser.parse_args(sys.argv[1:])


if __name__ == "__main__":
    main()
