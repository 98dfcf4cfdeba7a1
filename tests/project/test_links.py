"""Texts: every link, anchor and file that they name is there, every page can be reached, and none grows without end."""

import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").rglob("*.md"))]
GENERATED = re.compile(r"<!-- (?:methods|numbers of|fields of|faults|keys|messages).*?<!-- end -->", re.S)
WORDS = {"README.md": 900, "docs/method.md": 6000, "docs/architecture.md": 1500}  # without generated tables
WHOLE = 28_000  # words of README.md and docs/, without generated tables and the notebook
CODE = ("motm_twin", "tests", "tools", "examples", "scenes")
OTHERS = {"docs/design.md"}  # of rmw_zenoh, named in ros2/forms.py


def name_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


@cache
def text_of(path: Path) -> str:
    """The page without its blocks of code."""
    return re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.S | re.M)


@cache
def anchors(path: Path) -> frozenset[str]:
    """Anchors of the headings of a page, as GitHub makes them."""
    found: list[str] = []
    for heading in re.findall(r"^#+ (.+)$", text_of(path), re.M):
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("\\", "").lower()
        slug = re.sub(r"[^\w\- ]", "", plain).strip().replace(" ", "-")
        found.append(slug if slug not in found else f"{slug}-{found.count(slug)}")
    return frozenset(found)


def links(path: Path) -> list[str]:
    """Targets of the links and pictures of a page that lead to files of the project."""
    found = re.findall(r"\]\(([^)\s]+)\)", text_of(path))
    return [link for link in found if not re.match(r"[a-z]+:", link)]


def broken(path: Path) -> list[str]:
    wrong = []
    for link in links(path):
        file, _, anchor = link.partition("#")
        target = (path.parent / file).resolve() if file else path
        if not target.exists() or (anchor and target.suffix == ".md" and anchor not in anchors(target)):
            wrong.append(link)
    return wrong


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_every_link_of_a_page_leads_somewhere(page: Path):
    assert not broken(page)


def test_a_wrong_link_would_be_found(tmp_path: Path):
    page = tmp_path / "page.md"
    page.write_text("# A title, long\n[a](#a-title-long) [b](gone.md) [c](#elsewhere) [d](page.md#a-title-long)\n")
    assert broken(page) == ["gone.md", "#elsewhere"]


def test_every_page_can_be_reached_from_the_readme():
    reached, queue = {ROOT / "README.md"}, [ROOT / "README.md"]
    while queue:
        page = queue.pop()
        for link in links(page):
            target = (page.parent / link.partition("#")[0]).resolve()
            if target.suffix == ".md" and target.is_file() and target not in reached:
                reached.add(target)
                queue.append(target)
    outside = {ROOT / "CONTRIBUTING.md", ROOT / "CHANGELOG.md"}  # GitHub shows them itself
    assert not [name_of(page) for page in PAGES if page not in reached | outside]


def sources() -> list[Path]:
    listing = subprocess.run(["git", "ls-files", "-z", *CODE], cwd=ROOT, capture_output=True, check=False)
    if listing.returncode:
        pytest.skip("not a git checkout")
    names = listing.stdout.decode().split("\0")
    return [ROOT / name for name in names if name.endswith((".py", ".yaml", ".json5", ".sh"))]


def test_every_page_that_the_code_names_is_there():
    missing = {}
    for path in sources():
        if path.is_file() and path != Path(__file__).resolve():
            for named in re.findall(r"\bdocs/[\w/]+\.(?:md|png|json)\b", path.read_text(encoding="utf-8")):
                if named not in OTHERS and not (ROOT / named).is_file():
                    missing[f"{name_of(path)}: {named}"] = 1
    assert not missing


def test_every_page_that_a_text_names_is_there():
    named = {(name_of(page), name) for page in PAGES for name in re.findall(r"\bdocs/[\w/.]+\w", text_of(page))}
    assert not [each for each in sorted(named) if not (ROOT / each[1]).exists()]


@pytest.mark.parametrize("page", [page for page in PAGES if page.name != "CHANGELOG.md"], ids=name_of)
def test_every_file_of_the_code_that_a_page_names_is_there(page: Path):
    """In backticks: `planning/staa.py` is in the package, `tools/schemas.py` in the project."""
    named = set(re.findall(r"`((?:[\w.]+/)+[\w.]+\.(?:py|yaml|urdf))`", text_of(page)))
    there = [ROOT, ROOT / "motm_twin", ROOT / "docs"]
    assert not [name for name in sorted(named) if not any((root / name).is_file() for root in there)]


@pytest.mark.parametrize(("name", "most"), WORDS.items())
def test_a_page_stays_as_short_as_it_was_made(name: str, most: int):
    text = GENERATED.sub("", (ROOT / name).read_text(encoding="utf-8"))
    assert len(text.split()) <= most


def test_all_pages_together_stay_short():
    pages = [page for page in PAGES if page.name not in ("CHANGELOG.md", "CONTRIBUTING.md")]
    pages = [page for page in pages if page.parent.name != "notebook"]
    assert sum(len(GENERATED.sub("", page.read_text(encoding="utf-8")).split()) for page in pages) <= WHOLE


def test_an_entry_of_the_changelog_is_one_line():
    lines = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").partition("\n## ")[2].splitlines()
    assert not [line for line in lines if line.startswith((" ", "\t"))]


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_rows_of_a_table_have_as_many_cells_as_its_head(page: Path):
    wrong, cells = [], 0
    for number, line in enumerate(text_of(page).splitlines(), 1):
        if not line.startswith("|"):
            cells = 0
            continue
        found = len(re.findall(r"(?<!\\)\|", line))
        if cells and found != cells:
            wrong.append(f"line {number} without code: {line[:60]}")
        cells = cells or found
    assert not wrong
