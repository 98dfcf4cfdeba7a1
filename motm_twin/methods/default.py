"""Who decides when nobody says who; imports nothing, so that the command line and the page may ask."""

DEFAULT_METHOD = "fast"
UNNAMED_METHOD = "motm"  # of files and messages that name none: it was the default when their versions were published
