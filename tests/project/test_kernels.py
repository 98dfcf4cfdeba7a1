"""Kernels that are made for other kernels only are called by them only: a call from Python would crash."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
FOLDERS = ("motm_twin", "tests", "tools", "examples")
FILES = [path for folder in FOLDERS for path in sorted((ROOT / folder).rglob("*.py"))]
INNER = {"inner", "inlined"}
COMPILED = {*INNER, "njit", "kernel", "overload", "vectorize", "register_jitable"}


def decorators(function: ast.FunctionDef) -> set[str]:
    names = [each.func if isinstance(each, ast.Call) else each for each in function.decorator_list]
    return {each.id for each in names if isinstance(each, ast.Name)}


def inner_kernels(tree: ast.Module) -> set[str]:
    return {node.name for node in tree.body if isinstance(node, ast.FunctionDef) and decorators(node) & INNER}


def read_by_python(node: ast.AST) -> Iterator[str]:
    """Names that are read outside of kernels."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.FunctionDef) and decorators(child) & COMPILED:
            continue
        if isinstance(child, ast.Name) and isinstance(child.ctx, ast.Load):
            yield child.id
        yield from read_by_python(child)


def calls_from_python(trees: dict[str, ast.Module]) -> list[str]:
    kernels = {module: inner_kernels(tree) for module, tree in trees.items()}
    found = []
    for module, tree in trees.items():
        known = {name: name for name in kernels[module]}
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module in kernels:
                theirs = kernels[node.module]
                known |= {each.asname or each.name: each.name for each in node.names if each.name in theirs}
        found += [f"{module}: {known[name]}" for name in read_by_python(tree) if name in known]
    return found


def module_of(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts)


def test_python_calls_no_kernel_that_only_kernels_can_call() -> None:
    trees = {module_of(path): ast.parse(path.read_text()) for path in FILES}
    assert any(inner_kernels(tree) for tree in trees.values())
    assert calls_from_python(trees) == []


def test_such_a_call_is_found() -> None:
    one = ast.parse("@inner\ndef f(x):\n    return x\n\n@njit\ndef g(x):\n    return f(x)\n")
    other = ast.parse("from one import f\n\ndef h():\n    return f(1)\n")
    assert calls_from_python({"one": one}) == []
    assert calls_from_python({"one": one, "other": other}) == ["other: f"]
