"""`motm-twin run --save`: a headless run that leaves a session behind."""

from pathlib import Path
from typing import Any

from motm_twin.control.tick import Tick
from motm_twin.control.tuning import parameter
from motm_twin.methods.fast import FAST
from motm_twin.methods.method import Method
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import Tracker
from motm_twin.record.session import Session, SessionError, save_session
from motm_twin.trial import run_scene


def run_and_save(scene: str, variant: str | None, seed: int | None, file: str, method: Method = FAST) -> dict[str, Any]:
    """Run a scene to its end, save the session; the report of the run. Raises SceneError and SessionError."""
    loaded = load_scene(scene, variant, seed)
    folder = Path(file).parent
    if not folder.is_dir() or Path(file).is_dir():
        raise SessionError("cannot be written: give a file in a folder that exists", file=file)
    tracker, periods = Tracker(), 0

    def on_tick(tick: Tick) -> None:
        nonlocal periods
        periods = tick.index + 1
        tracker.add(tick)

    report = run_scene(loaded, on_tick=on_tick, method=method)
    title = f"{loaded.title}, headless"
    saved = Session(
        title=title,
        scene=loaded,
        method=method.name,
        parameters={name: value for name, value in method.parameters.items() if value != parameter(name).default},
        periods=periods,
        state_hash=report["state_hash"],
        track=tracker.track,
    )
    save_session(saved, file)
    return report
