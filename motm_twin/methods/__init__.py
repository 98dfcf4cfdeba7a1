"""Methods by name: the paper's, its ablations, `fast`, and the rivals that they are compared with."""

DEFAULT_METHOD = "fast"
UNNAMED_METHOD = "motm"  # of files and messages that name none: it was the default when their versions were published
