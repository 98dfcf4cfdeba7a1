"""Copying, restoring and hashing of state.

All that changes during a run lives in objects that derive from `Stateful`: their mutable part is one plain
dataclass, `_state`, made of numbers, strings, arrays, containers, dataclasses and `numpy.random.Generator`.
"""

import copy
import dataclasses
import hashlib
import struct
from typing import Any, Generic, Protocol, TypeVar, runtime_checkable

import msgspec
import numpy as np

S = TypeVar("S")
LATER = {"hashed": "unless default"}  # metadata of a field added later: runs that do not use it keep their hash


class Stateful(Generic[S]):
    """Mixin: all mutable state is in ``self._state``, so it can be copied, restored and hashed."""

    _state: S

    def snapshot(self) -> S:
        """A deep copy of the state; `restore` accepts it any number of times."""
        return copy.deepcopy(self._state)

    def restore(self, state: S) -> None:
        """Continue from a snapshot."""
        self._state = copy.deepcopy(state)


@runtime_checkable
class HasState(Protocol):
    """Anything that can be copied and restored: one `Stateful` or several together."""

    def snapshot(self) -> Any:
        """A deep copy of the state."""
        ...

    def restore(self, state: Any) -> None:
        """Continue from a snapshot."""
        ...


def state_hash(value: Any) -> str:
    """SHA-256 (hex) over a nested state; equal states give equal hashes on every machine with IEEE floats.

    Raises TypeError for a type that is not plain state, naming it: a hash that skips something proves nothing.
    """
    digest = hashlib.sha256()
    _add(digest, value)
    return digest.hexdigest()


def _add(digest: Any, value: Any) -> None:
    if value is None or isinstance(value, (bool, int, str, bytes)):
        digest.update(f"{type(value).__name__}:{value!r};".encode())
    elif isinstance(value, (float, np.floating)):
        digest.update(b"f" + struct.pack("<d", float(value)))
    elif isinstance(value, np.integer):
        digest.update(f"int:{int(value)!r};".encode())
    elif isinstance(value, np.bool_):
        digest.update(f"bool:{bool(value)!r};".encode())
    elif isinstance(value, np.ndarray):
        digest.update(f"a{value.dtype.str}{value.shape}".encode())
        digest.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, np.random.Generator):
        _add(digest, value.bit_generator.state)
    elif isinstance(value, (list, tuple)):
        digest.update(f"l{len(value)}".encode())
        for item in value:
            _add(digest, item)
    elif isinstance(value, dict):
        digest.update(f"d{len(value)}".encode())
        for key in sorted(value, key=repr):
            _add(digest, key)
            _add(digest, value[key])
    elif isinstance(value, (set, frozenset)):
        _add(digest, sorted(value, key=repr))
    elif isinstance(value, msgspec.Struct):
        digest.update(type(value).__name__.encode())
        _feed_struct(digest, value)
    elif dataclasses.is_dataclass(value):
        digest.update(type(value).__name__.encode())
        for field in dataclasses.fields(value):
            item = getattr(value, field.name)
            if field.metadata != LATER:
                _add(digest, item)
            elif item != field.default:
                _add(digest, (field.name, item))
    elif hasattr(value, "__index__"):
        digest.update(f"int:{int(value)!r};".encode())
    else:
        raise TypeError(f"{type(value).__qualname__} is not plain state and cannot be hashed")


def _feed_struct(digest: Any, value: msgspec.Struct) -> None:
    """Hash all fields; those in `later` of the class only if they differ from their defaults."""
    later: tuple[str, ...] = getattr(type(value), "later", ())
    for field in msgspec.structs.fields(value) if later else ():
        item = getattr(value, field.name)
        if field.name not in later:
            _add(digest, item)
        elif item != field.default:
            _add(digest, (field.name, item))
    for name in () if later else value.__struct_fields__:
        _add(digest, getattr(value, name))
