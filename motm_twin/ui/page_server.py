"""The server of the page: Viser's, with a guard that checks every request, and our own scripts (web_assets/page).

Viser has no login and checks no origin, so its listener is wrapped here. The names in Host and Origin are checked, so
that no other web page can reach the twin through the visitor's browser, and none may show it in a frame. With a token,
nothing is served without it. Viser's public tunnel is off for good.

The documentation is served under /docs: the site that `make docs` builds, or else the Markdown files of a checkout as
plain text. An installed wheel has neither; then no term is a link.

No page may use up the resources of the others: the number of pages and the data rate of each are limited. A page sends
its camera at most sixty times a second, and a picture of some megabytes when asked for one. Faster messages wait in the
browser, held back by TCP flow control.
"""

import asyncio
import functools
import gzip
import hmac
import http
import ipaddress
import mimetypes
import os
import socket
import time
import unittest.mock
from collections.abc import Awaitable, Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, parse_qsl, unquote, urlencode, urlsplit

import viser
import websockets.asyncio.server
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from motm_twin.bus.connection import LOOPBACK, free_port, require_free_port
from motm_twin.bus.private_folder import folder, own_secret
from motm_twin.model.assets import web_assets_dir
from motm_twin.program import give_back

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
def _documentation_folder() -> tuple[Path, str] | None:
    """Folder of the documentation and the ending of its pages; None without any."""
    root = web_assets_dir().parent
    found = ((root / "build" / "site", ".html"), (root / "docs", ".md"))
    return next(((folder, ending) for folder, ending in found if (folder / f"method{ending}").is_file()), None)


def link(term: str) -> str:
    """Address of the documentation of one of `TERMS`; "" where there is no documentation."""
    place = _documentation_folder()
    page, heading = TERMS[term]
    return "" if place is None else f"{PATH}{page}{place[1]}#{heading}"


def documentation(path: str) -> Response | None:
    """Response to a request below `PATH`: a file of the documentation, or 404; None for any other path."""
    if not path.startswith(PATH):
        return None
    if (place := _documentation_folder()) is not None:
        folder = place[0].resolve()
        file = (folder / (unquote(path.removeprefix(PATH)) or "index.html")).resolve()
        if file.is_relative_to(folder) and file.is_file():
            known = mimetypes.guess_type(file.name)[0] or "application/octet-stream"
            kind = PLAIN if file.suffix == ".md" else known
            return response(http.HTTPStatus.OK, file.read_bytes(), {"Content-Type": kind, **CHECKED})
    return response(http.HTTPStatus.NOT_FOUND, b"no such page", CHECKED)


def response(status: http.HTTPStatus, body: bytes, headers: Mapping[str, str]) -> Response:
    """A response with its length and these headers; plain text unless they give another type."""
    sent = {"Content-Type": PLAIN, "Content-Length": str(len(body)), **headers}
    return Response(status.value, status.phrase, Headers(sent), body)


SCRIPTS = ("keys.js", "reconnect.js", "smooth.js", "view.js", "tour.js", "overlay.js")  # in this order
STYLES = ("overlay.css",)


def with_scripts(response: Response | None) -> Response | None:
    """Insert the scripts into a response that is the page; other responses pass unchanged."""
    if response is None or not response.headers.get("Content-Type", "").startswith("text/html"):
        return response
    zipped = response.headers.get("Content-Encoding") == "gzip"
    body = _inserted(bytes(response.body or b""), zipped)
    headers = Headers((name, value) for name, value in response.headers.raw_items() if name != "Content-Length")
    headers["Content-Length"] = str(len(body))
    return Response(response.status_code, response.reason_phrase, headers, body)


@functools.cache
def scripts(names: tuple[str, ...] = SCRIPTS) -> str:
    """Scripts of the page in this order, and all styles, as HTML."""
    place = web_assets_dir() / "page"
    styles = "".join(f"<style>{(place / name).read_text(encoding='utf-8')}</style>" for name in STYLES)
    return styles + "".join(f"<script>{(place / name).read_text(encoding='utf-8')}</script>" for name in names)


