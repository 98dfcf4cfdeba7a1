"""Bounds of numbers, texts and lists, as annotations on the fields of a struct.

    seconds: Annotated[float, Between(0.05, 60.0, unit="s")]

`problem` checks a struct against its annotations; schemas, documents and tests read them with `bounds_of`. They are
not `msgspec.Meta`, which refuses during decoding and in terms of types: a command is decoded first, then refused with
the sentence of its bound. A scene file is checked while it is read, and takes the bound as `Between.meta`.
"""

import abc
import functools
import math
import re
import typing
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from typing import Any

import msgspec

from motm_twin.model.names import hint

_QUOTED = 40  # characters of a wrong text that are quoted


@dataclass(frozen=True)
class Bound(abc.ABC):
    """Base of all bounds. ``called``: name of its field in sentences, where the field's own name is unclear."""

    _: KW_ONLY
    called: str = ""

    @abc.abstractmethod
    def allowed(self) -> str:
        """The bound in a few words, for documents."""

    @abc.abstractmethod
    def refusal(self, name: str, value: Any) -> str:
        """Reason why the value of the field ``name`` is out of bounds, in one sentence; "" when it is within."""


@dataclass(frozen=True)
class Between(Bound):
    """A number from ``low`` to ``high``, or all numbers of a list."""

    low: float
    high: float
    _: KW_ONLY
    unit: str = ""

    def allowed(self) -> str:
        """Both ends and the unit."""
        return f"{_shown(self.low)} to {_shown(self.high)}{self._unit()}"

    def refusal(self, name: str, value: Any) -> str:
        """Refusal of the first number that is out of bounds or nan."""
        for number in value if isinstance(value, list | tuple) else (value,):
            is_number = isinstance(number, int | float) and not isinstance(number, bool)
            if is_number and not self.low <= number <= self.high:
                shown = "out of range" if abs(number) >= 1e300 else f"{_shown(number)}{self._unit()}"
                return f"{self.called or name} {shown}: allowed is {self.allowed()}"
        return ""

    def _unit(self) -> str:
        return f" {self.unit}" if self.unit else ""

    @property
    def meta(self) -> msgspec.Meta:
        """The same bound for structs that are checked while they are decoded."""
        return msgspec.Meta(ge=self.low, le=self.high, description=f"[{self.unit}]" if self.unit else None)


@dataclass(frozen=True)
class Length(Bound):
    """The length of a vector with two components: one field with both, or this field and the ``other`` one."""

    most: float
    _: KW_ONLY
    unit: str
    other: str = ""

    def allowed(self) -> str:
        """The largest length."""
        return f"length {f'with {self.other} ' if self.other else ''}at most {self.most:g} {self.unit}"

    def refusal(self, name: str, value: Any) -> str:
        """Refusal of a vector that is longer, or not finite."""
        length = math.hypot(*value)
        shown = f"{self.called or name} {length:.4g} {self.unit}"
        return "" if length <= self.most else f"{shown}: at most {self.most:g} {self.unit}"


@dataclass(frozen=True)
class Text(Bound):
    """Number and kind of characters: printable ones, or those of a ``pattern`` that ``words`` describe."""

    least: int
    most: int
    _: KW_ONLY
    pattern: str = ""
    words: str = "characters"

    def allowed(self) -> str:
        """The number and kind of characters."""
        return f"{f'{self.least} to' if self.least else 'at most'} {self.most} {self.words}"

    def refusal(self, name: str, value: Any) -> str:
        """Refusal of a text with another length or other characters."""
        if not isinstance(value, str) or not (value or self.least):
            return ""
        if not value and not self.pattern:
            return f"the {self.called or name} is empty: choose one"
        fits = re.fullmatch(self.pattern, value) if self.pattern else value.isprintable()
        if fits and self.least <= len(value) <= self.most:
            return ""
        shown = f" {value[:_QUOTED]!r}" if self.pattern else ""
        return f"{self.called or name}{shown}: use {'' if self.pattern else 'printable text, '}{self.allowed()}"


@dataclass(frozen=True)
class Count(Bound):
    """The number of entries of a list."""

    least: int
    most: int

    def allowed(self) -> str:
        """The number of entries."""
        return f"{self.least} to {self.most}"

    def refusal(self, name: str, value: Any) -> str:
        """Refusal of a longer or shorter list."""
        fits = self.least <= len(value) <= self.most
        return "" if fits else f"{len(value)} {self.called or name}: allowed is {self.allowed()}"


@dataclass(frozen=True)
class OneOf(Bound):
    """One of several texts. ``where``: the place that lists them, when there are many."""

    choices: tuple[str, ...]
    _: KW_ONLY
    where: str = ""

    def allowed(self) -> str:
        """The choices, or their place."""
        return self.where or ", ".join(self.choices)

    def refusal(self, name: str, value: Any) -> str:
        """Refusal of another text; it names similar ones."""
        if value in self.choices:
            return ""
        return f"{self.called or name} {value[:_QUOTED]!r} is unknown; {hint(value, self.choices)}"


@dataclass(frozen=True)
class Listed(Bound):
    """A bound that depends on what is loaded: documented here, checked by the twin."""

    words: str

    def allowed(self) -> str:
        """The words given to the constructor."""
        return self.words

    def refusal(self, name: str, value: Any) -> str:
        """No refusal: the twin checks."""
        return ""


FARTHEST = Between(-100, 100, unit="m")  # coordinate of anything in a scene
SEED = Between(0, 2**63 - 1)  # of a scene: of its noise and random arrangements


@functools.cache
def bounds_of(kind: type[msgspec.Struct]) -> dict[str, tuple[Bound, ...]]:
    """Bounds of the fields of a struct, by field; those without one are absent."""
    found = {field.name: tuple(_bounds_in(field.type)) for field in msgspec.structs.fields(kind)}
    return {name: bounds for name, bounds in found.items() if bounds}


def problem(struct: Any) -> str:
    """The first field of a struct, or of the structs in it, that is out of bounds, in one sentence; "" when none is.

    A method ``conflict`` of the struct comes last: it names fields that do not fit together, in one sentence.
    """
    for name, bounds in bounds_of(type(struct)).items():
        value = getattr(struct, name)
        for bound in bounds if value is not None else ():
            if isinstance(bound, Length) and bound.other:
                refusal = bound.refusal(name, (value, getattr(struct, bound.other)))
            else:
                refusal = bound.refusal(name, value)
            if refusal:
                return refusal
        for item in value if isinstance(value, list | tuple) else ():
            if isinstance(item, msgspec.Struct) and (refusal := problem(item)):
                return refusal
    return struct.conflict() if hasattr(struct, "conflict") else ""


def _bounds_in(annotation: Any) -> Iterator[Bound]:
    yield from (item for item in getattr(annotation, "__metadata__", ()) if isinstance(item, Bound))
    for part in typing.get_args(annotation):
        if not isinstance(part, Bound):
            yield from _bounds_in(part)


def _shown(value: float) -> str:
    return str(value) if isinstance(value, int) else f"{value:.10g}"
