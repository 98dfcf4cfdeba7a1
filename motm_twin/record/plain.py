"""Edits of programs, as a session keeps them: a whole number for a float, or one of NumPy, is not the same bits."""

from typing import Any, TypeVar

import msgspec
import numpy as np

from motm_twin.model.edits import EDITS

E = TypeVar("E", bound=msgspec.Struct)


def plain(edit: E) -> E:
    """The edit with numbers and texts of Python, as if it were read from a session; raises ValueError when it is none.

    A run that is recorded and one that is repeated then have the same values, to the type.
    """
    if not isinstance(edit, EDITS):
        raise ValueError(f"{type(edit).__name__} is no edit: use one of {', '.join(kind.__name__ for kind in EDITS)}")
    try:
        return msgspec.convert(msgspec.to_builtins(edit, enc_hook=_of_numpy), type(edit))
    except (TypeError, msgspec.MsgspecError) as error:
        raise ValueError(f"{type(edit).__name__} cannot be taken: {error}") from error


def _of_numpy(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, np.ndarray):
        return value.tolist()
    raise TypeError(f"{type(value).__name__} is neither a number nor a text nor made of them")
