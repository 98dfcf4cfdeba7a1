"""Client of a running twin, for programs in Python.

    from motm_twin.client import connect

    with connect() as twin:
        twin.play()
        twin.add_obstacle("crate", 1.0, -0.5)
        for tick in twin.ticks():
            print(tick.time, tick.robot.pose)

State is the newest value: a slow reader skips periods and never gets an old pose. Events are numbered and none is
lost. `docs/zenoh.md` describes the keys, for programs that use Zenoh without this package.
"""

from motm_twin.bus.commands import Answer, Refused
from motm_twin.client.discover import Found, NoTwin, running_twins
from motm_twin.client.twin import AsyncTwin, EventsLost, Twin, connect, connect_async

__all__ = [
    "Answer",
    "AsyncTwin",
    "EventsLost",
    "Found",
    "NoTwin",
    "Refused",
    "Twin",
    "connect",
    "connect_async",
    "running_twins",
]
