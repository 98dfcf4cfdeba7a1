"""The server of the page, over real sockets, and of the documentation. If a newer Viser slips past it, these fail."""

import asyncio
import gzip
import re
import socket
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import websockets
from page import get
from viser._messages import RemoveNotificationMessage
from viser.infra._async_message_buffer import AsyncMessageBuffer
from websockets.asyncio.client import connect

from motm_twin.bus.connection import PortTaken, free_port
from motm_twin.perf.page_reader import PageReader
from motm_twin.ui import page_server
from motm_twin.ui.page_server import (
    PATH,
    TERMS,
    Guard,
    LoopEvent,
    check_token,
    documentation,
    link,
    open_page,
    page_url,
    scripts,
    write_through_the_loop,
)

TOKEN = "0123456789abcdef0123456789abcdef"
OTHER_TOKEN = TOKEN[::-1]
WRITERS, MESSAGES = 4, 300
WAITERS = 20  # as many pages


@pytest.fixture
def local():
    server = open_page("127.0.0.1", 0)
    yield server
    server.stop()


@pytest.fixture
def secret():
    server = open_page("127.0.0.1", 0, TOKEN)
    yield server
    server.stop()


def websocket_opens(server, origin=None, cookie=None):
    async def attempt():
        headers = {} if cookie is None else {"Cookie": cookie}
        address = f"ws://127.0.0.1:{server.get_port()}"
        async with connect(address, origin=origin, additional_headers=headers, subprotocols=["viser-v1.1.1"]):
            return True

    try:
        return asyncio.run(attempt())
    except websockets.exceptions.InvalidStatus:
        return False


def test_the_page_is_served_on_loopback_under_its_own_names_and_no_other_that_leads_here(local):
    assert get(local).status == get(local, "/healthz").status == 200
    for host in (f"localhost:{local.get_port()}", "localhost:9000"):  # this one through a forwarded port
        assert get(local, Host=host).status == 200
    for host in ("evil.example", "localhost.evil.example"):
        assert get(local, Host=host).status == 403


def answer_to(server, request):
    """First line of the answer to raw bytes."""
    with socket.create_connection(("127.0.0.1", server.get_port()), timeout=10) as connection:
        connection.sendall(request)
        return connection.recv(4096).split(b"\r\n")[0]


def test_a_request_without_a_name_or_with_two_is_refused(local):
    assert b" 403 " in answer_to(local, b"GET / HTTP/1.1\r\n\r\n")
    assert b" 403 " in answer_to(local, b"GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n\r\n")
    assert b" 200 " in answer_to(local, b"GET / HTTP/1.1\r\nHost: localhost\r\n\r\n")


def test_only_this_machine_reaches_the_page(local):
    port = f":{local.get_port():04X}"
    lines = [line.split() for line in Path("/proc/net/tcp").read_text().splitlines()[1:]]
    listening = {address for _, address, _, state, *_ in lines if address.endswith(port) and state == "0A"}
    assert listening == {f"0100007F{port}"}  # 127.0.0.1


def test_files_beside_the_page_stay_private(secret, local):
    for path in ("/../../../../../etc/passwd", "/%2e%2e/%2e%2e/%2e%2e/%2e%2e/etc/passwd", "/..%5c..%5cetc/passwd"):
        assert get(local, path).status == 404
        assert get(secret, path).status == 401
        assert get(local, f"/docs{path}").status == 404


def test_the_documentation_is_served_to_whom_the_page_is(secret, local):
    address = link("method").partition("#")[0]
    found = get(local, address)
    assert found.status == 200 and found.getheader("X-Frame-Options") == "DENY"
    assert get(secret, address).status == 401
    assert get(local, address, Host="evil.example").status == 403


def test_another_web_page_can_not_open_the_websocket(local):
    port = local.get_port()
    assert websocket_opens(local, origin=f"http://127.0.0.1:{port}")
    for origin in ("http://evil.example", f"http://127.0.0.1:{port + 1}", "null"):
        assert not websocket_opens(local, origin=origin)


def test_nothing_is_served_without_the_token(secret):
    wrong, origin = "motm_token=wrong", f"http://127.0.0.1:{secret.get_port()}"
    assert get(secret).status == get(secret, "/?token=wrong").status == get(secret, Cookie=wrong).status == 401
    assert not websocket_opens(secret, origin=origin)
    assert not websocket_opens(secret, origin=origin, cookie=wrong)
    assert get(secret, "/healthz").status == 200


def test_the_token_in_the_address_becomes_a_cookie_that_opens_page_and_websocket(secret):
    port = secret.get_port()
    answer = get(secret, f"/?token={TOKEN}")
    assert (answer.status, answer.getheader("Location")) == (303, "/")
    assert get(secret, f"/?a=1&token={TOKEN}&b=x%26y").getheader("Location") == "/?a=1&b=x%26y"
    cookie = answer.getheader("Set-Cookie")
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    pair = cookie.split(";")[0]
    assert get(secret, Cookie=pair).status == 200
    assert websocket_opens(secret, origin=f"http://127.0.0.1:{port}", cookie=pair)
    assert not websocket_opens(secret, origin="http://evil.example", cookie=pair)


