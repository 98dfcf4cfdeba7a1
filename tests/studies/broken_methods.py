"""Methods that go wrong in a worker."""

import os
import signal
from dataclasses import replace
from pathlib import Path

from motm_twin.control.method import paper_planner
from motm_twin.methods.registry import MOTM


def _dies(parts):
    os.kill(os.getpid(), signal.SIGKILL)


def _dies_once(parts):
    """Until the file that MOTM_TEST_MARK names is there."""
    mark = Path(os.environ["MOTM_TEST_MARK"])
    if not mark.exists():
        mark.touch()
        _dies(parts)
    return paper_planner(parts)


def _raises(parts):
    raise RuntimeError("no planner today")


DIES = replace(MOTM, name="dies", planner=_dies)
DIES_ONCE = replace(MOTM, name="dies_once", planner=_dies_once)
RAISES = replace(MOTM, name="raises", planner=_raises)