@functools.lru_cache(maxsize=2)
def _inserted(body: bytes, zipped: bool) -> bytes:
    """The page with the scripts at the start of its head. Raises ValueError for a page without one."""
    page = gzip.decompress(body) if zipped else body
    before, head, after = page.partition(b"<head>")
    if not head:
        raise ValueError("Viser's page has no <head> for our scripts: this Viser is not the pinned one")
    page = before + head + scripts().encode() + after
    return gzip.compress(page, mtime=0) if zipped else page


VARIABLE = "MOTM_TOKEN"
FILE = "page-token"  # in the user's private folder
COOKIE = "motm_token"  # the port is appended: browsers share the cookies of a host among its ports
HEALTH_PATH = "/healthz"
MIN_TOKEN = 32  # characters; 128 bits when they are hexadecimal
SECURITY_HEADERS = {  # headers of every answer: no framing, no referrer
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")
VISITORS = 50  # pages open at once, by default
MESSAGES, BURST = 300.0, 600.0  # of one page: rate [1/s], and largest burst
BYTES, BYTES_BURST = 2e6, 16e6  # of one page: rate [1/s], and largest burst
LARGEST = 8 * 1024 * 1024  # bytes of a message
QUEUED = 4  # unread messages of one page
TIDY = 0.5  # [s] from the first page that leaves to one clean-up for all that have left by then
PICTURE = 1024  # most messages sent at once: more than one frame has
TRY_LATER = 1013  # code with which a websocket is closed


def chosen_token(given: str | None, *, none: bool) -> str | None:
    """The required token: the given one or that in MOTM_TOKEN, else the user's own; None with ``none``.

    Raises ValueError when both are given, OSError when the user's own cannot be stored.
    """
    if given is not None and none:
        raise ValueError("--token and --no-token exclude each other")
    return None if none else given or os.environ.get(VARIABLE) or own_token()


def own_token() -> str:
    """The user's token, made when it is missing; nobody else can read it. Raises OSError."""
    return own_secret(folder() / FILE, "use --token or MOTM_TOKEN")


def is_loopback(host: str) -> bool:
    """True for an address to listen on that is reachable from this machine only."""
    return host in _LOOPBACK_NAMES or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def check_token(host: str, token: str | None) -> None:
    """Raise ValueError when the page would be open to others without a strong token."""
    if token is None and not is_loopback(host):
        raise ValueError(f"listening on {host} needs a token: --no-token is for this machine only")
    if token is not None and (len(token) < MIN_TOKEN or len(set(token)) < 8 or not token.isascii()):
        raise ValueError(f"the token is too weak: at least {MIN_TOKEN} random ASCII characters (128 bits)")
    if token is not None and not all(sign.isalnum() or sign in "-_" for sign in token):
        raise ValueError("the token may hold letters, digits, '-' and '_' only: it travels in the address")


class Allowance:
    """A token bucket: a sender that takes more than it holds must wait."""

    def __init__(self, rate: float, most: float, now: float) -> None:
        """``rate`` [1/s], up to ``most``; ``now`` [s] monotonic."""
        self._rate, self._most, self._left, self._at = rate, most, most, now

    def take(self, amount: float, now: float) -> float:
        """Take an amount at ``now`` [s]; returns the time [s] to wait before the next one."""
        self._left = min(self._most, self._left + self._rate * (now - self._at)) - amount
        self._at = now
        return max(0.0, -self._left / self._rate)


class PageLimit:
    """Counts open pages, and slows down those that send too much."""

    def __init__(self, most: int = VISITORS) -> None:
        """``most``: pages open at once."""
        self.most, self.here, self._untidy = most, 0, False

    @property
    def full(self) -> bool:
        """True when no further page may open."""
        return self.here >= self.most

    def text(self) -> str:
        """Reason why no further page may open."""
        return f"{self.most} pages of this twin are open already: close one, or start it with --visitors"

    def bounded(self, handler: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """A websocket handler for at most `most` pages, each read no faster than its allowance."""

        async def handle(connection: Any) -> None:
            if self.full:
                await connection.close(TRY_LATER, self.text())
                return
            self.here += 1
            connection.recv = _throttled(connection.recv)
            try:
                await handler(connection)
            finally:
                self.here -= 1
                self._tidy_soon()

        return handle

    def _tidy_soon(self) -> None:
        """Schedule a clean-up, also after pages that broke off before they had a panel."""
        if not self._untidy:
            self._untidy = True
            asyncio.get_running_loop().call_later(TIDY, self._tidy)

    def _tidy(self) -> None:
        self._untidy = False
        asyncio.get_running_loop().run_in_executor(None, give_back)  # it takes some ten milliseconds


def _throttled(recv: Callable[[], Awaitable[Any]]) -> Callable[[], Awaitable[Any]]:
    began = time.monotonic()
    messages, size = Allowance(MESSAGES, BURST, began), Allowance(BYTES, BYTES_BURST, began)

    async def receive() -> Any:
        found = await recv()
        now = time.monotonic()
        wait = max(messages.take(1.0, now), size.take(len(found), now))
        if wait > 0.0:
            await asyncio.sleep(wait)
        return found

    return receive


class Guard:
    """Decides about each HTTP request: None lets it pass."""

    def __init__(
        self, token: str | None, host: str = LOOPBACK, names: Sequence[str] = (), limit: PageLimit | None = None
    ) -> None:
        """``host``: address to listen on; ``names``: further host names that browsers may use."""
        self._limit = limit or PageLimit()
        self._token, self._far = token, not is_loopback(host)
        own = {socket.gethostname(), socket.getfqdn()} if self._far else set()
        self._names = {name.lower() for name in (*_LOOPBACK_NAMES, host, *names, *own)}

    def check(self, request: Request) -> Response | None:
        """Response to a request that must not reach Viser (refusal, redirect, health check); None lets it pass."""
        split = urlsplit(request.path)
        if split.path == HEALTH_PATH:
            return _response(http.HTTPStatus.OK, "ok")
        hosts = request.headers.get_all("Host")
        host = hosts[0] if len(hosts) == 1 else ""
        if not host or not self._serves(host):
            return _response(http.HTTPStatus.FORBIDDEN, "this name is not served: use the printed address")
        if any(urlsplit(origin).netloc != host for origin in request.headers.get_all("Origin")):
            return _response(http.HTTPStatus.FORBIDDEN, "another web page may not use the twin")
        if self._token is not None:
            if _equal(parse_qs(split.query).get("token", [""])[0], self._token):
                query = urlencode([(key, value) for key, value in parse_qsl(split.query) if key != "token"])
                cookie = f"{_cookie_name(host)}={self._token}; Path=/; HttpOnly; SameSite=Strict"
                more = {"Location": f"/?{query}" if query else "/", "Set-Cookie": cookie}
                return _response(http.HTTPStatus.SEE_OTHER, "", **more)
            if not any(_equal(cookie, self._token) for cookie in _cookies(request, _cookie_name(host))):
                return _response(http.HTTPStatus.UNAUTHORIZED, "open the printed address, which carries the token")
        opens = split.path == "/" or request.headers.get("Upgrade", "").lower() == "websocket"
        if opens and self._limit.full:
            return _response(http.HTTPStatus.SERVICE_UNAVAILABLE, self._limit.text(), **{"Retry-After": "10"})
        return None

    def _serves(self, host: str) -> bool:
        """True for a host name under which the page is served; beyond loopback, any IP address passes as well."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return name in self._names or (self._far and _is_address(name))


def open_page(
    host: str, port: int, token: str | None = None, names: Sequence[str] = (), *, visitors: int = VISITORS
) -> viser.ViserServer:
    """A Viser server behind the guard, on exactly this port (0: any free one).

    ``visitors``: most pages open at once; ``names``: as for `Guard`. Raises PortTaken, ValueError.
    """
    if visitors < 1:
        raise ValueError(f"{visitors} visitors: at least one page must be possible")
    check_token(host, token)
    require_free_port(host, port, "choose another one with --port (0 takes any free one)")
    if host == "::":
        port = port or free_port(host)
        require_free_port("0.0.0.0", port, "choose another one with --port (0 takes any free one)")  # noqa: S104 - wanted
    write_through_the_loop()
    limit, original = PageLimit(visitors), websockets.asyncio.server.serve
    guard = Guard(token, host, names, limit)
    wrapped: list[int] = []

    def serve(handler: Any, host: str, *args: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Request) -> Response | None:
            refused = guard.check(request) or documentation(urlsplit(request.path).path)
            return _with_security_headers(refused or with_scripts(process_request(connection, request)))

        wrapped.append(1)
        places: Any = ["::", "0.0.0.0"] if host == "::" else host  # noqa: S104 - asyncio takes "::" for IPv6 alone
        options |= {"max_size": LARGEST, "max_queue": QUEUED}
        return original(limit.bounded(handler), places, *args, process_request=process, **options)

    with unittest.mock.patch.object(websockets.asyncio.server, "serve", serve):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    server.request_share_url = lambda *_, **__: None  # no tunnel to a public address
    if not wrapped or (port and server.get_port() != port):
        server.stop()
        raise OSError(f"the page did not come up as asked on {host}:{port}: nothing is served")
    return server


def page_url(host: str, port: int, token: str | None) -> str:
    """The address to open on this machine."""
    name = LOOPBACK if host in ("0.0.0.0", "::") else host  # noqa: S104 - compared, not bound
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def _with_security_headers(response: Response | None) -> Response | None:
    """A copy of the response with `SECURITY_HEADERS`: Viser may use one response for several requests."""
    if response is None:
        return None
    headers = Headers([*response.headers.raw_items(), *SECURITY_HEADERS.items()])
    return Response(response.status_code, response.reason_phrase, headers, response.body)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _cookie_name(host: str) -> str:
    port = host.rpartition(":")[2]  # as the browser sees it: it may be a forwarded one
    return f"{COOKIE}_{port}" if port.isdecimal() and not host.endswith("]") else COOKIE


def _cookies(request: Request, name: str) -> list[str]:
    """Values of all cookies with a name. Cookies of other programs, in whatever form, do not hide any."""
    pairs = (pair.partition("=") for pair in ";".join(request.headers.get_all("Cookie")).split(";"))
    return [value.strip() for key, _, value in pairs if key.strip() == name]


def _equal(offered: str, token: str) -> bool:
    return hmac.compare_digest(offered.encode(errors="surrogateescape"), token.encode())


def _response(status: http.HTTPStatus, text: str, **more: str) -> Response:
    return response(status, text.encode(), {"Cache-Control": "no-store", **more})


class LoopEvent(asyncio.Event):
    """An event that can be set only in its event loop; a call from another thread does nothing.

    Viser wakes its senders twice for every message: at once in the thread that writes, and again in its event loop.
    The first call bypasses the loop: when the loop runs at that moment, it raises "deque mutated during iteration" in
    the writer, which breaks off its update of the page. Here only the second call has an effect.
    """

    def set(self) -> None:
        """Set the event when called in the thread of the loop."""
        try:
            asyncio.get_running_loop()
        except RuntimeError:
            return
        super().set()


def write_through_the_loop() -> None:
    """Make all message buffers that Viser creates from now on wake their senders in the event loop.

    Each buffer sends a whole frame at once.
    """
    original = AsyncMessageBuffer.__init__
    if getattr(original, "wakes_in_the_loop", False):
        return

    def init(self: AsyncMessageBuffer, *arguments: Any, **named: Any) -> None:
        original(self, *arguments, **named)
        self.message_event, self.max_window_size = LoopEvent(), PICTURE

    init.wakes_in_the_loop = True  # pyright: ignore[reportFunctionMemberAccess]
    AsyncMessageBuffer.__init__ = init
