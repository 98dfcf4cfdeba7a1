"""Garbage collection: what a process has set up stays, and is not looked at again in the middle of a run."""

import gc

_frozen = False


def freeze_setup() -> None:
    """Leave everything that exists now out of later collections; only the first call of a process does it.

    A full collection goes through all modules and kernels: 40 ms of a period of 50 ms. What was set up for a run is
    freed as ever when nothing refers to it any more, except for cycles in what exists at the first call.
    """
    global _frozen  # noqa: PLW0603 - once per process
    if not _frozen:
        _frozen = True
        gc.collect()
        gc.freeze()
