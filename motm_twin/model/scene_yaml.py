"""YAML text to a tree whose every value knows its file, line and place; only the harmless part of YAML is read.

No tags, anchors, aliases or merge keys; every key is text and may appear once. Plain values follow YAML 1.2: ``yes``
is text and ``1e-3`` is a number.
"""

import dataclasses
import re
from collections.abc import Iterator
from typing import Any

import yaml

from motm_twin.model.scene_error import SceneError

MAX_BYTES = 1 << 20
MAX_DEPTH = 24
MAX_VALUES = 100_000
MAX_KEY = 80

_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)  # only its parser is used, never its constructors
_INT = re.compile(r"[-+]?[0-9]+")
_FLOAT = re.compile(r"[-+]?(\.[0-9]+|[0-9]+(\.[0-9]*)?)([eE][-+]?[0-9]+)?")
_WORDS = {"": None, "~": None, "null": None, "true": True, "false": False}
_NOT_FINITE = {".nan": "nan", ".inf": "inf", "+.inf": "inf", "-.inf": "-inf"}


@dataclasses.dataclass(frozen=True)
class Node:
    """A value of the file: a scalar, a list of nodes or a mapping of nodes, and where it stands."""

    value: Any
    file: str
    line: int
    place: str

    def error(self, problem: str) -> SceneError:
        """An error about this value that names its place."""
        return SceneError(problem, file=self.file, line=self.line, place=self.place)

    def plain(self) -> Any:
        """The value without places."""
        if isinstance(self.value, dict):
            return {key: node.plain() for key, node in self.value.items()}
        if isinstance(self.value, list):
            return [node.plain() for node in self.value]
        return self.value

    def at(self, *steps: str | int) -> "Node":
        """The node at the end of the steps, or the last one on the way that exists."""
        node = self
        for step in steps:
            if isinstance(node.value, dict) and step in node.value:
                node = node.value[step]
            elif isinstance(node.value, list) and isinstance(step, int) and step < len(node.value):
                node = node.value[step]
            else:
                break
        return node


def parse_yaml(text: str, file: str) -> Node:
    """The tree of one YAML document; raises SceneError with the line for whatever is not plain YAML."""
    try:
        reader = _Reader(yaml.parse(text, Loader=_LOADER), file)
        return reader.document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        said = " ".join(part for part in (error.context, error.problem) if part)
        line = None if mark is None else mark.line + 1
        raise SceneError(f"not valid YAML: {said}", file=file, line=line) from error
    except yaml.YAMLError as error:
        raise SceneError(f"not valid YAML: {' '.join(str(error).split())}", file=file) from error


class _Reader:
    def __init__(self, events: Iterator[yaml.Event], file: str) -> None:
        self.events, self.file, self.count = events, file, 0

    def document(self) -> Node:
        next(self.events)  # start of the stream
        if isinstance(next(self.events), yaml.StreamEndEvent):
            raise SceneError("the file is empty: begin with 'format: motm-scene/1'", file=self.file)
        root = self.node(next(self.events), "", 0)
        next(self.events)  # end of the document
        after = next(self.events)
        if not isinstance(after, yaml.StreamEndEvent):
            raise self.error(after, "", "a second YAML document begins here: one file holds one scene")
        return root

    def error(self, event: yaml.Event, place: str, problem: str) -> SceneError:
        return SceneError(problem, file=self.file, line=event.start_mark.line + 1, place=place)

    def node(self, event: yaml.Event, place: str, depth: int) -> Node:
        self.guard(event, place, depth)
        if isinstance(event, yaml.MappingStartEvent):
            value: Any = self.mapping(place, depth)
        elif isinstance(event, yaml.SequenceStartEvent):
            value = self.sequence(place, depth)
        else:
            assert isinstance(event, yaml.ScalarEvent)
            value = scalar(event.value) if not event.style else event.value
        return Node(value, self.file, event.start_mark.line + 1, place)

    def guard(self, event: yaml.Event, place: str, depth: int) -> None:
        self.count += 1
        if isinstance(event, yaml.AliasEvent) or getattr(event, "anchor", None):
            raise self.error(event, place, "YAML anchors and aliases are not allowed: write the value out")
        if tag := getattr(event, "tag", None):
            raise self.error(event, place, f"the YAML tag {tag!r} is not allowed: write plain values")
        if depth > MAX_DEPTH:
            raise self.error(event, place, f"nested deeper than {MAX_DEPTH} levels")
        if self.count > MAX_VALUES:
            raise self.error(event, place, f"more than {MAX_VALUES} values in one file: make the scene smaller")

    def mapping(self, place: str, depth: int) -> dict[str, Node]:
        entries: dict[str, Node] = {}
        while not isinstance(event := next(self.events), yaml.MappingEndEvent):
            if not isinstance(event, yaml.ScalarEvent):
                self.guard(event, place, depth)
                raise self.error(event, place, "a key must be plain text")
            self.guard(event, place, depth)
            key = event.value
            if len(key) > MAX_KEY:
                raise self.error(event, place, f"a key of {len(key)} characters: at most {MAX_KEY}")
            inner = f"{place}.{key}" if place else key
            if key in entries:
                first = entries[key].line
                raise self.error(event, inner, f"appears twice (first in line {first}): rename or remove one")
            entries[key] = self.node(next(self.events), inner, depth + 1)
        return entries

    def sequence(self, place: str, depth: int) -> list[Node]:
        items: list[Node] = []
        while not isinstance(event := next(self.events), yaml.SequenceEndEvent):
            items.append(self.node(event, f"{place}[{len(items)}]", depth + 1))
        return items


def scalar(text: str) -> Any:
    """The value of an unquoted scalar, after the core rules of YAML 1.2."""
    low = text.lower()
    if low in _WORDS:
        return _WORDS[low]
    if low in _NOT_FINITE:
        return float(_NOT_FINITE[low])
    if _INT.fullmatch(text):
        return int(text) if len(text) < 20 else float(text)
    if _FLOAT.fullmatch(text):
        return float(text)
    return text
