"""Meaning of a tunable number, as an annotation of its field; the field itself has the value.

    hysteresis: Annotated[float, Number("s", OWN, "cuts changes of mind")] = 0.3

Tables of documents, the sliders of the page and the screening (`studies/sensitivity.py`) are derived from it.
"""

import dataclasses
import functools
import typing
from collections.abc import Iterator
from dataclasses import KW_ONLY, dataclass
from typing import Any, NamedTuple

import msgspec

from motm_twin.model.edits import ParameterValue

OWN, STAA, MOTM = "own", "STAA*", "MotM"  # sources; any other is a section of the paper, made by `paper`
ROBOT = "robot"  # a property of this arm or gripper, not a choice: other robots differ


def paper(section: str) -> str:
    """The source of a number from a section of the paper."""
    return f"Paper, Sec. {section}"


@dataclass(frozen=True)
class Number:
    """Unit, source and reason of a field; ``symbol`` as in the paper or its sources."""

    unit: str
    source: str
    reason: str
    _: KW_ONLY
    symbol: str = ""


@dataclass(frozen=True)
class Slider:
    """The control on the page that changes a number while the twin runs; stands beside its `Number`."""

    title: str
    group: str  # one of `control.tuning.GROUPS`
    help: str  # one sentence
    span: tuple[float, float, float] = (0.0, 0.0, 0.0)  # of a number: lowest and highest value, and step
    _: KW_ONLY
    choices: tuple[str, ...] = ()  # of a text
    paper: ParameterValue | None = None  # None: the paper gives no value
    name: str = ""  # name in commands, if other than the field's
    degrees: bool = False  # shown in degrees; the field is in radians
    odd: bool = False  # only odd numbers, so that there is a middle


class Found(NamedTuple):
    """A number in a tree of parameters."""

    path: tuple[str, ...]
    default: Any
    number: Number
    slider: Slider | None

    @property
    def ours(self) -> bool:
        """True when its value is a choice of this project, or differs from the paper's."""
        return self.number.source == OWN or (self.slider is not None and self.slider.paper not in (None, self.default))


@functools.cache
def _annotations(kind: type) -> dict[str, Any]:
    return typing.get_type_hints(kind, include_extras=True)


def numbers_of(tree: Any, path: tuple[str, ...] = ()) -> Iterator[Found]:
    """Every field with a `Number` of nested parameter objects, in the order in which they are written."""
    annotations = _annotations(type(tree))
    for name, annotation in annotations.items():
        value = getattr(tree, name)
        notes = {type(each): each for each in getattr(annotation, "__metadata__", ())}
        if Number in notes:
            yield Found((*path, name), value, notes[Number], notes.get(Slider))
        if isinstance(value, msgspec.Struct) or dataclasses.is_dataclass(value):
            yield from numbers_of(value, (*path, name))


def replaced(tree: Any, path: tuple[str, ...], value: Any) -> Any:
    """A copy of nested frozen objects with one value replaced."""
    name, *rest = path
    inner = replaced(getattr(tree, name), tuple(rest), value) if rest else value
    if isinstance(tree, msgspec.Struct):
        return msgspec.structs.replace(tree, **{name: inner})
    return dataclasses.replace(tree, **{name: inner})
