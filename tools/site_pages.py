"""Hooks of mkdocs: files of the repository that the pages link to become pages of the site (`make docs`).

In the repository a link from docs/ to `../examples/x.py` opens the file, and one to `schemas` its folder. The site has
neither: here each gets a page that shows the file, or lists the folder, and the link leads there.
"""

import json
import posixpath
import re
from pathlib import Path, PurePosixPath
from typing import Any

from mkdocs.structure.files import File, Files

ROOT = Path(__file__).resolve().parents[1]
SOURCES = "source"  # folder of these pages in the site
HIDDEN = "---\nsearch: {exclude: true}\n---\n\n"  # from the search
LINK = re.compile(r"\]\((?![a-z]+:|#)([^)#\s]+)((?:#[^)\s]*)?)\)")
LANGUAGES = {".py": "python", ".yaml": "yaml", ".json": "json", ".json5": "json5", ".cff": "yaml"}


def target_of(page: str, link: str) -> str:
    """Path in the repository that a link of a page of docs/ leads to."""
    return posixpath.normpath(posixpath.join("docs", posixpath.dirname(page), link))


def needs_page(target: str) -> bool:
    """Test for what the site does not have by itself: files outside docs/, and folders."""
    path = ROOT / target
    return path.is_dir() or (path.is_file() and PurePosixPath(target).parts[0] != "docs")


def page_of(target: str) -> str:
    """Name of the page for a file or folder of the repository."""
    return f"{SOURCES}/{target}.md"


def notebook_text(path: Path) -> str:
    """Cells of a notebook, without their output, as Markdown."""
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    texts = [("".join(cell["source"]), cell["cell_type"] == "code") for cell in cells]
    return "\n\n".join(f"```python\n{text}\n```" if code else text for text, code in texts)


def text_of(target: str) -> str:
    """Markdown of the page for a file or folder."""
    path = ROOT / target
    if path.is_dir():
        names = sorted(each.name for each in path.iterdir() if each.is_file())
        up = "../" * len(PurePosixPath(page_of(target)).parent.parts)
        inside = f"{up}{PurePosixPath(target).relative_to('docs')}/"
        return f"# {target}\n\n" + "\n".join(f"- [{name}]({inside}{name})" for name in names) + "\n"
    if path.suffix == ".ipynb":
        return notebook_text(path)
    return f"# {target}\n\n````{LANGUAGES.get(path.suffix, 'text')}\n{path.read_text(encoding='utf-8')}````\n"


def on_files(files: Files, config: Any) -> Files:
    """Add a page for everything in the repository that a page links to and the site has not."""
    for page in files.documentation_pages():
        for link, _ in LINK.findall(page.content_string):
            target = target_of(page.src_uri, link)
            if needs_page(target) and files.get_file_from_path(page_of(target)) is None:
                files.append(File.generated(config, page_of(target), content=HIDDEN + text_of(target)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Lead the links of a page to those pages."""
    here = page.file.src_uri
    if here.startswith(f"{SOURCES}/"):
        return markdown

    def led(found: re.Match[str]) -> str:
        target = target_of(here, found[1])
        if not needs_page(target):
            return found[0]
        return f"]({posixpath.relpath(page_of(target), posixpath.dirname(here) or '.')}{found[2]})"

    return LINK.sub(led, markdown)
