"""A number in several texts is the same in all: README.md repeats docs/results.md, and that the notebook."""

import re
from pathlib import Path

import pytest

from motm_twin.control.parameters import Parameters
from motm_twin.model.number import numbers_of

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
RESULTS = (ROOT / "docs" / "results.md").read_text(encoding="utf-8")
EXPERIMENTS = (ROOT / "docs" / "notebook" / "experiments.md").read_text(encoding="utf-8")
ABLATIONS = (ROOT / "docs" / "notebook" / "ablations.md").read_text(encoding="utf-8")

MEASURED = {  # row of docs/results.md: rows of docs/notebook/experiments.md that it repeats
    "Experiment 1, random arrangements, seeds 0-49": ("1, random, seeds 0 to 49, mean",),
    "Experiment 1a, random arrangements, seeds 0-49": ("1a, random, seeds 0 to 49, mean",),
    "Experiment 2, four Temis, seeds 0-49": ("2, seeds 0 to 49, mean", "2 over 1, by seed"),
    "the same with one Temi, seeds 0-49": ("2 with one Temi, seeds 0 to 49, mean", "over 1, by seed"),
}
SHORT = {  # row of README.md: row of docs/results.md that it repeats, and how many cells that has
    "Experiment 1a, two unmapped boxes": ("Experiment 1a, the ten: mean", 3),
    "Experiment 2, four Temis that **stop for the robot**, seeds 0-9": ("Experiment 2, four Temis that stop", 3),
    "`blind`: the same with Temis that **do not stop**, seeds 0-2": ("the same with Temis that do not stop", 3),
    "Experiment 1, random arrangements, seeds 0-49": ("Experiment 1, random arrangements, seeds 0-49", 4),
    "Experiment 2, four Temis, seeds 0-49": ("Experiment 2, four Temis, seeds 0-49", 4),
    "control period": ("control period", 4),
}


def row(text, label, cells):
    """Cells of the one row of so many cells whose first begins so."""
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line[:1] == "|"]
    (found,) = [each for each in rows if each[0].startswith(label) and len(each) == cells]
    return found


def numbers(text):
    return re.findall(r"\d+(?:\.\d+)?", text)


@pytest.mark.parametrize("label", MEASURED)
def test_the_numbers_of_the_results_are_those_of_the_notebook(label):
    _, _, *short = row(RESULTS, label, 4)  # motm, fast
    for repeated in MEASURED[label]:
        whole = row(EXPERIMENTS, repeated, 8)[1:3]
        for said, measured in zip(short, whole, strict=True):
            value = measured.partition(" [")[0]  # without its interval
            assert re.search(rf"(^|[ (]){re.escape(value)}", said), f"{label}: {said}; measured: {measured}"


@pytest.mark.parametrize("label", SHORT)
def test_the_numbers_of_the_readme_are_those_of_the_results(label):
    short = row(README, label, 4)[2:]  # motm, fast
    whole = row(RESULTS, *SHORT[label])[-2:]
    for said, measured in zip(short, whole, strict=True):
        assert numbers(said), label
        assert not [number for number in numbers(said) if number not in numbers(measured)], f"{label}: {said}"
        times = re.findall(r"\d+\.\d+ s", said)
        assert not [time for time in times if time not in measured], f"{label}: {said}"


@pytest.mark.parametrize(("column", "method"), [(2, "`motm`"), (3, "`fast`")])
def test_the_first_row_of_the_readme_is_that_of_the_results(column, method):
    said = row(README, "Experiment 1, the ten published arrangements", 4)[column]
    time, placed = row(RESULTS, method, 4)[1:3]
    assert said.startswith(f"{time}, {placed}")


@pytest.mark.parametrize("method", ["`paper_literal`", "`sequential`"])
def test_the_readme_tells_the_times_of_the_paper_as_printed_and_of_the_rival(method):
    assert f" {row(RESULTS, method, 4)[1]}" in README


def test_the_readme_says_of_the_literal_paper_what_was_measured():
    slower = row(ABLATIONS, "`paper_literal`", 9)[5]
    assert slower.startswith("+")
    text = " ".join(README.split())
    (said,) = re.findall(r"`--method paper_literal` is the paper [^.]*, (\S+ s) slower on average than `motm`", text)
    assert said == slower[1:].partition(" +-")[0]


def test_the_tree_of_parameters_does_not_grow():
    assert len(list(numbers_of(Parameters()))) <= 347  # whoever adds one takes one away
