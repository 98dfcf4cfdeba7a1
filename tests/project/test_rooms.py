"""The rooms of the package and the one-way arrows between them, read from the imports of every file."""

import ast
import sys
import tomllib
from functools import cache
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from sources import FILES, PACKAGE, ROOT, tree

METHOD_ROOMS = {"control", "planning", "perception", "model"}
ROOMS_SEEN_BY = {
    "model": set(),
    "sim": {"model"},
    "physics": {"sim", "model"},
    "generate": {"model"},
    "perception": {"model"},
    "planning": {"perception", "model"},
    "control": {"planning", "perception", "model"},
    "rivals": METHOD_ROOMS,
    "methods": {"rivals", *METHOD_ROOMS},
    "measures": METHOD_ROOMS,
    "sessions": {"methods", *METHOD_ROOMS},
    "bus": {"sessions", "sim", "methods", *METHOD_ROOMS},
    "client": {"bus", "methods", *METHOD_ROOMS},
    "external": {"bus", "sim", *METHOD_ROOMS},
    "record": {"client", "bus", "sessions", "methods", *METHOD_ROOMS},
    "perf": {"ui", "record", "sessions", "external", "bus", "methods", *METHOD_ROOMS},
    "studies": {
        "perf",
        "ui",
        "record",
        "sessions",
        "external",
        "bus",
        "methods",
        "measures",
        "generate",
        *METHOD_ROOMS,
    },
}
OF_EXTRAS = {"physics": {"mujoco"}}  # rooms that are imported only where an extra is installed
NO_CLOCK_NO_WIRE = {"viser", "zenoh", "time", "random", "datetime", "secrets", "uuid", "threading", "asyncio", "socket"}


@cache
def imports(path: Path) -> frozenset[str]:
    """Every module that a file imports, by its absolute dotted name, imports inside functions included."""
    package = [PACKAGE.name, *path.relative_to(PACKAGE).parent.parts]
    found: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(package[: len(package) - node.level + 1]) if node.level else ""
            module = ".".join(part for part in (base, node.module) if part)
            found.add(module)
            found.update(f"{module}.{alias.name}" for alias in node.names)
    return frozenset(found)


def rooms_imported(path: Path) -> set[str]:
    parts = [name.split(".") for name in imports(path)]
    return {part[1] for part in parts if part[0] == "motm_twin" and len(part) > 1 and (PACKAGE / part[1]).is_dir()}


def files_of(room: str) -> list[Path]:
    return sorted((PACKAGE / room).rglob("*.py"))


@pytest.mark.parametrize("room", ROOMS_SEEN_BY)
def test_a_room_imports_only_the_rooms_below_it(room: str):
    for path in files_of(room):
        assert rooms_imported(path) <= ROOMS_SEEN_BY[room] | {room}, path.relative_to(ROOT)


@pytest.mark.parametrize("room", ["planning", "control"])
def test_planning_and_control_know_no_wire_no_page_and_no_clock(room: str):
    for path in files_of(room):
        tops = {name.split(".")[0] for name in imports(path)}
        assert not tops & NO_CLOCK_NO_WIRE, path.relative_to(ROOT)


@pytest.mark.parametrize("room", ["model", "perception", "planning", "control", "sim", "physics"])
def test_the_loop_has_no_global_random_state(room: str):
    for path in files_of(room):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute):
                drawn_from_global = node.value.attr == "random" and node.attr not in {
                    "default_rng",
                    "Generator",
                    "SeedSequence",
                    "PCG64",
                    "BitGenerator",
                }
                assert not drawn_from_global, f"{path.relative_to(ROOT)}:{node.lineno}"


def test_the_referee_shares_no_code_with_what_it_judges():
    judges = [path for path in FILES if "referee" in path.name or "referee" in path.parent.name]
    assert judges, "there is no referee"
    seen, queue = set(judges), list(judges)
    while queue:  # what the referee imports, and what that imports in turn
        for name in imports(queue.pop()):
            path = ROOT.joinpath(*name.split(".")).with_suffix(".py")
            if name.startswith("motm_twin.") and path.is_file() and path not in seen:
                seen.add(path)
                queue.append(path)
    rooms = {path.relative_to(PACKAGE).parts[0] for path in seen}
    assert not rooms & {"perception", "planning", "control"}


