"""What a program or person is told about an error."""

import traceback

from motm_twin.bus.commands import Refused


def said(error: Exception) -> str:
    """What to tell; what is no refusal is our own fault, and its traceback is printed."""
    if isinstance(error, Refused):
        return str(error)
    traceback.print_exception(error)
    return f"{type(error).__name__}: {error}"
