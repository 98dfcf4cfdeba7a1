"""The documentation beside the page: terms of the panel, and where each is explained; served under /docs.

`make docs` builds it as a site. A checkout without that has its texts, which a browser shows as they are written; an
installed wheel has neither, and then no term is a link.
"""

import functools
import http
import mimetypes
from collections.abc import Mapping
from pathlib import Path
from urllib.parse import unquote

from websockets.datastructures import Headers
from websockets.http11 import Response

from motm_twin.model.data_dirs import web_assets_dir

PATH = "/docs/"
PLAIN, CHECKED = "text/plain; charset=utf-8", {"Cache-Control": "no-cache"}
TERMS = {  # page, and the heading on it
    "method": ("method", "all-methods"),
    "place": ("method", "sec-iv-base-placement"),
    "plan": ("method", "sec-iii-base-controller"),
    "end of search": ("method", "iii-c-search-termination"),
    "penalty": ("method", "iii-d-fading-proximity-penalty"),
    "arm": ("method", "sec-v-arm-and-obstacle-avoidance"),
    "program": ("parameters", "arm-quadratic-program"),
    "avoidance": ("parameters", "arm-obstacle-avoidance-sec-v"),
    "phases": ("parameters", "arm-phases-and-motion"),
    "referee": ("method", "the-referee"),
    "tour": ("results", "measures"),
    "period": ("performance", "what-a-period-costs"),
    "faults": ("robustness", "what-is-watched"),
    "page": ("page", "the-page-a-tour"),
}


@functools.cache
def _place() -> tuple[Path, str] | None:
    """Folder of the documentation and the ending of its pages; None without any."""
    root = web_assets_dir().parent
    found = ((root / "build" / "site", ".html"), (root / "docs", ".md"))
    return next(((folder, ending) for folder, ending in found if (folder / f"method{ending}").is_file()), None)


def link(term: str) -> str:
    """Address of what is said about one of `TERMS`; "" where there is no documentation."""
    place = _place()
    page, heading = TERMS[term]
    return "" if place is None else f"{PATH}{page}{place[1]}#{heading}"


def answer(path: str) -> Response | None:
    """The file under `PATH` that a browser asks for; None for what is none of its business."""
    if not path.startswith(PATH):
        return None
    if (place := _place()) is not None:
        folder = place[0].resolve()
        wanted = (folder / (unquote(path.removeprefix(PATH)) or "index.html")).resolve()
        if wanted.is_relative_to(folder) and wanted.is_file():
            known = mimetypes.guess_type(wanted.name)[0] or "application/octet-stream"
            kind = PLAIN if wanted.suffix == ".md" else known
            return response(http.HTTPStatus.OK, wanted.read_bytes(), {"Content-Type": kind, **CHECKED})
    return response(http.HTTPStatus.NOT_FOUND, b"no such page", CHECKED)


def response(status: http.HTTPStatus, body: bytes, headers: Mapping[str, str]) -> Response:
    """An answer with these headers besides its length; plain text unless they tell another type."""
    told = {"Content-Type": PLAIN, "Content-Length": str(len(body)), **headers}
    return Response(status.value, status.phrase, Headers(told), body)
