"""Write docs/schemas/*.json from the types in the code. The tables of docs/zenoh.md: tools/zenoh_page.py.

    .venv/bin/python tools/schemas.py [--check]

A schema that does not fit what was published under its version is not written: give it a new version first. With
--check nothing is written, and the exit code is 1 when something would be.
"""

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from motm_twin.bus.schemas import MESSAGES, PLANT_MESSAGES, file_name, schema

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / "docs" / "schemas"
PUBLISHED = (*MESSAGES, *PLANT_MESSAGES)
Schema = dict[str, Any]
WORDS = {"description", "title", "$schema", "$id"}  # annotations without effect on validity
COMPARED = {"properties", "required", "$defs", "anyOf", "enum", "items", "prefixItems", "discriminator"}


def text_of(name: str) -> str:
    """The schema of a message as the text of its file."""
    return json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"


def problems(folder: Path = FOLDER) -> list[str]:
    """Why files can not be written: what breaks the promise of a version."""
    found = []
    for name in PUBLISHED:
        path = folder / file_name(name)
        if path.exists():
            breaks = breaking_changes(json.loads(path.read_text(encoding="utf-8")), schema(name))
            found += [f"{schema(name)['$id']} {line}: bump the version of {name!r}" for line in breaks]
    return found


def wanted() -> dict[Path, str]:
    """Contents that every generated file should have."""
    return {FOLDER / file_name(name): text_of(name) for name in PUBLISHED}


def breaking_changes(old: Schema, new: Schema, place: str = "") -> list[str]:
    """Changes from ``old`` to ``new`` that need another version, one sentence each; [] when there are none."""
    problems = _by_name(old, new, "$defs", place) + _by_name(old, new, "properties", place) + _required(old, new, place)
    problems += _options(old, new, place) + _enum(old, new, place) + _items(old, new, place)
    for word in sorted((old.keys() | new.keys()) - WORDS - COMPARED):
        before, after = old.get(word), new.get(word)
        if word == "default" and isinstance(before, dict) and isinstance(after, dict):
            after = {name: value for name, value in after.items() if name in before}  # the others are of added fields
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
    """Kinds of a union: structs may be added, other types not (a number does not become null)."""
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


def main() -> int:
    """Write, or check; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    if found := problems():
        print("\n".join(found), file=sys.stderr)
        return 1
    (FOLDER / "plant").mkdir(parents=True, exist_ok=True)
    other = [path for path, text in wanted().items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in other:
        print(f"{'differs' if check else 'written'}: {path.relative_to(ROOT)}")
        if not check:
            path.write_text(wanted()[path], encoding="utf-8")
    return 1 if check and other else 0


if __name__ == "__main__":
    sys.exit(main())