@pytest.mark.parametrize("path", ["/", "/healthz", "/nothing", f"/?token={TOKEN}"])
def test_no_other_page_can_show_this_one_in_a_frame(secret, local, path):
    """A click into a frame that cannot be seen would drive the robot."""
    port = secret.get_port()
    cookie = {"Cookie": f"motm_token_{port}={TOKEN}"}
    for answer in (get(local, path), get(secret, path), get(secret, path, **cookie)):
        assert answer.headers.get_all("Content-Security-Policy") == ["frame-ancestors 'none'"]
        assert answer.headers.get_all("X-Frame-Options") == ["DENY"]
        assert answer.headers.get_all("Referrer-Policy") == ["no-referrer"]  # the address may carry the token


def test_a_foreign_name_is_refused_with_a_token_too(secret):
    cookie = f"motm_token={TOKEN}"
    for host in ("evil.example", "localhost.evil.example", f"evil.example:{secret.get_port()}", "10.0.0.7", "[::1"):
        assert get(secret, Host=host, Cookie=cookie).status == 403
        assert get(secret, f"/?token={TOKEN}", Host=host).status == 403


@pytest.mark.parametrize(
    ("host", "asked", "served"),
    [("0.0.0.0", "10.0.0.7:8080", True), ("0.0.0.0", "[fe80::1]:8080", True), ("0.0.0.0", "localhost", True),
     ("0.0.0.0", f"{socket.gethostname()}:8080", True), ("0.0.0.0", "evil.example:8080", False),
     ("0.0.0.0", "Lab.Example", True), ("lab2.example", "lab2.example:80", True), ("127.0.0.1", "10.0.0.7", False),
     ("127.0.0.1", "lab.example:443", True), ("0.0.0.0", "10.0.0.7.evil.example", False)],
)  # fmt: skip
def test_the_page_goes_by_addresses_and_by_names_of_its_own(host, asked, served):
    """An address is nobody's domain; a name is, and may be led here."""
    assert Guard(TOKEN, host, ["lab.example"])._serves(asked) is served


def test_the_cookies_of_two_pages_of_one_machine_are_two(secret):
    other = open_page("127.0.0.1", 0, OTHER_TOKEN)
    pairs = [get(page, f"/?token={token}").getheader("Set-Cookie").split(";")[0]
             for page, token in ((secret, TOKEN), (other, OTHER_TOKEN))]  # fmt: skip
    both = "; ".join(pairs)
    assert get(secret, Cookie=both).status == get(other, Cookie=both).status == 200
    assert len({pair.split("=")[0] for pair in pairs}) == 2
    assert get(other, Cookie=pairs[0]).status == 401
    other.stop()


@pytest.mark.parametrize(
    "foreign", ['prefs={"a":1}', "u=J\u00fcrgen", "x=a b", "flag", "", "=", 'q="', "motm_token=other", "motm_token"]
)
def test_a_cookie_of_another_program_in_any_form_hides_ours_from_no_page(secret, foreign):
    """One that Python's parser does not take hid ours: the page was refused until the browser forgot it."""
    name = f"motm_token_{secret.get_port()}"
    for cookies in (f"{foreign}; {name}={TOKEN}", f"{name}={TOKEN};{foreign}", f"{foreign};{name}={TOKEN} ;{foreign}"):
        assert get(secret, Cookie=cookies).status == 200
    for cookies in (foreign, f"{foreign}; x{name}={TOKEN}", f'x="{name}={TOKEN}"', f"{name}=\u00fc", f"{name}"):
        assert get(secret, Cookie=cookies).status == 401


def test_the_public_tunnel_is_switched_off(local, monkeypatch):
    opened, asked, closed = [], threading.Event(), local.request_share_url
    monkeypatch.setattr("viser._viser.ViserTunnel", lambda *args, **_: opened.append(args))
    local.request_share_url = lambda *args, **options: (closed(*args, **options), asked.set())
    with PageReader(local.get_port()) as page:
        page.send({"type": "ShareUrlRequest"})
        assert asked.wait(10.0)  # what a page can ask for goes through the method that is replaced
    assert closed() is None
    assert opened == []


def test_a_given_port_is_the_port_and_a_taken_one_an_error_and_never_the_next_one():
    port = free_port()
    server = open_page("127.0.0.1", port)
    assert server.get_port() == port
    with pytest.raises(PortTaken, match=str(port)):
        open_page("127.0.0.1", port)
    server.stop()


@pytest.mark.parametrize(
    ("host", "token"),
    [("0.0.0.0", None), ("192.168.1.5", None), ("0.0.0.0", "short"), ("127.0.0.1", "short"), ("0.0.0.0", "a" * 40),
     ("0.0.0.0", "0123456789abcdef;123456789abcdef"), ("0.0.0.0", "0123456789ábcdef0123456789abcdef")],
)  # fmt: skip
def test_an_open_page_needs_a_strong_token(host, token):
    with pytest.raises(ValueError, match="token"):
        check_token(host, token)


