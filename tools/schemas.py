"""Write docs/schemas/*.json and the tables of fields in docs/zenoh.md from the types in the code.

    .venv/bin/python tools/schemas.py [--check]

A schema that does not fit what was published under its version is not written: give it a new version first. With
--check nothing is written, and the exit code is 1 when something would be.
"""

import argparse
import inspect
import json
import re
import sys
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path

from motm_twin.bus.commands import EDITS, SERVER_COMMANDS
from motm_twin.bus.ranges import ALLOWED
from motm_twin.bus.schema_rule import breaking_changes
from motm_twin.bus.schemas import MESSAGES, file_name, schema
from motm_twin.client.commanding import Commanding
from motm_twin.control.tuning import PARAMETERS
from motm_twin.model.edits import ParameterValue

ROOT = Path(__file__).resolve().parents[1]
FOLDER, PAGE = ROOT / "docs" / "schemas", ROOT / "docs" / "zenoh.md"
TABLE = re.compile(r"(<!-- fields of (\w+) -->\n).*?(<!-- end -->\n)", re.S)


def text_of(name: str) -> str:
    """The schema of a message as the text of its file."""
    return json.dumps(schema(name), indent=1, ensure_ascii=False) + "\n"


def problems(folder: Path = FOLDER) -> list[str]:
    """Why files can not be written: what breaks the promise of a version."""
    found = []
    for name, (version, _) in MESSAGES.items():
        path = folder / file_name(name)
        if path.exists():
            breaks = breaking_changes(json.loads(path.read_text(encoding="utf-8")), schema(name))
            found += [f"{version} {line}: bump the version of {name!r}" for line in breaks]
    return found


def wanted() -> dict[Path, str]:
    """What every generated file should contain."""
    files = {FOLDER / file_name(name): text_of(name) for name in MESSAGES}
    if PAGE.exists():
        page = PAGE.read_text(encoding="utf-8")
        files[PAGE] = TABLE.sub(lambda match: match[1] + table(match[2]) + match[3], page)
    return files


def table(name: str) -> str:
    """Fields of a message and the structs in it, as Markdown; or a list of "commands", "methods" or "parameters"."""
    if name == "commands":
        return commands_table()
    if name == "methods":
        return methods_table()
    if name == "parameters":
        return parameters_table()
    made = schema(name)
    root = made["$ref"].rsplit("/", 1)[-1]
    parts = [f"`{made['$id']}`\n\n{_fields(made['$defs'][root])}"]
    skipped = {str(kind.__name__) for kind in (*SERVER_COMMANDS, *EDITS)}
    parts += [f"\n`{part}`:\n\n{_fields(made['$defs'][part])}" for part in _reached(made, root) if part not in skipped]
    return "\n" + "".join(parts) + "\n"


def commands_table() -> str:
    """One row for each command."""
    lines = ["", "| command | fields (those in brackets may be left out) | what it does |", "|---|---|---|"]
    for kind in (*SERVER_COMMANDS, *EDITS):
        name = str(kind.__struct_config__.tag)
        part = schema(f"cmd/{name}")["$defs"][kind.__name__]
        required = part.get("required", [])
        fields = "<br>".join(
            _field(name, field, about) if field in required else f"[{_field(name, field, about)}]"
            for field, about in part["properties"].items()
            if field != "type"
        )
        first = " ".join((kind.__doc__ or "").strip().split("\n\n")[0].split())
        lines.append(f"| `{name}` | {fields} | {first} |")
    return "\n".join(lines) + "\n\n"


def _field(command: str, field: str, about: dict) -> str:
    """A field of a command: its type, what is taken when it is left out, what is allowed, and what it means."""
    default = f" = {json.dumps(about['default'])}" if "default" in about else ""
    notes = (ALLOWED.get((command, field), ""), about.get("description", "").replace(" | ", ", "))
    said = "; ".join(note for note in notes if note)
    return f"`{field}` {_type(about)}{default}{': ' + said if said else ''}"


