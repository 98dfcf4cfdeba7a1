"""Interfaces of the server's loop: twin, scene library, and receivers of its results."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

from motm_twin.bus.commands import Load
from motm_twin.bus.messages import MethodChoice, SceneChoice, TickMessage
from motm_twin.control.tick import Tick
from motm_twin.model.edits import Edit, ParameterValue
from motm_twin.model.geometry import Array
from motm_twin.model.scene import PlanarPose, Scene
from motm_twin.planning.types import SearchBudget
from motm_twin.sessions.session import LoggedEdit, Session

if TYPE_CHECKING:
    from motm_twin.control.method import Method


class TwinLike(Protocol):
    """A twin, as the loop uses it."""

    edits: list[LoggedEdit]  # log of all edits of this run
    refused: list[str]  # accepted edits that an external robot refused in the last period, a sentence each

    def advance(self, budget: SearchBudget | None = None) -> Tick:
        """Compute one period; ``budget`` overrides the search budget."""
        ...

    def post(self, edit: Edit) -> None:
        """Apply an edit at the start of the next period. Raises ValueError when it is not possible."""
        ...

    def reset(self) -> None:
        """Back to the start."""
        ...

    @property
    def index(self) -> int:
        """Number of the next period."""
        ...

    @property
    def parameters(self) -> dict[str, ParameterValue]:
        """Parameters that were changed."""
        ...

    @property
    def announced(self) -> dict[str, PlanarPose]:
        """Announced places of furniture: reference point x, y [m], turn [rad]."""
        ...

    def session(self, title: str = "") -> Session:
        """The session that repeats the run so far."""
        ...

    def candidate_paths(self, index: int) -> tuple[Array, Array] | None:
        """Paths to a candidate of the last period, and from there to the next target; shapes (m, 2) and (k, 2)."""
        ...

    def staa_path(self) -> Array:
        """Shortest path of unmodified STAA* in the last period, shape (m, 2)."""
        ...

    def snapshot(self) -> dict[str, Any]:
        """A copy of the whole state."""
        ...

    def restore(self, state: dict[str, Any]) -> None:
        """Continue from a snapshot."""
        ...


class SceneLibrary(Protocol):
    """Scenes that may be loaded."""

    def choices(self) -> list[SceneChoice]:
        """All of them."""
        ...

    def load(self, scene: str, variant: str | None, seed: int | None) -> Scene:
        """Resolve one. Raises ValueError with a reason."""
        ...

    def changed(self) -> bool:
        """True when the files of the loaded scene have changed since the load or the last call."""
        ...


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


class Methods(Protocol):
    """Methods that may be loaded."""

    def choices(self) -> list[MethodChoice]:
        """All of them."""
        ...

    def find(self, name: str) -> "Method":
        """One of them. Raises ValueError with a reason."""
        ...


class MakeTwin(Protocol):
    """Makes the twin of a scene under a method."""

    def __call__(self, scene: Scene, *, method: "Method") -> TwinLike:
        """At its start."""
        ...


@dataclass(frozen=True, kw_only=True)
class TwinSetup:
    """Setup of a server: its scenes and methods, the first to load, and the factory of twins."""

    library: SceneLibrary
    make_twin: MakeTwin
    first: Load
    playing: bool = True
    hold: bool = False  # a run waits at its start until a page shows it
    again: bool = False  # after a run that nobody drives, the next seed starts
    methods: Methods | None = None  # None: the shipped ones
    reference_tour: Callable[[Scene], float] | None = None  # [s] lower bound of a scene
    plant: str = "simulated"  # simulated, zenoh or mirror, as the twins that ``make_twin`` makes will be


class Reply(Protocol):
    """Callback for the outcome of a command, called once."""

    def __call__(self, reason: str, index: int, path: str = "", /) -> None:
        """Take the refusal ("" = done), the last period before, and the written file."""
        ...


SessionReply = Callable[[bytes, bytes, str], None]  # session and SessionInfo as JSON, or why there are none
