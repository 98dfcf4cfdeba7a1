"""The door of the page: who may load it and open its websocket.

Viser has no login and checks no origin, so its listener is wrapped here. The names in Host and Origin are checked, so
that no other web page can reach the twin through the visitor's browser, and none may show it in a frame; with
a token, nothing is served without it. The public tunnel that Viser offers is switched off for good.
"""

import hmac
import http
import ipaddress
import socket
import unittest.mock
from collections.abc import Callable, Sequence
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, parse_qsl, urlencode, urlsplit

import viser
import websockets.asyncio.server
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from motm_twin.bus.connection import LOOPBACK, free_port, require_free_port
from motm_twin.ui.crowd import LARGEST, QUEUED, VISITORS, Crowd
from motm_twin.ui.page_scripts import with_scripts
from motm_twin.ui.threads import write_through_the_loop

COOKIE = "motm_token"  # and the port, as a browser sends the cookies of one port to all others of a name
HEALTH_PATH = "/healthz"
MIN_TOKEN = 32  # characters; 128 bits when they are hexadecimal
CLOSED = {  # headers of every answer: no page shows this one, and its address is told to none
    "Content-Security-Policy": "frame-ancestors 'none'",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}
_LOOPBACK_NAMES = ("localhost", "127.0.0.1", "::1")


def is_loopback(host: str) -> bool:
    """Whether an address to listen on is reachable from this machine only."""
    return host in _LOOPBACK_NAMES or (_is_address(host) and ipaddress.ip_address(host).is_loopback)


def check_token(host: str, token: str | None) -> None:
    """Raise ValueError when the page would be open to others without a strong token."""
    if token is None and not is_loopback(host):
        raise ValueError(f"listening on {host} needs a token: --no-token is for this machine only")
    if token is not None and (len(token) < MIN_TOKEN or len(set(token)) < 8 or not token.isascii()):
        raise ValueError(f"the token is too weak: at least {MIN_TOKEN} random ASCII characters (128 bits)")
    if token is not None and not all(sign.isalnum() or sign in "-_" for sign in token):
        raise ValueError("the token may hold letters, digits, '-' and '_' only: it travels in the address")


class Guard:
    """Decides about each HTTP request: None lets it pass."""

    def __init__(
        self, token: str | None, host: str = LOOPBACK, names: Sequence[str] = (), crowd: Crowd | None = None
    ) -> None:
        """``host``: address that is listened on; ``names``: further ones under which browsers may ask."""
        self._crowd = crowd or Crowd()
        self._token, self._far = token, not is_loopback(host)
        own = {socket.gethostname(), socket.getfqdn()} if self._far else set()
        self._names = {name.lower() for name in (*_LOOPBACK_NAMES, host, *names, *own)}

    def check(self, request: Request) -> Response | None:
        """The refusal (or redirect) for a request, or None."""
        split = urlsplit(request.path)
        if split.path == HEALTH_PATH:
            return _response(http.HTTPStatus.OK, "ok")
        host = _single(request, "Host")
        if host is None or not self._serves(host):
            return _response(http.HTTPStatus.FORBIDDEN, "this name is not served: use the printed address")
        if not _same_origin(request, host):
            return _response(http.HTTPStatus.FORBIDDEN, "another web page may not use the twin")
        if self._token is None:
            return self._full(request, split.path)
        offered = parse_qs(split.query).get("token", [""])[0]
        if offered and self._equal(offered):
            query = urlencode([(key, value) for key, value in parse_qsl(split.query) if key != "token"])
            cookie = f"{_cookie_name(host)}={self._token}; Path=/; HttpOnly; SameSite=Strict"
            return _response(
                http.HTTPStatus.SEE_OTHER, "", {"Location": f"/?{query}" if query else "/", "Set-Cookie": cookie}
            )
        if self._equal(_cookie(request, _cookie_name(host))):
            return self._full(request, split.path)
        return _response(http.HTTPStatus.UNAUTHORIZED, "open the printed address, which carries the token")

    def _full(self, request: Request, path: str) -> Response | None:
        """The refusal for one page too many."""
        wanted = path == "/" or request.headers.get("Upgrade", "").lower() == "websocket"
        if not self._crowd.full or not wanted:
            return None
        return _response(http.HTTPStatus.SERVICE_UNAVAILABLE, self._crowd.text(), {"Retry-After": "10"})

    def _serves(self, host: str) -> bool:
        """The page goes by this name. An address is nobody's domain, which could be led here."""
        try:
            name = urlsplit(f"//{host}").hostname or ""
        except ValueError:
            return False
        return name in self._names or (self._far and _is_address(name))

    def _equal(self, offered: str) -> bool:
        return self._token is not None and hmac.compare_digest(offered.encode(), self._token.encode())


