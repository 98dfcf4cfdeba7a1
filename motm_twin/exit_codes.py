"""Exit codes of every program."""

OK = 0
FAILED = 1  # it ran, and what was asked for did not come about
BAD_INPUT = 2  # its user can put something right
INTERRUPTED = 130  # Ctrl-C
