"""What a running twin would still have to compile after the warm-up, in the middle of a run: it should be nothing.

    .venv/bin/python tools/left_to_compile.py    # about two minutes; exit code 1 and the names, when something is left

A kernel takes 0.2 to 0.7 s to be compiled, once per installation: a robot that has to brake must not wait for that.
"""

import itertools
import os
import subprocess
import sys
import tempfile
from pathlib import Path

from motm_twin.methods.registry import find_method
from motm_twin.model.edits import AddObstacle, InjectFault, MoveBody, PushRobot, ReleaseBody
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

RUNS = (  # scene, variant, method, periods
    ("exp1", "trial1", "motm", 1500),
    ("exp1a", "trial1", "motm", 900),
    ("exp1a", "trial2", "fast", 900),
    ("exp2", "random", "motm", 1200),
    ("exp2", "random", "fast", 1200),
    ("playground", None, "motm", 400),
)
SHAPES = itertools.cycle(("temi", "box", "person", "cylinder"))
EVERY = 200  # periods between two disturbances


def drive() -> None:
    """Run the scenes; people put things before the robot, throw them, push it, and a sensor fails."""
    for scene, variant, method, periods in RUNS:
        twin = Twin(load_scene(scene, variant), method=find_method(method))
        for index in range(periods):
            if index % EVERY == EVERY // 2:
                _disturb(twin, index)
            tick = twin.advance()
            if tick.done:
                break


def _disturb(twin: Twin, index: int) -> None:
    x, y = (float(value) for value in twin.plant.truth().pose[:2])
    for number, (dx, dy) in enumerate(((0.9, 0.0), (0.0, 0.9), (-0.9, 0.0), (0.0, -0.9))):
        name = f"thing {index} {number}"
        for edit in (
            AddObstacle(name=name, shape=next(SHAPES), x=x + dx, y=y + dy, size=(0.3, 0.3, 0.6)),
            MoveBody(name=name, x=x + 1.1 * dx, y=y + 1.1 * dy),
            ReleaseBody(name=name, velocity=(-dx, -dy)),
        ):
            _try(twin, edit)
    _try(twin, PushRobot(dx=0.05, dy=0.0))
    _try(twin, InjectFault(fault="lidar_off", seconds=0.5))


def _try(twin: Twin, edit: object) -> None:
    try:
        twin.post(edit)
    except ValueError as error:  # where there is no room
        print(f"  {error}")


def main() -> int:
    """Compile into an empty cache, then run, and compare."""
    with tempfile.TemporaryDirectory() as folder:
        env = {**os.environ, "NUMBA_CACHE_DIR": folder, "OMP_NUM_THREADS": "1"}
        subprocess.run([sys.executable, "-m", "motm_twin.warm_up"], env=env, check=True)
        before = _kernels(Path(folder))
        subprocess.run([sys.executable, __file__, "--drive"], env=env, check=True)
        left = sorted(_kernels(Path(folder)) - before)
    print(f"{len(before)} kernels were compiled by the warm-up, {len(left)} later", *left, sep="\n  ")
    return 1 if left else 0


def _kernels(folder: Path) -> set[str]:
    """Every variant of every kernel of the package."""
    return {path.name for path in folder.rglob("*.nbc")}


if __name__ == "__main__":
    if sys.argv[1:] == ["--drive"]:
        drive()
    else:
        sys.exit(main())
