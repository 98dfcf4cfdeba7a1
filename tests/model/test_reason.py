"""Reasons and their sentences; nothing reads a sentence."""

import ast
import re

import msgspec
import pytest
from sources import FILES, PACKAGE, tree

from motm_twin.model.reason import Kind, Reason
from motm_twin.perception.finding import KINDS

SENTENCES = {"reason", "stop_reason", "qp_status"}  # attributes
READ = re.compile(rf"\.\s*({'|'.join(SENTENCES)})\b")  # files without this cannot read one
CUTS = {"startswith", "endswith", "split", "replace", "removeprefix", "removesuffix", "find", "index"}
OWN = {"perf/processes.py"}  # reads the refusal of a command, which is no reason of the robot


@pytest.mark.parametrize("kind", Kind)
def test_every_kind_has_a_sentence(kind):
    cause = Reason(kind=Kind.NO_SCAN, subject="lidar")
    said = str(Reason(kind=kind, subject="it", other="another", value=2.0, limit=3.0, unit="m", cause=cause))
    assert said and "{" not in said and "None" not in said


def test_findings_are_reasons():
    assert set(KINDS) <= set(Kind)


def test_two_reasons_that_differ_in_numbers_only_have_one_key():
    near, far = (
        Reason(kind=Kind.AT_TARGET, subject="cube", value=1.0, cause=Reason(kind=Kind.HELD_OFF, subject="arm", value=d))
        for d in (0.2, 0.4)
    )
    assert near.key == far.key and str(near) != str(far)
    assert near.about(Kind.HELD_OFF) == near.cause and near.about(Kind.NO_WAY) is None


def test_a_reason_survives_the_wire():
    why = Reason(
        kind=Kind.STOPPED, subject="lidar", cause=Reason(kind=Kind.SCAN_OLD, subject="lidar", value=0.4, limit=0.3)
    )
    assert msgspec.json.decode(msgspec.json.encode(why), type=Reason) == why
    assert str(why) == "stopped: the newest lidar scan is 0.40 s old, more than 0.30 s"


def _reads_a_sentence(node: ast.AST) -> bool:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.func.attr in CUTS:
        return isinstance(node.func.value, ast.Attribute) and node.func.value.attr in SENTENCES
    if isinstance(node, ast.Compare) and isinstance(node.ops[0], (ast.In, ast.NotIn)):
        return any(isinstance(one, ast.Attribute) and one.attr in SENTENCES for one in node.comparators)
    return False


@pytest.mark.parametrize(
    "line", ['why.reason.startswith("a")', '"a" in tick.stop_reason', '"a" not in (\n    step.\n    qp_status)']
)
def test_code_that_reads_a_sentence_is_found(line):
    assert READ.search(line) and any(_reads_a_sentence(node) for node in ast.walk(ast.parse(line)))


def test_no_code_reads_a_sentence():
    for path in FILES:
        if str(path.relative_to(PACKAGE)) in OWN or not READ.search(path.read_text()):
            continue
        found = [node.lineno for node in ast.walk(tree(path)) if _reads_a_sentence(node)]
        assert not found, f"{path.relative_to(PACKAGE)}: {found}"
