"""Length and arguments of the functions of the package, with a list of exceptions; first words of docstrings."""

import ast

import pytest
from sources import FILES, PACKAGE, tree

MOST_LINES, MOST_ARGUMENTS = 60, 8
COMPILED = ("njit", "kernel", "inlined")  # decorators of numeric kernels

# Numeric kernels with more arguments: numba compiles them for arrays and numbers, and takes no struct. With the reason.
KERNELS: dict[str, tuple[str, tuple[str, ...]]] = {
    "control/arm/limits.py": ("rows of the program", ("approach_row",)),
    "control/arm/program.py": ("bounds of all joint rates", ("_joint_bounds",)),
    "control/arm/qp.py": ("arrays of the solver DAQP, and its answer", ("_complete", "_fill_daqp")),
    "control/predictor.py": ("joints a little later", ("_arm",)),
    "perception/scan_match.py": ("a prior, a sweep, and the map's lines", ("_measured",)),
    "perception/floor.py": ("grid, its origin and resolution, and a ray", ("mark_seen",)),
    "perception/occupancy.py": ("grid, its origin and resolution, and rays", ("clear_rays", "mark_hits")),
    "planning/bezier.py": ("two poses as cosine and sine, and the samples", ("bezier_points", "time_below")),
    "planning/braking.py": ("pose, twist, limits and field", ("can_stop", "stopping_clearance")),
    "planning/commitment.py": ("pose, twist, the kept nodes and limits", ("follow",)),
    "planning/escape.py": ("pose, twist, lattice and limits", ("follow_escape",)),
    "planning/cost_to_go.py": ("pose, sight, graph and table", ("cheapest",)),
    "planning/lattice.py": ("lattice and its queue", ("_fill",)),
    "planning/reach.py": ("nodes and the disc of the target", ("_mark_reached",)),
    "planning/rejections.py": ("candidate, field and border", ("_beyond_border", "_judge")),
    "planning/staa.py": ("node, settings and arrays of the search", ("_bezier_cost", "_child", "_judge")),
    "rivals/reachability.py": ("cells of the map and the kinematics", ("_fill",)),
    "sim/agent_kernels.py": ("agent, others and walls", ("look_about", "steer")),
    "sim/referee.py": ("measured and commanded motion with their limits", ("_excess",)),
    "sim/referee_geometry.py": ("all bodies against all solids", ("update_gaps",)),
}
KNOWN = {"gym/env.py:MotmEnv.__init__"}  # keywords of gymnasium.make; nothing new comes in


def broken_rules(module: ast.Module) -> dict[str, ast.FunctionDef | ast.AsyncFunctionDef]:
    """Functions of a file that are longer or have more arguments than allowed, by their dotted names."""
    found = {}

    def visit(node: ast.AST, within: str) -> None:
        for child in ast.iter_child_nodes(node):
            if not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)):
                visit(child, within)
                continue
            name = f"{within}{child.name}"
            if not isinstance(child, ast.ClassDef):
                given = child.args
                names = [one.arg for one in (*given.posonlyargs, *given.args, *given.kwonlyargs)]
                lines = (child.end_lineno or child.lineno) - child.lineno + 1
                if lines > MOST_LINES or len(names) - (names[:1] in (["self"], ["cls"])) > MOST_ARGUMENTS:
                    found[name] = child
            visit(child, f"{name}.")

    visit(module, "")
    return found


def compiled(function: ast.FunctionDef | ast.AsyncFunctionDef) -> bool:
    return any(ast.unparse(each).partition("(")[0].rpartition(".")[2] in COMPILED for each in function.decorator_list)


def test_functions_are_short_and_take_few_arguments_but_for_those_listed():
    found = {
        f"{path.relative_to(PACKAGE).as_posix()}:{name}": function
        for path in FILES
        for name, function in broken_rules(tree(path)).items()
    }
    kernels = {f"{file}:{name}" for file, (_, names) in KERNELS.items() for name in names}
    assert not found.keys() - kernels - KNOWN, "split it, or hand it a struct"
    assert not (kernels | KNOWN) - found.keys(), "mended: take it out of the list"
    assert not [name for name in kernels if not compiled(found[name])], "not compiled: no reason for many arguments"


NO_BEGINNING = ("What", "Whether", "Where", "Who", "How")  # a docstring says what a thing is or does


def test_a_docstring_begins_with_what_a_thing_is_or_does():
    documented = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
    found = [
        f"{path.name}: {' '.join(words[:8])}"
        for path in FILES
        for node in ast.walk(tree(path))
        if isinstance(node, documented) and (words := (ast.get_docstring(node) or "").split())
        if words[0] in NO_BEGINNING
    ]
    assert not found


@pytest.mark.parametrize(
    ("source", "names"),
    [
        (f"def few({', '.join(f'a{k}' for k in range(8))}):\n    pass\n", []),
        (f"def many({', '.join(f'a{k}' for k in range(9))}):\n    pass\n", ["many"]),
        (f"class A:\n    def f(self, *, {', '.join(f'a{k}' for k in range(9))}):\n        pass\n", ["A.f"]),
        (f"class A:\n    def f(self, {', '.join(f'a{k}' for k in range(8))}):\n        pass\n", []),
        ("def short():\n" + "    pass\n" * 59, []),
        ("def long():\n" + "    pass\n" * 60, ["long"]),
        ("def outer():\n    def inner():\n" + "        pass\n" * 60, ["outer", "outer.inner"]),
    ],
)
def test_what_breaks_the_rules_is_found(source, names):
    assert list(broken_rules(ast.parse(source))) == names
