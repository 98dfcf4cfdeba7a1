"""Compile the numeric kernels, once per installation: ``python -m motm_twin.warm_up``.

Numba keeps what it compiled, so every later start takes it from there. The three big parts are compiled at the same
time, in processes of their own.
"""

from multiprocessing import get_context
from pathlib import Path

from motm_twin.model.scene_file import load_scene
from motm_twin.planning.staa import run_search
from motm_twin.planning.warm_up import warm_up_placement, warm_up_search

PERIODS = 10  # of Experiment 1: the first one needs nearly every kernel that is left


def is_warm() -> bool:
    """Whether the largest kernel is in numba's cache (changed code is compiled again all the same)."""
    return any(Path(run_search.stats.cache_path).glob(f"*{run_search.__name__}*.nbi"))


def compile_planning() -> None:
    """Compile the kernels of base placement and local search, unless they are there already."""
    if is_warm():
        return
    parts = [get_context("spawn").Process(target=part) for part in (warm_up_search, warm_up_placement)]
    for part in parts:
        part.start()
    _warm_up_the_rest()
    for part in parts:
        part.join()


def _warm_up_the_rest() -> None:
    """Compile simulation and perception while planning is compiled elsewhere."""
    from motm_twin.model.known import known_world
    from motm_twin.perception.mapper import Mapper
    from motm_twin.sim.plant import SimulatedPlant

    scene = load_scene("exp1a")
    plant, mapper = SimulatedPlant(scene), Mapper(known_world(scene))
    for _ in range(PERIODS):
        mapper.update(plant.observe())
        plant.step(0.05)


def main() -> None:
    """Compile everything, by running the twin."""
    from motm_twin.twin import Twin

    compile_planning()
    twin = Twin(load_scene("exp1"))
    for _ in range(PERIODS):
        twin.advance()


if __name__ == "__main__":
    main()
