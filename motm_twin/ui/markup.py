"""Pieces of HTML that the cards are made of. Texts from outside go through `text`, which escapes them."""

import html

MUTED = "#6b7280"
GREEN, AMBER, RED, BLUE = "#15803d", "#b45309", "#b91c1c", "#1d4ed8"

STYLE = """<style>
.mm{font-size:13px;line-height:1.45;padding:6px 12px;font-variant-numeric:tabular-nums}
.mm h4{font-size:11px;letter-spacing:.06em;text-transform:uppercase;color:#6b7280;font-weight:600;margin:0 0 3px}
.mm .big{font-size:16px;line-height:1.35;font-weight:600}
.mm .mu{color:#6b7280}
.mm .kv{display:grid;grid-template-columns:auto 1fr;gap:1px 12px}
.mm .kv>:nth-child(odd){color:#6b7280;white-space:nowrap}
.mm .kv>:nth-child(even){text-align:right}
.mm .chip{border-radius:9px;padding:0 8px;color:#fff;font-weight:600;font-size:12px;white-space:nowrap}
.mm .bar{position:relative;height:10px;border-radius:5px;background:#e5e7eb;overflow:hidden}
.mm .bar>i{position:absolute;top:0;bottom:0}
.mm table{width:100%;border-collapse:collapse}
.mm td{padding:1px 0;vertical-align:top}.mm td+td{text-align:right;padding-left:8px;white-space:nowrap}
.mm .ex{border-bottom:1px dotted #9ca3af;cursor:help}
.mm .two{min-height:43px}
.mm hr{border:0;border-top:1px solid #e5e7eb;margin:5px 0}
</style>"""


def text(value: object) -> str:
    """Escaped for HTML."""
    return html.escape(str(value))


def card(*parts: str) -> str:
    """A card of the panel; parts are HTML."""
    return f'<div class="mm">{"".join(parts)}</div>'


def heading(title: str) -> str:
    """A small title, HTML."""
    return f"<h4>{title}</h4>"


def sentence(value: str, colour: str) -> str:
    """A sentence from outside beside a coloured line."""
    return (
        f'<div style="margin-top:5px;border-left:3px solid {colour};padding:2px 8px;background:{colour}14">'
        f"{text(value)}</div>"
    )


def explained(name: str, words: str) -> str:
    """A name, HTML, with plain words that are shown when the pointer rests on it."""
    return f'<span class="ex" title="{text(words)}">{name}</span>'


def chip(value: str, colour: str) -> str:
    """A word in a coloured capsule."""
    return f'<span class="chip" style="background:{colour}">{text(value)}</span>'


def pairs(rows: list[tuple[str, str]]) -> str:
    """Names and values in two columns, both HTML."""
    return f'<div class="kv">{"".join(f"<span>{name}</span><span>{value}</span>" for name, value in rows)}</div>'


def table(rows: list[tuple[str, ...]]) -> str:
    """Rows of HTML cells; the first column is to the left, the others to the right."""
    return f"<table>{''.join('<tr>' + ''.join(f'<td>{cell}</td>' for cell in row) + '</tr>' for row in rows)}</table>"


class Piece:
    """A part of a bar: from, to (shares of its length) and colour."""

    def __init__(self, start: float, end: float, colour: str) -> None:
        self.start, self.end, self.colour = min(max(start, 0.0), 1.0), min(max(end, 0.0), 1.0), colour

    def __str__(self) -> str:
        """As HTML."""
        width = max(0.0, self.end - self.start)
        return f'<i style="left:{100 * self.start:.1f}%;width:{100 * width:.1f}%;background:{self.colour}"></i>'


def bar(*pieces: Piece, height: int = 10) -> str:
    """A horizontal bar; later pieces lie over earlier ones."""
    return f'<div class="bar" style="height:{height}px">{"".join(map(str, pieces))}</div>'


def mark(at: float, colour: str = "#111827", width: float = 0.012) -> Piece:
    """A thin line across a bar."""
    at = min(max(at, width / 2), 1.0 - width / 2)
    return Piece(at - width / 2, at + width / 2, colour)


def seconds(value: float | None) -> str:
    """A duration; "none" when there is none."""
    return "none" if value is None else f"{value:.1f} s"


def metres(value: float | None) -> str:
    """A length; "none near" when there is none."""
    return "none near" if value is None else f"{value:.2f} m"


def signed(value: float, decimals: int) -> str:
    """A number with its sign; what is rounded to nothing has that of nothing, not a minus."""
    return f"{round(value, decimals) + 0.0:+.{decimals}f}"
