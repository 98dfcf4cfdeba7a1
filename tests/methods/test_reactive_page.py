"""docs/method.md: its tables are those of the code, and every method says what was chosen."""

import importlib.util
from pathlib import Path

import pytest

from motm_twin.methods.registry import METHODS

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def tool():
    spec = importlib.util.spec_from_file_location("method_page_tool", ROOT / "tools" / "method_page.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_tables_are_those_of_the_code(tool):
    page = tool.PAGE.read_text(encoding="utf-8")
    assert tool.wanted(page) == page, "run tools/method_page.py"


def test_every_method_has_a_row(tool):
    page = tool.PAGE.read_text(encoding="utf-8")
    assert not [name for name in METHODS if f"| `{name}` |" not in page]


def test_a_number_is_shown_with_the_reason_beside_it(tool):
    table = tool.numbers_table("motm_twin/planning/parameters.py", "PlacementParameters")
    assert "| `next_weight` | `1.05` | Paper, Sec. IV: weight of C_iN |" in table
    assert "| `clearance` | `0.06` | [m] own:" in table


def test_a_class_that_is_gone_is_named(tool):
    with pytest.raises(ValueError, match="has no class Gone"):
        tool.numbers_table("motm_twin/planning/parameters.py", "Gone")
