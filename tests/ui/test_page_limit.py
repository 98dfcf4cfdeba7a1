"""At most so many pages at once, and no more from each than it may send; memory is given back."""

import asyncio
import http.client
import socket
import subprocess
import sys
import time
from contextlib import suppress

import pytest
from page import until
from websockets.exceptions import ConnectionClosed, InvalidStatus

from motm_twin.perf.page_reader import PageReader
from motm_twin.ui.page_server import (
    BURST,
    BYTES,
    BYTES_BURST,
    LARGEST,
    MESSAGES,
    VISITORS,
    Allowance,
    PageLimit,
    open_page,
)

MOST = 3


@pytest.fixture
def page():
    server = open_page("127.0.0.1", 0, visitors=MOST)
    yield server
    server.stop()


def status(port):
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
    connection.request("GET", "/")
    answer = connection.getresponse()
    text = answer.read()
    connection.close()
    return answer.status, text


def test_one_page_too_many_is_told_so_and_comes_in_when_another_leaves(page):
    port = page.get_port()
    readers = [PageReader(port) for _ in range(MOST)]
    with pytest.raises(InvalidStatus, match="503"):
        PageReader(port)
    code, text = status(port)
    assert code == 503
    assert text.decode() == f"{MOST} pages of this twin are open already: close one, or start it with --visitors"
    readers.pop().close()
    until(lambda: status(port)[0] == 200)
    readers.append(PageReader(port))
    for reader in readers:
        reader.close()


def test_connections_that_break_off_are_not_counted(page):
    for _ in range(5 * MOST):
        with PageReader(page.get_port()) as reader:
            reader._socket.socket.shutdown(socket.SHUT_RDWR)
        until(lambda: status(page.get_port())[0] == 200)


def test_a_page_that_is_not_counted_yet_when_the_last_place_is_taken_is_closed():
    closed = []

    class Late:
        async def close(self, code, text):
            closed.append((code, text))

    limit = PageLimit(1)
    limit.here = 1
    asyncio.run(limit.bounded(None)(Late()))
    assert closed == [(1013, limit.text())]
    assert limit.here == 1


def test_a_page_sends_as_fast_as_people_move_and_no_faster():
    allowance = Allowance(MESSAGES, BURST, 0.0)
    for step in range(60 * 60):  # a minute of a camera that moves
        assert allowance.take(1.0, step / 60.0) == 0.0
    waited, now = 0.0, 100.0
    for _ in range(10_000):
        wait = allowance.take(1.0, now)
        waited, now = waited + wait, now + wait
    assert waited == pytest.approx((10_000 - BURST) / MESSAGES, rel=0.01)


def test_a_flood_is_read_at_the_rate_that_is_allowed():
    read, slept = [], []

    class Flood:
        def __init__(self):
            self.left = 3000

        async def recv(self):
            self.left -= 1
            if self.left < 0:
                raise EOFError
            return b"x" * 20_000

    async def handler(connection):
        while True:
            read.append(len(await connection.recv()))

    async def run(monkeypatch):
        clock = [0.0]

        async def sleep(seconds):
            slept.append(seconds)
            clock[0] += seconds

        monkeypatch.setattr("motm_twin.ui.page_server.asyncio.sleep", sleep)
        monkeypatch.setattr("motm_twin.ui.page_server.time.monotonic", lambda: clock[0])
        with pytest.raises(EOFError):
            await PageLimit().bounded(handler)(Flood())

    with pytest.MonkeyPatch.context() as patch:
        asyncio.run(run(patch))
    assert len(read) == 3000
    assert sum(slept) == pytest.approx((3000 * 20_000 - BYTES_BURST) / BYTES, rel=0.05)


def test_a_message_that_is_too_large_ends_its_page_only(page):
    with PageReader(page.get_port()) as other, PageReader(page.get_port()) as large:

        def pings(reader):
            try:
                reader._socket.ping()
            except (ConnectionClosed, OSError):
                return False
            return True

        with suppress(ConnectionClosed, OSError):
            large._socket.send(bytes(LARGEST + 1))
        until(lambda: not pings(large))
        assert pings(other)


def test_no_page_at_all_is_refused():
    with pytest.raises(ValueError, match="at least one page"):
        open_page("127.0.0.1", 0, visitors=0)
    assert VISITORS == 50


@pytest.mark.parametrize("loaded", [True, False], ids=["with a panel", "broken off before"])
def test_memory_is_given_back_after_pages_have_left(page, monkeypatch, loaded):
    """Once for all that leave at about the same time."""
    given = []
    monkeypatch.setattr("motm_twin.ui.page_server.give_back", lambda: given.append(time.monotonic()))
    if not loaded:
        monkeypatch.setattr(PageReader, "send", lambda *_: None)
    readers = [PageReader(page.get_port()) for _ in range(MOST)]
    for reader in readers:
        reader.close()
    until(lambda: given)
    assert len(given) == 1


def test_what_is_free_goes_back_to_the_system():
    """In a process of its own: 60 MB in pieces, of which the last one stays."""
    code = (
        "import ctypes; from motm_twin.program import give_back\n"
        "mb = lambda: int(open('/proc/self/statm').read().split()[1]) * 4096 / 1e6\n"
        "pieces = [bytearray(60_000) for _ in range(1000)]; last = bytearray(60_000); full = mb()\n"
        "loop = [pieces]; loop.append(loop); del pieces, loop\n"
        "give_back(); print(full - mb())"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert float(done.stdout) > 40.0
