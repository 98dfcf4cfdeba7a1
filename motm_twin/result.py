"""`motm_twin.run`: one headless trial, with a result to read, compare and plot."""

import html
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from motm_twin.control.method import Method
from motm_twin.control.tick import Tick
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import Array
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.trial import run_scene

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Track(NamedTuple):
    """Motion of the robot, one row per control period."""

    time: Array  # [s], shape (n,)
    pose: Array  # true pose of the base: x, y [m], heading [rad]; shape (n, 3)
    twist: Array  # of the base, as reported: [m/s], [rad/s]; shape (n, 2)
    joints: Array  # [rad], shape (n, 7)
    task: Array  # index in the task list, shape (n,)


class Result(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Outcome of one trial: `success`, `time_s`, `placed`, `contacts`, `plot()`, and more.

    ``report`` is the dictionary that `motm-twin run --json` prints, ``track`` the motion of the robot.
    """

    scene: Scene
    report: dict[str, Any]
    track: Track
    figure: Any = msgspec.field(default=None)  # data of `plot`

    @property
    def success(self) -> bool:
        """True if every task is done, no object lies where it was dropped, and the robot caused no contact."""
        return bool(self.report["success"])

    @property
    def reason(self) -> str:
        """Reason why the trial failed, in one sentence; "" if it succeeded."""
        return str(self.report["reason"])

    @property
    def time_s(self) -> float:
        """Simulated time of the trial [s]."""
        return float(self.report["time_s"])

    @property
    def placed(self) -> tuple[int, int]:
        """Number of objects in their bins, and number of objects that should be there."""
        return int(self.report["places_done"]), int(self.report["places_total"])

    @property
    def contacts(self) -> list[dict[str, Any]]:
        """Contacts that the referee detected, each with `caused_by_robot`."""
        return list(self.report["contacts"])

    @property
    def state_hash(self) -> str:
        """Hash of the final state, equal for equal scenes, seeds, commands and versions."""
        return str(self.report["state_hash"])

    def plot(self, file: str | Path | None = None) -> "Figure":
        """Draw speed along the path, and the time of each leg beside the reference tour; ``file``: also save it there.

        The suffix of ``file`` chooses the format: .png, .svg, .pdf.
        """
        return self.figure.draw(self.report, None if file is None else Path(file))

    def __repr__(self) -> str:
        """The trial in one line."""
        return f"<Result {self._headline()}>"

    def _headline(self) -> str:
        report, (done, total) = self.report, self.placed
        name = "/".join(part for part in (report["scene"], report["variant"]) if part)
        caused = report["contacts_caused_by_robot"]
        text = (
            f"{name} seed {report['seed']}, {report['method']}: {self.time_s:.2f} s, {done} of {total} placed, "
            f"{len(self.contacts)} contacts ({caused} caused by the robot)"
        )
        return text + ("" if self.success else f"; no success: {self.reason}")

    def _repr_html_(self) -> str:
        """A table for notebooks."""
        rows = [
            (f"{leg['index'] + 1}", leg["task"], leg["target"], f"{leg['time_s']:.2f} s")
            for leg in self.report["measures"]["legs"]
            if leg["task"] != "done"
        ]
        head = "".join(f"<th>{name}</th>" for name in ("", "task", "target", "time"))
        body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
        return f"<p>{html.escape(self._headline())}</p><table><tr>{head}</tr>{body}</table>"


def run(
    scene: str | Path | Scene = "exp1", *, variant: str | None = None, seed: int | None = None,
    method: str | Method = "fast", parameters: Mapping[str, ParameterValue] | None = None,
    on_tick: Callable[[Tick], None] | None = None,
) -> Result:  # fmt: skip
    """Run a scene headless, as fast as the processor allows.

    Args:
        scene: Name of a shipped scene, path of a scene file, or a `Scene` from `load_scene`.
        variant: Named variant of the scene; None: its default. Not together with a `Scene`.
        seed: Seed of noise and random arrangements; None: the scene's. Not together with a `Scene`.
        method: Name of a method, ``FILE.py:NAME`` of your own, or a `Method`.
        parameters: Values by name, on top of the method's; docs/zenoh.md lists them.
        on_tick: Called with the Tick of every period.

    Raises:
        SceneError: The scene, variant or seed cannot be used.
        MethodError: There is no such method.
        ValueError: A parameter is unknown or out of range.
    """
    if isinstance(scene, Scene):
        if variant is not None or seed is not None:
            raise ValueError("a Scene has its variant and seed already: give them to load_scene instead")
        loaded = scene
    else:
        loaded = load_scene(str(scene), variant, seed)
    from motm_twin.studies.speed_plot import SpeedFigure  # loads matplotlib

    figure, rows = SpeedFigure(loaded), _Rows()

    def take(tick: Tick) -> None:
        rows.add(tick)
        figure.add(tick)
        if on_tick is not None:
            on_tick(tick)

    chosen = find_method(method) if isinstance(method, str) else method
    report = run_scene(loaded, on_tick=take, method=chosen, parameters=dict(parameters or {}))
    return Result(scene=loaded, report=report, track=rows.track(), figure=figure)


class _Rows:
    """Rows of the track, period by period."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, Array, Array, Array, int]] = []

    def add(self, tick: Tick) -> None:
        assert tick.truth is not None
        seen = tick.observation
        self.rows.append((tick.time, tick.truth.pose, seen.twist, seen.q, tick.task_index))

    def track(self) -> Track:
        return Track(*(np.array(column) for column in zip(*self.rows, strict=True)))
