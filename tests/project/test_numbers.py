"""A number that stands in two texts is the same in both: README.md says in short what docs/method.md measured."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
METHOD = (ROOT / "docs" / "method.md").read_text(encoding="utf-8")

SAME = {  # row of README.md: rows of docs/method.md that it repeats
    "Experiment 1, the ten published trials: mean, trial 1": ("1, ten arrangements, mean",),
    "Experiment 1, random arrangements, seeds 0-49": ("1, random, seeds 0 to 49, mean",),
    "Experiment 1a, two boxes that the map does not know, the ten": ("1a, mean",),
    "the same, random arrangements, seeds 0-49": ("1a, random, seeds 0 to 49, mean",),
    "Experiment 2, four Temis, seeds 0-49": ("2, seeds 0 to 49, mean", "2 over 1, by seed"),
    "the same with one Temi, seeds 0-49": ("2 with one Temi, seeds 0 to 49, mean", "over 1, by seed"),
}


def row(text, label, cells):
    """Cells of the one row of so many cells whose first begins so."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    (found,) = [each for each in rows if each[0].startswith(label) and len(each) == cells]
    return found


@pytest.mark.parametrize("label", SAME)
def test_the_numbers_of_the_readme_are_those_of_the_method_page(label):
    _, _, *short = row(README, label, 4)  # motm, fast
    for repeated in SAME[label]:
        whole = row(METHOD, repeated, 8)[1:3]
        for said, measured in zip(short, whole, strict=True):
            value = measured.partition(" [")[0]  # without its interval
            assert re.search(rf"(^|[ (]){re.escape(value)}", said), f"{label}: {said}; measured: {measured}"


def test_the_readme_says_of_the_literal_paper_what_was_measured():
    slower = row(METHOD, "`paper_literal`", 9)[5]
    assert slower.startswith("+")
    text = " ".join(README.split())
    (said,) = re.findall(r"`--method paper_literal` is the paper [^.]*, (\S+ s) slower on average than `motm`", text)
    assert said == slower[1:].partition(" +-")[0]
