"""For all tests: their helpers by name (twin_steps), and an order in which no worker is left with the long ones."""

import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))


def pytest_collection_modifyitems(items):
    """The long tests, those in a browser, come first in the share of each worker; a file stays in one share.

    `--dist worksteal` begins with a contiguous share for each worker, and a worker that is done steals from the end of
    another's.
    """
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    long = [item for item in items if item.get_closest_marker("browser")]
    short = [item for item in items if not item.get_closest_marker("browser")]
    files = {file: place for place, file in enumerate(dict.fromkeys(item.path for item in long))}
    size = -(-len(short) // workers)
    items[:] = [
        item
        for worker in range(workers)
        for item in (
            *(one for one in long if files[one.path] % workers == worker),
            *short[worker * size : (worker + 1) * size],
        )
    ]
