"""`python -m motm_twin.bench [GROUP ...]`: the numbers of the paper and ours. Exit code 1 when one is missed.

"all" are the groups of trials. The others run only when they are named: "page" measures the served page and needs
Chromium, "bus" measures what goes over Zenoh, "soak" treats a server badly for long, "scale" loads a router.
"""

import argparse
import sys
from pathlib import Path

from rich.console import Console

from motm_twin.bench import bus, page, scale, soak
from motm_twin.bench.groups import GROUPS
from motm_twin.bench.table import bench

KNOWN = (*GROUPS, page.NAME, bus.NAME, soak.NAME, scale.NAME)
TABLE_WIDTH = 132  # characters; a narrower table is not readable


def main(arguments: list[str] | None = None) -> int:
    """Run the named groups, or all; 0 when every number was reached, 1 when not."""
    parser = argparse.ArgumentParser(prog="python -m motm_twin.bench", description=__doc__)
    parser.add_argument("groups", nargs="*", default=["all"], metavar="GROUP", help=f"all, {', '.join(KNOWN)}")
    parser.add_argument("--workers", type=int, default=2, help="trials run at the same time (default 2)")
    parser.add_argument("--out", type=Path, default=Path("out/bench"), help="folder of the JSON files")
    page.add_options(parser)
    parser.add_argument("--share", type=float, default=1.0, help="soak: of the full counts (default 1: half an hour)")
    options = parser.parse_args(arguments)
    names = [name for name in KNOWN if name in options.groups or ("all" in options.groups and name in GROUPS)]
    unknown = [name for name in options.groups if name not in ("all", *KNOWN)]
    if unknown or options.workers < 1:
        parser.error(f"unknown group {unknown[0]!r}: use all, {', '.join(KNOWN)}" if unknown else "need a worker")
    if not 0.0 < options.share <= 1.0:
        parser.error(f"--share {options.share:g}: allowed is more than 0 and at most 1")
    console = Console(highlight=False, soft_wrap=True)
    console.width = max(console.width, TABLE_WIDTH)
    missed = [name for name in names if not _reached(name, options, console)]
    console.print(f"\n[red]missed: {', '.join(missed)}[/red]" if missed else "\n[green]all numbers reached[/green]")
    return 1 if missed else 0


def _reached(name: str, options: argparse.Namespace, console: Console) -> bool:
    if name == page.NAME:
        return page.bench_page(options.out, options.seconds, options.minutes, console)
    if name == bus.NAME:
        return bus.bench_bus(options.out, options.seconds, console)
    if name == soak.NAME:
        return soak.bench_soak(options.out, options.share, console)
    if name == scale.NAME:
        return scale.bench_scale(options.out, options.seconds, console)
    return bench(GROUPS[name], options.out, options.workers, console)


if __name__ == "__main__":
    sys.exit(main())