def open_page(
    host: str, port: int, token: str | None = None, names: Sequence[str] = (), *, visitors: int = VISITORS
) -> viser.ViserServer:
    """A Viser server behind the guard, on exactly this port (0: any free one), for so many visitors at once.

    ``names``: as of `Guard`. Raises PortTaken, ValueError.
    """
    if visitors < 1:
        raise ValueError(f"{visitors} visitors: at least one page must be possible")
    check_token(host, token)
    require_free_port(host, port, "choose another one with --port (0 takes any free one)")
    if host == "::":
        port = port or free_port(host)
        require_free_port("0.0.0.0", port, "choose another one with --port (0 takes any free one)")  # noqa: S104 - wanted
    write_through_the_loop()
    crowd, original = Crowd(visitors), websockets.asyncio.server.serve
    guard = Guard(token, host, names, crowd)
    wrapped: list[int] = []

    def serve(handler: Any, host: str, *args: Any, process_request: Callable[..., Any], **options: Any) -> Any:
        def process(connection: Any, request: Request) -> Response | None:
            return _closed(guard.check(request) or with_scripts(process_request(connection, request)))

        wrapped.append(1)
        places: Any = ["::", "0.0.0.0"] if host == "::" else host  # noqa: S104 - asyncio takes "::" for IPv6 alone
        options |= {"max_size": LARGEST, "max_queue": QUEUED}
        return original(crowd.bounded(handler), places, *args, process_request=process, **options)

    with unittest.mock.patch.object(websockets.asyncio.server, "serve", serve):
        server = viser.ViserServer(host=host, port=port, verbose=False)
    server.request_share_url = _no_tunnel
    if not wrapped or (port and server.get_port() != port):
        server.stop()
        raise OSError(f"the page did not come up as asked on {host}:{port}: nothing is served")
    return server


def page_url(host: str, port: int, token: str | None) -> str:
    """The address to open on this machine."""
    name = LOOPBACK if host in ("0.0.0.0", "::") else host  # noqa: S104 - compared, not bound
    name = f"[{name}]" if ":" in name else name
    return f"http://{name}:{port}/" + (f"?token={token}" if token else "")


def _no_tunnel(*_: object, **__: object) -> None:
    """Takes the place of the request for a public address."""


def _single(request: Request, name: str) -> str | None:
    values = request.headers.get_all(name)
    return values[0] if len(values) == 1 else None


def _same_origin(request: Request, host: str) -> bool:
    origins = request.headers.get_all("Origin")
    return all(urlsplit(origin).netloc == host for origin in origins)


def _closed(response: Response | None) -> Response | None:
    """The answer with the headers `CLOSED`; Viser may keep one answer for several requests."""
    if response is None:
        return None
    headers = Headers([*response.headers.raw_items(), *CLOSED.items()])
    return Response(response.status_code, response.reason_phrase, headers, response.body)


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


def _cookie_name(host: str) -> str:
    port = host.rpartition(":")[2]  # as the browser sees it, which may be one that is forwarded
    return f"{COOKIE}_{port}" if port.isdecimal() and not host.endswith("]") else COOKIE


def _cookie(request: Request, name: str) -> str:
    cookies: SimpleCookie = SimpleCookie()
    try:
        cookies.load("; ".join(request.headers.get_all("Cookie")))
    except CookieError:
        return ""
    return cookies[name].value if name in cookies else ""


def _response(status: http.HTTPStatus, text: str, extra: dict[str, str] | None = None) -> Response:
    body = text.encode()
    headers = Headers(
        {"Content-Type": "text/plain; charset=utf-8", "Content-Length": str(len(body)), "Cache-Control": "no-store"}
    )
    headers.update(extra or {})
    return Response(status.value, status.phrase, headers, body)
