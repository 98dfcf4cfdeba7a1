"""YAML text to a tree whose every value knows its file, line and place, and checks of its types.

Only the harmless part of YAML is read: no tags, anchors, aliases or merge keys; every key is text and may appear once.
Plain values follow YAML 1.2: ``yes`` is text and ``1e-3`` is a number. The tree is walked along the types of
``scene_format.py``: msgspec would refuse the same values; this walk tells their place, what is allowed, and which
key was probably meant.
"""

import dataclasses
import functools
import math
import operator
import re
from collections.abc import Iterator
from types import NoneType
from typing import Any

import yaml
from msgspec import inspect

from motm_twin.model.names import SceneError, hint
from motm_twin.model.scene_format import COLOURS

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
    """A value of the file: a scalar, a list of nodes or a mapping of nodes; with its place in the file."""

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
    """The tree of one YAML document; raises SceneError with the line for anything else than plain YAML."""
    try:
        reader = _Reader(yaml.parse(text, Loader=_LOADER), file)
        return reader.document()
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        message = " ".join(part for part in (error.context, error.problem) if part)
        line = None if mark is None else mark.line + 1
        raise SceneError(f"not valid YAML: {message}", file=file, line=line) from error
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
    """The value of an unquoted scalar by the core schema of YAML 1.2."""
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


UNITS = {"deg": "degrees", "mps": "m/s", "dps": "deg/s", "mps2": "m/s^2", "dps2": "deg/s^2", "hz": "Hz"}
_NAMED_TYPE = {
    inspect.FloatType: "a number",
    inspect.IntType: "a whole number",
    inspect.StrType: "text",
    inspect.BoolType: "true or false",
    inspect.TupleType: "a list",
    inspect.VarTupleType: "a list",
    inspect.DictType: "a mapping of names",
    inspect.StructType: "a mapping",
    inspect.NoneType: "null",
}
_SHOWN = 60


def check_types(node: Node, struct: type) -> None:
    """Raise SceneError at the first value of the tree that does not fit the struct."""
    _check(node, _type_info(struct))


_type_info = functools.cache(inspect.type_info)  # walks the annotations of all structs, each time


def show(value: Any) -> str:
    """A value for a message: quoted, short, without nested values."""
    if value is None:
        return "nothing"
    if isinstance(value, dict):
        return "a mapping"
    if isinstance(value, list):
        return f"a list of {len(value)}"
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _SHOWN else text[:_SHOWN] + "..."


def _check(node: Node, info: Any) -> None:
    if isinstance(info, inspect.Metadata):
        _check(node, info.type)
    elif isinstance(info, inspect.UnionType):
        _check_union(node, info)
    elif isinstance(info, inspect.StructType):
        _check_struct(node, info)
    elif isinstance(info, inspect.DictType):
        _check_dict(node, info)
    elif isinstance(info, (inspect.TupleType, inspect.VarTupleType)):
        _check_list(node, info)
    elif isinstance(info, inspect.LiteralType):
        if not isinstance(node.value, str) or node.value not in info.values:
            raise node.error(f"{show(node.value)} is not allowed; {hint(str(node.value), map(str, info.values))}")
    else:
        _check_scalar(node, info)


def _expect(node: Node, kind: type, info: Any) -> None:
    if not isinstance(node.value, kind):
        raise node.error(f"expected {_NAMED_TYPE[type(info)]}, got {show(node.value)}")


def _check_scalar(node: Node, info: Any) -> None:
    value = node.value
    expected = {inspect.NoneType: NoneType, inspect.BoolType: bool, inspect.StrType: str}.get(type(info), (int, float))
    if not isinstance(value, expected) or (isinstance(value, bool) and expected is not bool):
        raise node.error(f"expected {_NAMED_TYPE[type(info)]}, got {show(value)}{_advice(value, info)}")
    if isinstance(info, inspect.StrType):
        _check_text(node, info)
    elif isinstance(info, (inspect.FloatType, inspect.IntType)):
        _check_number(node, info)


def _advice(value: Any, info: Any) -> str:
    if isinstance(info, inspect.StrType) and isinstance(value, (int, float)):
        return ": put it in quotes, if it is a name it must begin with a letter"
    if isinstance(info, inspect.FloatType) and isinstance(value, str):
        return ": write the bare number; the unit is fixed by the key"
    return ""


def _check_text(node: Node, info: inspect.StrType) -> None:
    text = node.value
    if info.pattern and not re.fullmatch(info.pattern.strip("^$"), text):
        raise node.error(f"{show(text)} is not allowed here: {_pattern_words(info.pattern, text)}")
    if not (info.min_length or 0) <= len(text) <= (info.max_length or len(text)):
        raise node.error(f"needs {info.min_length or 0} to {info.max_length} characters, got {len(text)}")


