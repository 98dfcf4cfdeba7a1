"""The site of `make docs`: built without a warning, complete, and without anything from another host."""

import os
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path

import pytest
import yaml

import motm_twin
import motm_twin.client

ROOT = Path(__file__).resolve().parents[2]
FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "video": "src", "embed": "src"}
FETCHED_LINKS = {"stylesheet", "icon", "preload", "prefetch", "preconnect", "dns-prefetch", "modulepreload", "manifest"}
CSS = re.compile(r"""(?:url\(|@import)\s*["']?((?:https?:)?//[^"')]+)""")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--quiet", "--strict", "--site-dir", str(folder)]
    env = os.environ | {"NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(command, cwd=ROOT, env=env, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr, done.stderr
    return folder


class Fetched(HTMLParser):
    """Addresses that a browser fetches by itself when it shows a page."""

    def __init__(self):
        super().__init__()
        self.found = []

    def handle_starttag(self, tag, attrs):
        given = dict(attrs)
        if tag in FETCHED:
            self.found.append(given.get(FETCHED[tag]) or "")
        if tag == "link" and FETCHED_LINKS & set((given.get("rel") or "").split()):
            self.found.append(given.get("href") or "")
        if "mermaid" in (given.get("class") or "").split():
            self.found.append("https://the script that draws it")


def elsewhere(text):
    reader = Fetched()
    reader.feed(text)
    return [address for address in reader.found if re.match(r"(https?:)?//", address)] + CSS.findall(text)


def test_no_page_of_the_site_fetches_anything_from_another_host(site):
    pages = [path for path in site.rglob("*") if path.suffix in (".html", ".css")]
    assert len(pages) > 40
    assert not {str(path.relative_to(site)): found for path in pages if (found := elsewhere(path.read_text("utf-8")))}


@pytest.mark.parametrize(
    "text",
    [
        '<script src="https://cdn.example/a.js"></script>',
        '<link rel="stylesheet" href="//fonts.example/a.css">',
        "<style>@import 'https://fonts.example/a.css';</style>",
        "@font-face { src: url(https://fonts.example/a.woff2) }",
        '<pre class="mermaid">graph</pre>',
    ],
)
def test_something_from_another_host_would_be_found(text):
    assert elsewhere(text)


def test_a_link_to_another_host_is_fine():
    assert not elsewhere(
        '<a href="https://arxiv.org/abs/2309.09393">paper</a><link rel="next" href="https://a.example">'
    )


def test_every_page_of_the_documents_is_in_the_site_and_in_its_menu(site):
    menu = re.findall(r"([\w/]+\.md)\b", (ROOT / "mkdocs.yml").read_text(encoding="utf-8"))
    pages = [str(path.relative_to(ROOT / "docs")) for path in sorted((ROOT / "docs").rglob("*.md"))]
    assert sorted(menu) == sorted(pages)
    for page in pages:
        built = page.replace("README.md", "index.md").removesuffix(".md")
        assert (site / f"{built}.html").is_file(), page


def test_every_file_that_a_page_links_to_is_in_the_site(site):
    shown = (site / "source" / "examples" / "own_base_controller.py.html").read_text(encoding="utf-8")
    assert "PURSUIT" in shown
    assert "tick.1.json" in (site / "source" / "docs" / "schemas.html").read_text(encoding="utf-8")
    missing = []
    for page in site.rglob("*.html"):
        for link in re.findall(r'<a [^>]*href="([^"#?]+)', page.read_text(encoding="utf-8")):
            if not re.match(r"[a-z]+:|//|/", link) and not (page.parent / link).exists():
                missing.append(f"{page.relative_to(site)}: {link}")
    assert not missing


def test_the_reference_has_every_name_of_the_public_face(site):
    page = (site / "api.html").read_text(encoding="utf-8")
    names = [f"motm_twin.{name}" for name in motm_twin.__all__]
    names += [f"motm_twin.client.{name}" for name in motm_twin.client.__all__]
    assert not [name for name in names if f'id="{name}"' not in page]


def test_the_theme_takes_no_font_from_elsewhere():
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    settings = yaml.safe_load(re.sub(r"!!python\S+ ", "", text))
    assert settings["theme"]["font"] is False
    assert settings["strict"] is True
