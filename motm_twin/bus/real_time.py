"""Real-time scheduling of the control loop's thread, where the operating system allows it.

What else runs on a machine, such as the answering of 1,000 messages a second, otherwise takes the loop's core now and
then, and leaves its caches cold: a period then takes a tenth longer. As controllers of ROS 2 do, the loop asks for
SCHED_FIFO; unlike them it does so only while it sleeps between its periods, so that it does not keep a core for itself.
"""

import os

PRIORITY = 20  # of 1 to 99: below the threads of the kernel (50)


class RealTime:
    """The scheduling of the calling thread; always use it from the same one."""

    def __init__(self) -> None:
        self._on, self._allowed = False, hasattr(os, "SCHED_FIFO")

    @property
    def on(self) -> bool:
        """Whether it is real-time."""
        return self._on

    def want(self, on: bool) -> None:
        """Real-time scheduling or the usual one; threads and processes that the thread starts have the usual one."""
        if on == self._on or not self._allowed:
            return
        try:
            schedule(on)
        except OSError:  # not permitted: PermissionError, or another one in some containers
            self._allowed = False
        else:
            self._on = on


def schedule(real_time: bool) -> None:
    """Schedule the calling thread so. Raises OSError where that is not permitted.

    That its children do not inherit it is for good: only a privileged thread could take that back.
    """
    policy, priority = (os.SCHED_FIFO, PRIORITY) if real_time else (os.SCHED_OTHER, 0)
    os.sched_setscheduler(0, policy | os.SCHED_RESET_ON_FORK, os.sched_param(priority))


def refusal() -> str:
    """Why the operating system gives no real-time scheduling; "" where it does. Call it before the loop runs."""
    if not hasattr(os, "SCHED_FIFO"):
        return "this operating system has none"
    try:
        schedule(True)
        schedule(False)
    except OSError as error:
        return error.strerror or str(error)
    return ""
