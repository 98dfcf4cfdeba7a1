"""The report as one self-contained HTML file, with pictures and data."""

import base64
import html
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from motm_twin.studies.paper.part import Drawn, Missing, Part

NARROW = 5.0  # [inch] figures below this are for one column, and shown smaller
CSS = """
:root { color-scheme: light dark; --ink: #1b1b1b; --ground: #fdfdfc; --soft: #666; --line: #ccc; --mark: #f3ead2; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e8e8e6; --ground: #1a1b1d; --soft: #a5a5a5; --line: #444; --mark: #4a4028; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--ground); margin: 0 auto;
  max-width: 62rem; padding: 1.5rem; }
h1 { font-size: 1.7rem; line-height: 1.25; } h2 { margin-top: 3rem; border-bottom: 1px solid var(--line); }
h3 { margin-top: 2.2rem; } nav ul { columns: 2; padding-left: 1.2rem; }
a { color: inherit; } code { font-size: 0.86em; overflow-wrap: anywhere; }
img { max-width: 100%; height: auto; background: #fff; border: 1px solid var(--line); border-radius: 4px; }
img.narrow { width: 34rem; }
figure { margin: 1rem 0; }
figcaption, .about { font-size: 0.9rem; } .about { color: var(--soft); }
.scroll { overflow-x: auto; margin-bottom: 1.5rem; }
table { border-collapse: collapse; font-size: 0.88rem; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 0.25rem 0.7rem 0.25rem 0; vertical-align: top;
  border-bottom: 1px solid var(--line); }
tr.published { background: var(--mark); font-style: italic; }
.missing { border-left: 4px solid #D55E00; padding-left: 1rem; }
@media print { body { max-width: none; } nav { display: none; } }
"""


class Section(NamedTuple):
    """A chapter of the report: its parts, or text that was made into HTML already."""

    anchor: str
    title: str
    parts: Sequence[Part] = ()
    body: str = ""


def page(title: str, lead: str, sections: Iterable[Section], folder: Path) -> str:
    """The whole document; pictures are read from ``folder``. ``lead``: HTML under the title."""
    sections = list(sections)
    links = "".join(f'<li><a href="#{each.anchor}">{text(each.title)}</a></li>' for each in sections)
    body = "\n".join(_section(each, folder) for each in sections)
    return (
        f'<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n<title>{text(title)}</title>\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<style>{CSS}</style>\n</head>\n<body>\n<h1>{text(title)}</h1>\n{lead}\n<nav><ul>{links}</ul></nav>\n{body}\n</body>\n</html>\n"
    )


def text(value: object) -> str:
    """Plain text, escaped."""
    return html.escape(str(value))


def table(header: Sequence[str], rows: Sequence[Sequence[str]], marked: Sequence[int] = ()) -> str:
    """A table of plain text; marked rows look published."""
    head = "".join(f"<th>{text(each)}</th>" for each in header)
    body = "".join(_row(cells, published=index in marked) for index, cells in enumerate(rows))
    return f'<div class="scroll"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def paragraphs(sentences: Iterable[str]) -> str:
    """Each as a paragraph."""
    return "".join(f"<p>{text(each)}</p>" for each in sentences)


def warnings(sentences: Iterable[str]) -> str:
    """Each as a paragraph that stands out."""
    return "".join(f'<p class="missing">{text(each)}</p>' for each in sentences)


def _row(cells: Sequence[str], *, published: bool) -> str:
    kind = ' class="published"' if published else ""
    return f"<tr{kind}>" + "".join(f"<td>{text(cell)}</td>" for cell in cells) + "</tr>"


def _section(section: Section, folder: Path) -> str:
    parts = "\n".join(_part(part, folder) for part in section.parts)
    return f'<section id="{section.anchor}">\n<h2>{text(section.title)}</h2>\n{section.body}\n{parts}\n</section>'


def _part(part: Part, folder: Path) -> str:
    if isinstance(part, Missing):
        return (
            f'<div class="missing" id="{part.name}"><h3>{text(part.title)}</h3>'
            f"<p>Not in this report: {text(part.reason)}.</p>"
            f'<p class="about">Command: <code>{text(part.command)}</code>.</p></div>'
        )
    shown = _picture(part, folder) if part.figure is not None or part.picture is not None else ""
    caption = f"<figcaption>{text(part.caption)}</figcaption>"
    figure = f"<figure>{shown}{caption}</figure>"
    rows = [tuple(row.values()) for row in part.cells]
    cells = table(tuple(part.cells[0]), rows, part.marked) if rows else ""
    return (
        f'<div id="{part.name}"><h3>{text(part.title)}</h3>\n{figure}\n{cells}\n{paragraphs(part.notes)}\n'
        f'<p class="about">n: {text(part.n)}. Made by <code>{text(part.command)}</code>. '
        f"{_data(part, folder)}</p></div>"
    )


def _picture(part: Drawn, folder: Path) -> str:
    picture = base64.b64encode((folder / f"{part.name}.png").read_bytes()).decode()
    narrow = part.figure is not None and part.figure.get_figwidth() < NARROW
    kind = ' class="narrow"' if narrow else ""
    return f'<img{kind} alt="{text(part.title)}: {text(part.caption)}" src="data:image/png;base64,{picture}">'


def _data(part: Drawn, folder: Path) -> str:
    """The numbers behind it, to be saved from the page."""
    numbers = base64.b64encode((folder / f"{part.name}.csv").read_bytes()).decode()
    return f'<a download="{part.name}.csv" href="data:text/csv;base64,{numbers}">Data (CSV)</a>'
