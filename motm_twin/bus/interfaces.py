"""The loop of the server and its surroundings: its setup, the receiver of its results, and answers to requests."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from motm_twin.bus.commands import Load
from motm_twin.bus.messages import TickMessage
from motm_twin.control.tick import Tick
from motm_twin.model.scene import Scene

if TYPE_CHECKING:  # slow to import: only once the server listens
    from motm_twin.bus.library import FileLibrary, MethodLibrary
    from motm_twin.twin import Twin


class Sink(Protocol):
    """Receiver of the loop's results; called from the loop's thread."""

    def tick(self, message: TickMessage, tick: Tick, last: bool) -> None:
        """A new period; ``last``: no other follows for now."""
        ...

    def scene(self, scene: Scene, run: int) -> None:
        """Another scene was loaded, whose first run will be ``run``."""
        ...

    def status(self) -> None:
        """The status changed."""
        ...

    def event(self, *, run: int, index: int, time: float, kind: str, text: str) -> None:
        """An event that no period shows."""
        ...


MakeTwin = Callable[..., "Twin"]  # (scene, *, method): the twin at its start


@dataclass(frozen=True, kw_only=True)
class TwinSetup:
    """Setup of a server: its scenes and methods, the first to load, and the factory of twins."""

    library: "FileLibrary"
    make_twin: MakeTwin
    first: Load
    playing: bool = True
    hold: bool = False  # a run waits at its start until a page shows it
    again: bool = False  # after a run that nobody drives, the next seed starts
    methods: "MethodLibrary | None" = None  # None: the shipped ones
    reference_tour: Callable[[Scene], float] | None = None  # [s] lower bound of a scene
    plant: str = "simulated"  # simulated, zenoh or mirror, as the twins that ``make_twin`` makes will be


class Reply(Protocol):
    """Callback for the outcome of a command, called once."""

    def __call__(self, reason: str, index: int, path: str = "", /) -> None:
        """Take the refusal ("" = done), the last period before, and the written file."""
        ...


SessionReply = Callable[[bytes, bytes, str], None]  # session and SessionInfo as JSON, or why there are none
