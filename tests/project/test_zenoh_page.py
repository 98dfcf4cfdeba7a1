"""docs/zenoh.md and docs/zenoh_fields.md: their tables are those of the types."""

from pathlib import Path

from motm_twin.bus.connection import Keys
from motm_twin.bus.schemas import MESSAGES
from motm_twin.control.tuning import PARAMETERS

ROOT = Path(__file__).resolve().parents[2]
LISTED = {"keys", "commands", "faults", "methods", "parameters"}  # tables of docs/zenoh.md itself
BY_SCHEMA = {"session", "command"}  # a session is a file of ours; the envelope is explained in words


TOOL = "zenoh_page"  # of the fixture `tool`


def test_the_tables_are_those_of_the_code(tool):
    for path in tool.PAGES:
        text = path.read_text(encoding="utf-8")
        assert tool.wanted(text) == text, f"{path.name}: run tools/zenoh_page.py"


def test_every_table_and_every_message_has_its_place(tool):
    page, fields = (path.read_text(encoding="utf-8") for path in tool.PAGES)
    assert set(tool.TABLE.findall(page)) and {name for _, name, _ in tool.TABLE.findall(page)} == LISTED
    assert {name for _, name, _ in tool.TABLE.findall(fields)} == set(MESSAGES) - BY_SCHEMA


def test_every_key_has_a_row(tool):
    table = tool.keys_table()
    told = [key.removeprefix("motm/frankie/") for key in Keys("frankie").own]
    assert not [key for key in told if f"| `{key}` |" not in table]


def test_every_parameter_has_a_row(tool):
    table = tool.parameters_table()
    assert not [entry.name for entry in PARAMETERS if f"| `{entry.name}` |" not in table]


def test_a_table_that_is_out_of_date_is_written_anew(tool):
    old = "<!-- fields of commands -->\nout of date\n<!-- end -->\n"
    assert "| `play` |" in tool.wanted(old) and "out of date" not in tool.wanted(old)
