"""The page as it is served: Viser's own, with our scripts at the start of its head."""

import functools
import gzip

from websockets.datastructures import Headers
from websockets.http11 import Response

from motm_twin.ui import page_keys, page_link

SCRIPTS = (page_keys.SCRIPT, page_link.SCRIPT)


def with_scripts(response: Response | None) -> Response | None:
    """The answer to a request for the page with the scripts in it; any other answer as it is."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    body = _inserted(bytes(response.body or b""), zipped)
    headers = Headers((name, value) for name, value in response.headers.raw_items() if name != "Content-Length")
    headers["Content-Length"] = str(len(body))
    return Response(response.status_code, response.reason_phrase, headers, body)


@functools.lru_cache(maxsize=2)
def _inserted(body: bytes, zipped: bool) -> bytes:
    """The page with the scripts at the start of its head. Raises ValueError for a page without one."""
    page = gzip.decompress(body) if zipped else body
    before, head, after = page.partition(b"<head>")
    if not head:
        raise ValueError("Viser's page has no <head> for our scripts: this Viser is not the pinned one")
    page = before + head + "".join(SCRIPTS).encode() + after
    return gzip.compress(page, mtime=0) if zipped else page