def test_the_printed_address_carries_the_token():
    assert page_url("0.0.0.0", 8080, TOKEN) == f"http://127.0.0.1:8080/?token={TOKEN}"
    assert page_url("127.0.0.1", 8080, None) == "http://127.0.0.1:8080/"


@pytest.fixture
def version_6():
    """Whether this machine has it; where it has not, that is said."""
    with socket.socket(socket.AF_INET6) as probe:
        try:
            probe.bind(("::1", 0))
        except OSError:
            with pytest.raises(ValueError, match="::1 is no IPv6 address of this machine"):
                open_page("::1", 0)
            return False
    return True


def test_the_page_is_served_by_version_6_of_ip(version_6):
    if not version_6:
        return
    server = open_page("::1", 0)
    port = server.get_port()
    assert get(server, address="::1").status == 200
    with pytest.raises(ConnectionRefusedError):
        get(server)
    assert page_url("::1", port, None) == f"http://[::1]:{port}/"
    with pytest.raises(PortTaken):
        open_page("::1", port)
    server.stop()


def test_all_addresses_are_those_of_both_versions(version_6):
    if not version_6:
        return
    server = open_page("::", 0, TOKEN)
    port = server.get_port()
    assert [get(server, address=address).status for address in ("::1", "127.0.0.1")] == [401, 401]
    assert page_url("::", port, TOKEN).startswith("http://127.0.0.1:")
    server.stop()
    with socket.socket() as holder:
        holder.bind(("127.0.0.1", 0))
        holder.listen()
        with pytest.raises(PortTaken):
            open_page("::", holder.getsockname()[1], TOKEN)


def test_an_address_of_another_machine_is_told():
    with pytest.raises(ValueError, match="2001:db8::1 is no IPv6 address of this machine: give one of its own, or ::"):
        open_page("2001:db8::1", 0, TOKEN)


def test_every_address_of_the_loopback_is_this_machine():
    server = open_page("127.0.0.2", 0)
    assert get(server, address="127.0.0.2").status == 200
    server.stop()


@pytest.mark.parametrize("accepted", ["identity", "gzip"])
def test_the_page_carries_our_scripts_whole_and_once(local, accepted):
    for _ in range(2):
        answer = get(local, Accept_Encoding=accepted)
        assert answer.getheader("Content-Encoding") == accepted
        assert int(answer.getheader("Content-Length")) == len(answer.body)
        page = gzip.decompress(answer.body) if accepted == "gzip" else answer.body
        assert page.count(scripts().encode()) == 1
        assert page.rstrip().endswith(b"</html>")


def test_another_thread_does_not_set_the_event_past_the_loop():
    event, waiting = LoopEvent(), []

    async def wait() -> None:
        waiting.append(asyncio.ensure_future(event.wait()))
        await asyncio.sleep(0)
        await asyncio.to_thread(event.set)
        assert not event.is_set() and not waiting[0].done()
        event.set()
        await waiting[0]

    asyncio.run(wait())


def test_what_threads_write_wakes_every_page_that_waits():
    write_through_the_loop()
    loop = asyncio.new_event_loop()

    async def page(buffer: AsyncMessageBuffer) -> None:
        seen = 0
        while seen < WRITERS * MESSAGES:
            await buffer.message_event.wait()
            buffer.message_event.clear()
            seen = buffer.message_counter

    async def everything() -> None:
        buffer = AsyncMessageBuffer(loop, persistent_messages=False)
        pages = [asyncio.ensure_future(page(buffer)) for _ in range(WAITERS)]

        def write() -> None:
            for _ in range(MESSAGES):
                buffer.push(RemoveNotificationMessage("note"))

        with ThreadPoolExecutor(WRITERS) as pool:
            for _ in range(WRITERS):
                pool.submit(write)
            await asyncio.wait_for(asyncio.gather(*pages), 60.0)

    loop.run_until_complete(everything())
    loop.close()


def test_the_page_is_opened_with_such_events(local):
    assert isinstance(local._websock_server.get_message_buffer().message_event, LoopEvent)


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
    monkeypatch.setattr(page_server, "_documentation_folder", lambda: (folder, ENDINGS[request.param]))
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
    found = documentation(address.partition("#")[0])
    assert found.status_code == 200
    assert found.headers["Content-Type"].startswith("text/plain" if kind == "docs" else "text/html")
    for path in ("../README.md", "%2e%2e/secret.html", "nothing.html", "/etc/passwd", "notebook"):
        assert documentation(PATH + path).status_code == 404
    assert documentation("/") is None and documentation("/docs") is None


def test_without_documentation_no_term_is_a_link(monkeypatch):
    monkeypatch.setattr(page_server, "_documentation_folder", lambda: None)
    assert link("method") == "" and documentation(f"{PATH}method.html").status_code == 404