def methods_table() -> str:
    """One row for each command: how it is called in Python."""
    called = defaultdict(list)
    for name, method in vars(Commanding).items():
        if sent := re.search(r"self\.send\((\w+)\(", inspect.getsource(method) if inspect.isfunction(method) else ""):
            called[sent[1]].append(f"`{name}{_arguments(method)}`")
    lines = ["", "| command | in Python |", "|---|---|"]
    for kind in (*SERVER_COMMANDS, *EDITS):
        lines.append(f"| `{kind.__struct_config__.tag}` | {', '.join(called[kind.__name__])} |")
    return "\n".join(lines) + "\n\n"


def _arguments(method: Callable) -> str:
    """The arguments of a method and what they are when they are left out, without their types."""
    whole = inspect.signature(method)
    plain = [each.replace(annotation=each.empty) for name, each in whole.parameters.items() if name != "self"]
    return str(inspect.Signature(plain))


def parameters_table() -> str:
    """One row for each parameter of `set_parameter`."""
    lines = ["", "| name | what | allowed | default | unit | paper |", "|---|---|---|---|---|---|"]
    for entry in PARAMETERS:
        values = {"switch": "true, false", "choice": ", ".join(entry.choices)}
        kind = ", odd" if entry.odd else ", whole" if entry.whole else ""
        allowed = values.get(entry.kind, f"{entry.low:g} to {entry.high:g}{kind}")
        row = (f"`{entry.name}`", entry.title, allowed, _value(entry.default), entry.unit, _value(entry.paper))
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines) + "\n\n"


def _value(value: ParameterValue | None) -> str:
    if value is None or isinstance(value, bool):
        return "" if value is None else str(value).lower()
    return value if isinstance(value, str) else f"{value:g}"


def _reached(made: dict, root: str) -> list[str]:
    """Names of the structs that a message is made of, in the order in which they are met."""
    found: list[str] = []
    waiting = [root]
    while waiting:
        text = json.dumps(made["$defs"][waiting.pop(0)])
        for name in re.findall(r"#/\$defs/(\w+)", text):
            if name not in found and name != root:
                found.append(name)
                waiting.append(name)
    return found


def _fields(part: dict) -> str:
    lines = ["| field | type | meaning |", "|---|---|---|"]
    for field, about in part.get("properties", {}).items():
        meaning = about.get("description", "").replace("|", "\\|")
        lines.append(f"| `{field}` | {_type(about)} | {meaning} |")
    return "\n".join(lines) + "\n"


def _type(about: dict) -> str:
    if "$ref" in about:
        return str(about["$ref"]).rsplit("/", 1)[-1]
    if "anyOf" in about:
        options = [_type(option) for option in about["anyOf"]]
        return " or ".join(options) if len(options) < 5 else "one of the edits"
    if "enum" in about:
        return " or ".join(f'"{value}"' for value in about["enum"])
    kind = about.get("type", "any")
    if kind == "array" and isinstance(about.get("items"), dict):
        return f"list of {_type(about['items'])}"
    if kind == "array" and "prefixItems" in about:
        return "[" + ", ".join(_type(item) for item in about["prefixItems"]) + "]"
    if kind == "object" and isinstance(about.get("additionalProperties"), dict):
        return f"object of {_type(about['additionalProperties'])}"
    return str(kind)


def main() -> int:
    """Write, or check; the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    if found := problems():
        print("\n".join(found), file=sys.stderr)
        return 1
    FOLDER.mkdir(parents=True, exist_ok=True)
    other = [path for path, text in wanted().items() if not path.exists() or path.read_text(encoding="utf-8") != text]
    for path in other:
        print(f"{'differs' if check else 'written'}: {path.relative_to(ROOT)}")
        if not check:
            path.write_text(wanted()[path], encoding="utf-8")
    return 1 if check and other else 0


if __name__ == "__main__":
    sys.exit(main())
