"""Compile the numeric kernels once, into the cache of every later start; on two cores, the two big parts at once."""

from multiprocessing import get_context

from motm_twin.model.scene_file import load_scene
from motm_twin.planning.warm_up import warm_up_placement, warm_up_search
from motm_twin.twin import Twin

PERIODS = 10  # of Experiment 1: the first one needs nearly every kernel that is left


def main() -> None:
    """Compile what planning needs, then the rest by running the twin."""
    search = get_context("spawn").Process(target=warm_up_search)
    search.start()
    warm_up_placement()
    twin = Twin(load_scene("exp1"))
    search.join()
    for _ in range(PERIODS):
        twin.advance()


if __name__ == "__main__":
    main()
