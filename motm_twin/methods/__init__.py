"""Methods by name: the paper's, its ablations, `fast`, and the rivals."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from motm_twin.control.method import Method

DEFAULT_METHOD = "fast"
UNNAMED_METHOD = "motm"  # of files and messages that name none: it was the default when their versions were published


def names() -> tuple[str, ...]:
    """Names of the shipped methods."""
    from motm_twin.methods.registry import METHODS

    return tuple(METHODS)


def find(name: str) -> "Method":
    """Return the method of this name, or of ``FILE.py:NAME``. Raises MethodError, which lists similar names."""
    from motm_twin.methods.registry import find_method

    return find_method(name)
