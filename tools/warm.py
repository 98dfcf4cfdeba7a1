"""Compile the numeric kernels once, into the cache that every later start reads."""

from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

PERIODS = 10  # the first one needs nearly every kernel


def main() -> None:
    """Run the first periods of Experiment 1."""
    twin = Twin(load_scene("exp1"))
    for _ in range(PERIODS):
        twin.advance()


if __name__ == "__main__":
    main()