def room_of(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and (PACKAGE / parts[1]).is_dir() else ""


@cache
def graph() -> dict[str, set[str]]:
    """Modules of the package, and those that each imports."""
    names = {".".join((PACKAGE.name, *path.relative_to(PACKAGE).with_suffix("").parts)): path for path in FILES}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    return {name: {other for other in imports(path) if other in names} - {name} for name, path in names.items()}


def test_no_two_rooms_import_each_other():
    arrows = {(room_of(name), room_of(other)) for name, others in graph().items() for other in others}
    assert not [(one, other) for one, other in arrows if one and one < other and (other, one) in arrows]


def test_no_files_import_each_other_in_a_circle():
    assert not [name for name in graph() if name in reached_from(name)]


NAMED_TUPLE = {"_replace", "_asdict", "_fields"}


@pytest.mark.parametrize("room", ["planning", "control", "rivals", "methods"])
def test_no_class_reaches_a_protected_member_of_another(room: str):
    """But for `_state`, which a `Stateful` is for: variation is a value that is handed in, not a method overridden."""
    for path in files_of(room):
        for node in ast.walk(tree(path)):
            if isinstance(node, ast.Attribute) and protected(node.attr) and not of_self(node):
                raise AssertionError(f"{path.relative_to(ROOT)}:{node.lineno}: {ast.unparse(node)}")
        for each in ast.walk(tree(path)):
            if isinstance(each, ast.ClassDef):
                attributes = [node for node in ast.walk(each) if isinstance(node, ast.Attribute) and of_self(node)]
                own = {one.name for one in each.body if isinstance(one, ast.FunctionDef)} | {"_state"}
                own |= {node.attr for node in attributes if isinstance(node.ctx, ast.Store)}
                inherited = {node.attr for node in attributes if protected(node.attr)} - own
                assert not inherited, f"{path.relative_to(ROOT)}: {each.name} reaches {inherited} of its base class"


def protected(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__") and name not in NAMED_TUPLE


def of_self(node: ast.Attribute) -> bool:
    return isinstance(node.value, ast.Name) and node.value.id in ("self", "cls")


def reached_from(name: str) -> set[str]:
    """Modules that a module imports, and those that they import."""
    seen, queue = set(), [name]
    while queue:
        new = graph()[queue.pop()] - seen
        seen |= new
        queue += new
    return seen


def library(requirement):
    return requirement.split("[")[0].split(">")[0].split("=")[0].strip().lower()


@cache
def imports_at_start(path):
    """Names of modules imported when the file itself is; imports inside functions are for who has the extra."""
    nodes = tree(path).body
    found = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    found |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module}
    return {name.split(".")[0] for name in found}


@pytest.mark.parametrize("room", OF_EXTRAS)
def test_a_room_that_needs_an_extra_is_imported_by_no_other(room: str):
    for path in FILES:
        if path.relative_to(PACKAGE).parts[0] != room:
            assert room not in rooms_imported(path), path.relative_to(ROOT)


def test_every_library_that_the_package_imports_is_declared():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    declared = {library(one) for one in project["dependencies"]}
    extra = {library(one) for one in project["optional-dependencies"]["dev"]}
    of_module = packages_distributions()
    # pin brings these modules; its distributions are named otherwise
    provided_by = {"pinocchio": "pin", "coal": "pin", "eigenpy": "pin", "zenoh": "eclipse-zenoh"}
    missing = {}
    for path in FILES:
        for name in imports(path):
            top = name.split(".")[0]
            if top in sys.stdlib_module_names or top == "motm_twin":
                continue
            names = {provided_by[top]} if top in provided_by else {one.lower() for one in of_module.get(top, [top])}
            if top in OF_EXTRAS.get(path.relative_to(PACKAGE).parts[0], ()):
                assert names & extra
                continue
            if not names & (declared if top in imports_at_start(path) else declared | extra):
                missing[top] = str(path.relative_to(ROOT))
    assert not missing
