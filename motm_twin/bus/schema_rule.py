"""Which changes of a schema its version allows: a field or a kind may be added; nothing may go or become another type.

What a program wrote for one version goes on working: it reads every field that it knows, and the server takes every
command that it sends. So a field that is added to a command must not be required.
"""

from typing import Any

Schema = dict[str, Any]
_WORDS = {"description", "title", "$schema", "$id"}  # say something, allow or forbid nothing
_COMPARED = {"properties", "required", "$defs", "anyOf", "enum", "items", "prefixItems", "discriminator"}


def breaking_changes(old: Schema, new: Schema, place: str = "") -> list[str]:
    """What of ``new`` does not fit ``old`` under the same version, one sentence each; [] when all does."""
    problems = _by_name(old, new, "$defs", place) + _by_name(old, new, "properties", place) + _required(old, new, place)
    problems += _options(old, new, place) + _enum(old, new, place) + _items(old, new, place)
    for word in sorted((old.keys() | new.keys()) - _WORDS - _COMPARED):
        before, after = old.get(word), new.get(word)
        if isinstance(before, dict) and isinstance(after, dict):
            problems += breaking_changes(before, after, f"{place}/{word}")
        elif before != after:
            problems.append(f"{place or '/'}: {word!r} was {before!r} and is {after!r}")
    return problems


def _by_name(old: Schema, new: Schema, word: str, place: str) -> list[str]:
    problems, now = [], new.get(word, {})
    for name, part in old.get(word, {}).items():
        if name in now:
            problems += breaking_changes(part, now[name], f"{place}/{name}")
        else:
            problems.append(f"{place}/{name}: was removed")
    return problems


def _required(old: Schema, new: Schema, place: str) -> list[str]:
    known, before, after = set(old.get("properties", {})), set(old.get("required", [])), set(new.get("required", []))
    problems = [f"{place}/{name}: was always there, and is no more" for name in sorted(before - after)]
    problems += [f"{place}/{name}: was optional, and is required" for name in sorted((after - before) & known)]
    if new.get("additionalProperties") is False:  # strictly read by us: others send it
        added = sorted(after - known) if "properties" in old else []
        problems += [f"{place}/{name}: was added as a required field of what programs send" for name in added]
    return problems


def _options(old: Schema, new: Schema, place: str) -> list[str]:
    """Kinds of a union: further structs may be added, other types not (a number does not become null)."""
    before, after = old.get("anyOf", []), new.get("anyOf", [])
    if not before and not after:
        return []
    problems = [f"{place}: no longer {_shown(option)}" for option in before if option not in after]
    if not before:
        return [f"{place}: became one of several types"]
    problems += [
        f"{place}: may now be {_shown(option)}" for option in after if option not in before and "$ref" not in option
    ]
    return problems


def _enum(old: Schema, new: Schema, place: str) -> list[str]:
    if ("enum" in old) != ("enum" in new):
        return [f"{place}: became {'one of a list' if 'enum' in new else 'free'}"]
    return [f"{place}: no longer {value!r}" for value in old.get("enum", []) if value not in new["enum"]]


def _items(old: Schema, new: Schema, place: str) -> list[str]:
    problems = []
    if isinstance(old.get("items"), dict) and isinstance(new.get("items"), dict):
        problems += breaking_changes(old["items"], new["items"], f"{place}[]")
    elif old.get("items") != new.get("items"):
        problems.append(f"{place}: its items were {old.get('items')!r} and are {new.get('items')!r}")
    before, after = old.get("prefixItems", []), new.get("prefixItems", [])
    if len(before) != len(after):
        return [*problems, f"{place}: had {len(before)} items and has {len(after)}"]
    for number, (one, other) in enumerate(zip(before, after, strict=True)):
        problems += breaking_changes(one, other, f"{place}[{number}]")
    return problems


def _shown(option: Schema) -> str:
    return str(option.get("$ref", option.get("type", option))).rsplit("/", 1)[-1]
