"""The documentation beside the page: every term leads to a heading, and nothing else is served."""

import re
from pathlib import Path

import pytest

from motm_twin.ui import page_server
from motm_twin.ui.page_server import PATH, TERMS, answer, link

DOCS = Path(__file__).resolve().parents[2] / "docs"
ENDINGS = {"docs": ".md", "site": ".html"}


@pytest.fixture(params=ENDINGS)
def kind(request, tmp_path, monkeypatch):
    """With the texts of a checkout, and with a site."""
    folder = DOCS if request.param == "docs" else tmp_path / "site"
    folder.mkdir(exist_ok=True)
    if folder != DOCS:
        (folder / "method.html").write_text("<title>The method</title>", encoding="utf-8")
        (tmp_path / "secret.html").write_text("secret", encoding="utf-8")
    monkeypatch.setattr(page_server, "_place", lambda: (folder, ENDINGS[request.param]))
    return request.param


def headings(page):
    """Anchors of a page, as the site makes them of its headings."""
    found = re.findall(r"^#+ (.+)$", (DOCS / f"{page}.md").read_text(encoding="utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).strip().replace(" ", "-") for title in found}


@pytest.mark.parametrize("term", TERMS)
def test_a_term_leads_to_a_heading(term):
    page, heading = TERMS[term]
    assert heading in headings(page)


def test_pages_are_served_and_nothing_beside_them(kind):
    address = link("method")
    assert address.startswith(f"{PATH}method{ENDINGS[kind]}#")
    found = answer(address.partition("#")[0])
    assert found.status_code == 200
    assert found.headers["Content-Type"].startswith("text/plain" if kind == "docs" else "text/html")
    for path in ("../README.md", "%2e%2e/secret.html", "nothing.html", "/etc/passwd", "notebook"):
        assert answer(PATH + path).status_code == 404
    assert answer("/") is None and answer("/docs") is None


def test_without_documentation_no_term_is_a_link(monkeypatch):
    monkeypatch.setattr(page_server, "_place", lambda: None)
    assert link("method") == "" and answer(f"{PATH}method.html").status_code == 404
