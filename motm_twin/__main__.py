"""`motm-twin`, also as `python -m motm_twin`: Ctrl-C while the command line is still being loaded is no traceback."""

import sys


def main() -> None:
    """Load the command line and run it."""
    try:
        from motm_twin import cli
    except KeyboardInterrupt:
        print("motm-twin: stopped", file=sys.stderr)
        sys.exit(130)
    cli.main()


if __name__ == "__main__":
    main()
