"""Write the tables of docs/zenoh.md and docs/zenoh_fields.md from the types in the code.

    .venv/bin/python tools/zenoh_page.py [--check]

A table stands between a line ``<!-- fields of NAME -->`` and a line ``<!-- end -->``: NAME is a message, or one of
keys, commands, faults, methods and parameters. With --check nothing is written, and the exit code is 1 when something
would be.
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
from motm_twin.bus.connection import PREFIX, Keys
from motm_twin.bus.schemas import MESSAGES, schema
from motm_twin.client.commanding import Commanding
from motm_twin.control.tuning import PARAMETERS
from motm_twin.model import faults
from motm_twin.model.edits import ParameterValue

ROOT = Path(__file__).resolve().parents[1]
PAGE, FIELDS_PAGE = ROOT / "docs" / "zenoh.md", ROOT / "docs" / "zenoh_fields.md"
PAGES = (PAGE, FIELDS_PAGE)
TABLE = re.compile(r"(<!-- fields of (\w+) -->\n).*?(<!-- end -->\n)", re.S)
FIELDS = frozenset(re.findall(r"<!-- fields of (\w+) -->", FIELDS_PAGE.read_text(encoding="utf-8")))


def wanted(page: str) -> str:
    """The page with its tables as they should be."""
    return TABLE.sub(lambda match: match[1] + table(match[2]) + match[3], page)


def table(name: str) -> str:
    """Fields of a message and the structs in it, as Markdown; or one of the tables of `LISTS`."""
    if name in LISTS:
        return LISTS[name]()
    made = schema(name)
    root = made["$ref"].rsplit("/", 1)[-1]
    parts = [f"`{made['$id']}`\n\n{_fields(made['$defs'][root])}"]
    skipped = {str(kind.__name__) for kind in (*SERVER_COMMANDS, *EDITS)}
    parts += [f"\n`{part}`:\n\n{_fields(made['$defs'][part])}" for part in _reached(made, root) if part not in skipped]
    return "\n" + "".join(parts) + "\n"


def keys_table() -> str:
    """One row for each key of `bus.connection.Keys`: its message, when it comes, and what it is."""
    comments = dict(re.findall(r"self\.([a-z]\w*) = f\"\{root\}/[^\"]*\"(?:  # (.+))?", inspect.getsource(Keys)))
    lines = ["", "| key | message | form, and when | what |", "|---|---|---|---|"]
    for attribute, comment in comments.items():
        key = getattr(Keys(), attribute).removeprefix(f"{PREFIX}/{Keys().twin}/")
        version, kind = MESSAGES.get("command" if attribute == "commands" else key, ("", None))
        where = f"[{version}](zenoh_fields.md#{key})" if version and key in FIELDS else version
        lines.append(f"| `{key}` | {where} | {comment} | {_first(kind)} |")
    return "\n".join(lines) + "\n\n"


def faults_table() -> str:
    """One row for each kind of fault."""
    return f"\n{faults.table().strip()}\n\n"


def commands_table() -> str:
    """One row for each command."""
    lines = ["", "| command | fields (those in brackets may be left out) | what it does |", "|---|---|---|"]
    for kind in (*SERVER_COMMANDS, *EDITS):
        name = str(kind.__struct_config__.tag)
        part = schema(f"cmd/{name}")["$defs"][kind.__name__]
        required = part.get("required", [])
        fields = "<br>".join(
            _field(field, about) if field in required else f"[{_field(field, about)}]"
            for field, about in part["properties"].items()
            if field != "type"
        )
        lines.append(f"| `{name}` | {fields} | {_first(kind)} |")
    return "\n".join(lines) + "\n\n"


def _first(kind: type | None) -> str:
    """First paragraph of a docstring, in one line."""
    return " ".join(((kind and kind.__doc__) or "").strip().split("\n\n")[0].split())


def _field(field: str, about: dict) -> str:
    """A field of a command: its type, its default, what is allowed, and what it means."""
    default = f" = {json.dumps(about['default'])}" if "default" in about else ""
    said = about.get("description", "").replace(" | ", ", ")
    return f"`{field}` {_type(about)}{default}{': ' + said if said else ''}"


def methods_table() -> str:
    """One row for each command: how it is called in Python."""
    called = defaultdict(list)
    for name, method in vars(Commanding).items():
        source = inspect.getsource(method) if inspect.isfunction(method) else ""
        if sent := re.search(r"self\.send\(commands\.(\w+)\(", source):
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


LISTS: dict[str, Callable[[], str]] = {
    "keys": keys_table,
    "commands": commands_table,
    "faults": faults_table,
    "methods": methods_table,
    "parameters": parameters_table,
}


def main() -> int:
    """Write, or check; the exit code."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    texts = {path: path.read_text(encoding="utf-8") for path in PAGES}
    other = [path for path, text in texts.items() if wanted(text) != text]
    for path in other:
        print(f"{'differs' if check else 'written'}: {path.relative_to(ROOT)}")
        if not check:
            path.write_text(wanted(texts[path]), encoding="utf-8")
    return 1 if check and other else 0


if __name__ == "__main__":
    sys.exit(main())
