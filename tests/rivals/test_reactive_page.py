"""docs/method.md and docs/parameters.md: their tables are those of the code, and every method has its place."""

from pathlib import Path

import pytest

from motm_twin.methods.registry import METHODS
from motm_twin.rivals.stationary import STATIONARY

ROOT = Path(__file__).resolve().parents[2]


TOOL = "method_page"  # of the fixture `tool`


def test_the_tables_are_those_of_the_code(tool):
    for path in (tool.METHOD, tool.PARAMETERS):
        page = path.read_text(encoding="utf-8")
        assert "| method |" in page or "| number |" in page, path.name
        assert tool.wanted(page) == page, "run tools/method_page.py"


def test_every_method_has_a_row(tool):
    page = tool.METHOD.read_text(encoding="utf-8")
    assert not [name for name in METHODS if f"| `{name}` |" not in page]


def test_a_number_is_shown_with_the_reason_beside_it(tool):
    table = tool.numbers_table("motm_twin/planning/parameters.py", "PlacementParameters")
    assert "| `next_weight` |  | `1.05` |  | Paper, Sec. IV | weight of C_iN, the cost on to the next target |" in table
    assert "| `clearance` |  | `0.06` | m | own | clearance of a candidate" in table


def test_constants_of_a_file_are_shown_where_a_comment_says_what_they_are(tool):
    table = tool.numbers_table("motm_twin/rivals/open_loop.py", None)
    assert "| `K_X`, `K_Y`, `K_H` | `1.0`, `4.0`, `2.0` | [1/s], [1/m^2], [1/s]: critically damped" in table
    assert "_OVER" not in table


def test_every_number_of_a_rival_is_in_the_page(tool):
    page = tool.PARAMETERS.read_text(encoding="utf-8")
    for part in (
        "stationary_placement.py:StationaryParameters",
        "reachability.py",
        "stationary_placement.py",
        "open_loop.py",
    ):
        assert f"<!-- numbers of motm_twin/rivals/{part} -->" in page, part


def test_every_rival_has_a_section(tool):
    rivals = tool.METHOD.read_text(encoding="utf-8").partition("\n## Methods of others\n")[2]
    headings = "".join(line for line in rivals.splitlines() if line.startswith("### "))
    compared = ("staa", "motm2022", "holistic", "open_loop", *(method.name for method in STATIONARY))
    assert not [name for name in compared if f"`{name}`" not in headings]


def test_a_class_that_is_gone_is_named(tool):
    with pytest.raises(ValueError, match="has no class Gone"):
        tool.numbers_table("motm_twin/planning/parameters.py", "Gone")
