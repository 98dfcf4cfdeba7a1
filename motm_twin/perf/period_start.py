"""What `motm-twin run exp1` does until its first period, and a line as soon as that is done."""

import sys
import time


def main() -> None:
    """Import what `run` imports, load the scene, advance once."""
    from motm_twin import cli  # noqa: F401 - what the command imports
    from motm_twin.model.scene_file import load_scene
    from motm_twin.trial import Twin

    Twin(load_scene("exp1"), clock=time.perf_counter).advance()
    sys.stdout.write("first period\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