def _pattern_words(pattern: str, text: str) -> str:
    if "#" in pattern:
        return f"a colour is a lower-case name or '#rrggbb'; {hint(text, COLOURS)}"
    return "a name begins with a letter and goes on with letters, digits, _ or -, at most 40"


def _check_number(node: Node, info: Any) -> None:
    value = node.value
    if not math.isfinite(value):
        raise node.error(f"{value} is not a usable number: write a finite one")
    if isinstance(info, inspect.IntType) and isinstance(value, float):
        advice = ": write it without a point" if value.is_integer() else ""
        raise node.error(f"expected a whole number, got {value}{advice}")
    bounds = ((info.gt, ">", operator.gt), (info.ge, ">=", operator.ge))
    bounds += ((info.lt, "<", operator.lt), (info.le, "<=", operator.le))
    if not all(limit is None or keeps(value, limit) for limit, _, keeps in bounds):
        allowed = " and ".join(f"{sign} {limit:g}" for limit, sign, _ in bounds if limit is not None)
        raise node.error(f"must be {allowed}, got {value:g}")


def _check_list(node: Node, info: Any) -> None:
    _expect(node, list, info)
    count = len(node.value)
    if isinstance(info, inspect.TupleType):
        if count != len(info.item_types):
            raise node.error(f"needs exactly {len(info.item_types)} values, got {count}")
        types = info.item_types
    else:
        _check_length(node, info)
        types = (info.item_type,) * count
    for item, item_type in zip(node.value, types, strict=True):
        _check(item, item_type)


def _check_length(node: Node, info: Any) -> None:
    count = len(node.value)
    if info.min_length is not None and count < info.min_length:
        raise node.error(f"needs at least {info.min_length} entries, got {count}")
    if info.max_length is not None and count > info.max_length:
        raise node.error(f"too many entries: at most {info.max_length}, got {count}")


def _check_dict(node: Node, info: inspect.DictType) -> None:
    _expect(node, dict, info)
    _check_length(node, info)
    pattern = getattr(info.key_type, "pattern", None) or ".*"
    for key, item in node.value.items():
        if not re.fullmatch(pattern.strip("^$"), key):
            raise item.error(f"the name {show(key)} is not allowed: {_pattern_words(pattern, key)}")
        _check(item, info.value_type)


def _check_union(node: Node, info: inspect.UnionType) -> None:
    if node.value is None and any(isinstance(kind, inspect.NoneType) for kind in info.types):
        return
    kinds = [kind for kind in info.types if not isinstance(kind, inspect.NoneType)]
    tagged = [kind for kind in kinds if isinstance(kind, inspect.StructType) and kind.tag is not None]
    if tagged:
        _check_tagged(node, tagged)
        return
    bare = [kind.type if isinstance(kind, inspect.Metadata) else kind for kind in kinds]
    expected = {dict: inspect.StructType, list: inspect.VarTupleType}.get(type(node.value))
    chosen = [kind for kind in bare if expected is not None and isinstance(kind, expected)]
    other = [kind for kind in bare if not isinstance(kind, (inspect.StructType, inspect.VarTupleType))]
    _check(node, (chosen or other or bare)[0])


def _check_tagged(node: Node, kinds: list[Any]) -> None:
    _expect(node, dict, kinds[0])
    field, tags = kinds[0].tag_field, {kind.tag: kind for kind in kinds}
    if field not in node.value:
        raise node.error(f"the key '{field}' is missing: one of {', '.join(tags)}")
    tag = node.value[field]
    if not isinstance(tag.value, str) or tag.value not in tags:
        raise tag.error(f"{show(tag.value)} is not a {field}; {hint(str(tag.value), tags)}")
    _check_struct(node, tags[tag.value])


def _check_struct(node: Node, info: inspect.StructType) -> None:
    _expect(node, dict, info)
    fields = {field.encode_name: field for field in info.fields}
    for key, item in node.value.items():
        if key == info.tag_field:
            continue
        if key not in fields:
            raise item.error(_unknown_key(key, list(fields)))
        _check(item, fields[key].type)
    for key, field in fields.items():
        if field.required and key not in node.value:
            raise node.error(f"the key '{key}' is missing")


def _unknown_key(key: str, known: list[str]) -> str:
    stem, _, ending = key.rpartition("_")
    for name in known:
        base, _, unit = name.rpartition("_")
        if unit in UNITS and key == base:
            return f"missing unit: write '{name}' ({UNITS[unit]})"
        if unit in UNITS and stem == base and ending != unit:
            return f"wrong unit '{ending}': write '{name}' ({UNITS[unit]})"
        if stem == name and ending in ("m", "cm", "mm", "s", "ms", "in"):
            return f"wrong unit '{ending}': write '{name}'; lengths are in m and times in s"
    return f"unknown key '{key}'; {hint(key, known)}"
