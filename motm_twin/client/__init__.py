"""The twin from another program, in a few typed lines.

    from motm_twin.client import connect

    with connect() as twin:
        twin.play()
        twin.add_obstacle("crate", 1.0, -0.5)
        for tick in twin.ticks():
            print(tick.time, tick.robot.pose)

State is latest-value: a slow reader skips periods and is never served an old pose. Events are numbered and none is
lost. `docs/zenoh.md` describes the keys behind this, for programs that use Zenoh without this package.
"""

from motm_twin.bus.commands import Answer, Refused
from motm_twin.client.asynchronous import AsyncTwin, connect_async
from motm_twin.client.discover import Found, NoTwin, running_twins
from motm_twin.client.events import EventsLost
from motm_twin.client.twin import Twin, connect

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
