"""`python -m motm_twin.bench [GROUP ...]`: the numbers of the paper and ours. Exit code 1 when one is missed."""

import argparse
import sys
from pathlib import Path

from rich.console import Console

from motm_twin.bench.groups import GROUPS
from motm_twin.bench.table import bench

TABLE_WIDTH = 132  # characters; a narrower table is not readable


def main(arguments: list[str] | None = None) -> int:
    """Run the named groups, or all; 0 when every number was reached, 1 when not."""
    parser = argparse.ArgumentParser(prog="python -m motm_twin.bench", description=__doc__)
    parser.add_argument("groups", nargs="*", default=["all"], metavar="GROUP", help=f"all, {', '.join(GROUPS)}")
    parser.add_argument("--workers", type=int, default=2, help="trials run at the same time (default 2)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the JSON files")
    options = parser.parse_args(arguments)
    names = list(GROUPS) if "all" in options.groups else options.groups
    unknown = [name for name in names if name not in GROUPS]
    if unknown or options.workers < 1:
        parser.error(f"unknown group {unknown[0]!r}: use all, {', '.join(GROUPS)}" if unknown else "need a worker")
    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, TABLE_WIDTH)
    missed = [name for name in names if not bench(GROUPS[name], options.out, options.workers, console)]
    console.print(f"\n[red]missed: {', '.join(missed)}[/red]" if missed else "\n[green]all numbers reached[/green]")
    return 1 if missed else 0


if __name__ == "__main__":
    sys.exit(main())
