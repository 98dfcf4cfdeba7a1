"""`motm-twin`, also as `python -m motm_twin`: a signal during loading ends it without a traceback."""

import os
import sys

from motm_twin.processes import loaded, starting


def main() -> None:
    """Load the command line and run it."""
    starting()
    _open_standard_files()
    try:
        from motm_twin import cli

        cli.main()
    except KeyboardInterrupt:
        print("motm-twin: stopped", file=sys.stderr)
        sys.exit(130)
    finally:
        loaded()


def _open_standard_files() -> None:
    """Open the null device for closed streams, whose descriptors the next opened file would otherwise get."""
    for number, name, mode in ((0, "stdin", "r"), (1, "stdout", "w"), (2, "stderr", "w")):
        if getattr(sys, name) is None:
            descriptor = os.open(os.devnull, os.O_RDWR)
            if descriptor != number:
                os.dup2(descriptor, number)
                os.close(descriptor)
            setattr(sys, name, os.fdopen(number, mode, encoding="utf-8", closefd=False))


if __name__ == "__main__":
    main()
