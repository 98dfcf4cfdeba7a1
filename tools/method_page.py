"""Write the tables of methods in docs/method.md, and those of numbers in docs/parameters.md, from the code.

    .venv/bin/python tools/method_page.py [--check]

With --check nothing is written, and the exit code is 1 when something would be. A table stands between a line
``<!-- methods -->``, ``<!-- numbers of FILE:CLASS -->`` or ``<!-- numbers of FILE -->`` and a line ``<!-- end -->``.
Those of a class are its fields with a `Number`, or, of a class without any, all fields and the comments beside them.
Without a class the numbers are the constants of the file that have a comment beside them.
"""

import argparse
import ast
import importlib
import io
import re
import sys
import tokenize
import typing
from pathlib import Path

from motm_twin.control.method import Method
from motm_twin.methods.registry import METHODS
from motm_twin.model.number import Number

ROOT = Path(__file__).resolve().parents[1]
METHOD, PARAMETERS = ROOT / "docs" / "method.md", ROOT / "docs" / "parameters.md"
PAGES = (METHOD, PARAMETERS)
BLOCK = re.compile(r"(<!-- (methods|numbers of ([^\s:]+)(?::(\w+))?) -->\n).*?(<!-- end -->\n)", re.S)


def wanted(page: str) -> str:
    """The page with its tables as they should be."""
    return BLOCK.sub(_block, page)


def _block(match: re.Match[str]) -> str:
    table = methods_table() if match[2] == "methods" else numbers_table(match[3], match[4])
    return f"{match[1]}\n{table}\n{match[5]}"


def methods_table() -> str:
    """One row for each method: what it does, where it comes from, and parameters other than those of `motm`."""
    lines = ["| method | what it does | source | parameters |", "|---|---|---|---|"]
    return "\n".join([*lines, *(_method(method) for method in METHODS.values())]) + "\n"


def _method(method: Method) -> str:
    other = ", ".join(f"`{name}` {_value(value)}" for name, value in method.parameters.items())
    said = f"**{_literal(method.title)}.** {_literal(method.summary)}"
    return _row(f"`{method.name}`", said, _literal(method.source), other)


def _literal(text: str) -> str:
    """The text with its stars, which Markdown would take for emphasis (STAA*)."""
    return text.replace("*", r"\*")


def _value(value: float | str | bool) -> str:
    if isinstance(value, bool):
        return "on" if value else "off"
    return value if isinstance(value, str) else f"{value:g}"


def numbers_table(file: str, name: str | None) -> str:
    """One row for each field of a class, or constant of a file: its value, and what is said of it."""
    source = (ROOT / file).read_text(encoding="utf-8")
    module = ast.parse(source)
    if name is None:
        return _commented(_constants(module), comments_of(source), every=False)
    fields = _fields(module, name, file)
    meanings = _meanings(file, name)
    return _annotated(fields, meanings) if meanings else _commented(fields, comments_of(source), every=True)


def _annotated(fields: list[tuple[ast.expr, ast.expr]], meanings: dict[str, Number]) -> str:
    """The table of fields that say themselves what they mean."""
    lines = ["| number | symbol | value | unit | source | reason |", "|---|---|---|---|---|---|"]
    for target, value in fields:
        said = meanings.get(ast.unparse(target))
        if said is not None:
            lines.append(_row(_plain(target), said.symbol, _plain(value), said.unit, said.source, said.reason))
    return "\n".join(lines) + "\n"


def _commented(numbers: list[tuple[ast.expr, ast.expr]], comments: dict[int, str], *, every: bool) -> str:
    """The table of numbers with comments beside them; of ``every`` one, or of those that have one."""
    lines = ["| number | value | unit, source, reason |", "|---|---|---|"]
    for target, value in numbers:
        said = [comments[k] for k in range(target.lineno, (value.end_lineno or value.lineno) + 1) if k in comments]
        if said or every:
            lines.append(_row(_plain(target), _plain(value), " ".join(said)))
    return "\n".join(lines) + "\n"


def _meanings(file: str, name: str) -> dict[str, Number]:
    """Rows of a class: its fields, and their descriptions."""
    owner = getattr(importlib.import_module(file.removesuffix(".py").replace("/", ".")), name)
    found = {}
    for field, annotation in typing.get_type_hints(owner, include_extras=True).items():
        for said in getattr(annotation, "__metadata__", ()):
            if isinstance(said, Number):
                found[field] = said
    return found


def _fields(module: ast.Module, name: str, file: str) -> list[tuple[ast.expr, ast.expr]]:
    found = [node for node in ast.walk(module) if isinstance(node, ast.ClassDef) and node.name == name]
    if not found:
        raise ValueError(f"{file} has no class {name}: put the right one into docs/parameters.md")
    fields = [node for node in found[0].body if isinstance(node, ast.AnnAssign)]
    return [(node.target, node.value) for node in fields if node.value is not None]


def _constants(module: ast.Module) -> list[tuple[ast.expr, ast.expr]]:
    return [(node.targets[0], node.value) for node in module.body if isinstance(node, ast.Assign)]


def _plain(node: ast.expr) -> str:
    """As it is written; several at once without the brackets round them."""
    return ", ".join(f"`{ast.unparse(each)}`" for each in (node.elts if isinstance(node, ast.Tuple) else [node]))


def comments_of(source: str) -> dict[int, str]:
    """Comments of Python source by line number."""
    tokens = tokenize.generate_tokens(io.StringIO(source).readline)
    return {token.start[0]: token.string.lstrip("# ") for token in tokens if token.type == tokenize.COMMENT}


def _row(*cells: str) -> str:
    return "| " + " | ".join(" ".join(cell.split()).replace("|", r"\|") for cell in cells) + " |"


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
