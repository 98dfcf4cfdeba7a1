"""Pages: how many at once, how much each may send, and the secret of a user; and the reader that is one of them."""

import asyncio
import contextlib
import socket
import stat
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress

import numpy as np
import pytest
from page import get, until
from websockets.exceptions import ConnectionClosed, InvalidStatus

from motm_twin.bus import private_folder as running
from motm_twin.cli.serve import OK, _Supervisor, serve, serve_recording
from motm_twin.cli.settings import PageSettings, ReplaySettings, ServeSettings
from motm_twin.perf.page import rise, slopes
from motm_twin.perf.page_reader import SMALL, Load, PageReader, alike
from motm_twin.ui import page_server
from motm_twin.ui.page_server import Allowance, PageLimit, check_token, chosen_token, open_page, own_token

MOST = 3


@pytest.fixture
def page():
    server = open_page("127.0.0.1", 0, visitors=MOST)
    yield server
    server.stop()


def test_one_page_too_many_is_told_so_and_comes_in_when_another_leaves(page):
    port = page.get_port()
    readers = [PageReader(port) for _ in range(MOST)]
    with pytest.raises(InvalidStatus, match="503"):
        PageReader(port)
    answer = get(page)
    assert answer.status == 503
    assert answer.body.decode() == f"{MOST} pages of this twin are open already: close one, or start it with --visitors"
    readers.pop().close()
    until(lambda: get(page).status == 200)
    readers.append(PageReader(port))
    for reader in readers:
        reader.close()


def test_connections_that_break_off_are_not_counted(page):
    for _ in range(5 * MOST):
        with PageReader(page.get_port()) as reader:
            reader._socket.socket.shutdown(socket.SHUT_RDWR)
        until(lambda: get(page).status == 200)


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
    allowance = Allowance(page_server.MESSAGES, page_server.BURST, 0.0)
    for step in range(60 * 60):  # a minute of a camera that moves
        assert allowance.take(1.0, step / 60.0) == 0.0
    waited, now = 0.0, 100.0
    for _ in range(10_000):
        wait = allowance.take(1.0, now)
        waited, now = waited + wait, now + wait
    assert waited == pytest.approx((10_000 - page_server.BURST) / page_server.MESSAGES, rel=0.01)


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
    assert sum(slept) == pytest.approx((3000 * 20_000 - page_server.BYTES_BURST) / page_server.BYTES, rel=0.05)


def test_a_message_that_is_too_large_ends_its_page_only(page):
    with PageReader(page.get_port()) as other, PageReader(page.get_port()) as large:

        def pings(reader):
            with suppress(ConnectionClosed, OSError):
                reader._socket.ping()
                return True

        with suppress(ConnectionClosed, OSError):
            large._socket.send(bytes(page_server.LARGEST + 1))
        until(lambda: not pings(large))
        assert pings(other)


def test_no_page_at_all_is_refused():
    with pytest.raises(ValueError, match="at least one page"):
        open_page("127.0.0.1", 0, visitors=0)
    assert page_server.VISITORS == 50


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


GIVEN = "0123456789abcdefghijklmnopqrstuv"


@pytest.fixture(autouse=True)
def private(tmp_path, monkeypatch):
    """The private folder of a user who has none yet."""
    monkeypatch.delenv(page_server.VARIABLE, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return running.folder()


def test_the_own_token_is_strong_private_and_the_same_again(private):
    token = own_token()
    check_token("0.0.0.0", token)
    assert own_token() == token
    (path,) = private.iterdir()
    assert (path.name, stat.S_IMODE(path.stat().st_mode)) == (page_server.FILE, 0o600)


@pytest.mark.parametrize("spoilt", ["readable", "empty", "link"])
def test_a_token_that_others_may_know_is_made_anew(private, tmp_path, spoilt):
    before, path = own_token(), private / page_server.FILE
    if spoilt == "readable":
        path.chmod(0o644)
    elif spoilt == "empty":
        path.write_bytes(b"")
    else:
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    assert own_token() not in (before, "") and not path.is_symlink()


def test_two_that_begin_at_once_have_one_token(monkeypatch):
    kept, both = running._kept, threading.Barrier(2)

    def looks_while_another_looks(path):
        found = kept(path)
        with contextlib.suppress(threading.BrokenBarrierError):
            time.sleep(0.1 * both.wait(0.2))  # one goes on first
        return found

    monkeypatch.setattr(running, "_kept", looks_while_another_looks)
    with ThreadPoolExecutor(2) as pool:
        assert len(set(pool.map(lambda _: own_token(), range(2)))) == 1


def test_what_is_wished_for_counts_before_the_own_one(monkeypatch):
    assert chosen_token(None, none=False) == own_token()
    assert chosen_token(GIVEN, none=False) == GIVEN and chosen_token(None, none=True) is None
    monkeypatch.setenv(page_server.VARIABLE, GIVEN)
    assert chosen_token(None, none=False) == GIVEN and chosen_token(None, none=True) is None
    with pytest.raises(ValueError, match="--token and --no-token exclude each other"):
        chosen_token(GIVEN, none=True)


@pytest.fixture
def started(monkeypatch):
    """The processes that would be started."""
    found = []
    monkeypatch.setattr(_Supervisor, "run", lambda self: found.extend(self._children) or OK)
    return found


@pytest.mark.parametrize("how", ["twin", "recording"])
def test_the_page_asks_for_a_token_unless_that_is_switched_off(started, how):
    def begin(**wishes):
        started.clear()
        given = {"page": PageSettings(port=0, **wishes), "zenoh_port": 0}
        twin = how == "twin"
        assert (serve(ServeSettings(**given)) if twin else serve_recording(ReplaySettings(file="x", **given))) == OK
        return next(child for child in started if child.name == "page")

    page = begin()
    assert page._env[page_server.VARIABLE] == own_token()
    assert "--no-token" not in page._arguments
    assert page._env["PYTHONMALLOC"] == "malloc"  # else a crowd leaves 18 MB
    assert not any(own_token() in word for word in page._arguments)  # which everybody can read
    assert begin(token=GIVEN)._env[page_server.VARIABLE] == GIVEN
    open_to_all = begin(no_token=True, names=("lab.example",))
    assert "--no-token" in open_to_all._arguments
    assert open_to_all._arguments[-2:] == ["--name", "lab.example"]
    assert len(started) > 1 and not any(page_server.VARIABLE in child._env for child in started)


def test_no_token_is_for_this_machine_only(started, capsys):
    assert serve(ServeSettings(page=PageSettings(port=0, host="0.0.0.0", no_token=True), zenoh_port=0)) == 2
    assert "--no-token is for this machine only" in capsys.readouterr().out
    assert started == []


@pytest.mark.parametrize(
    ("no_token", "says"),
    [(False, "anybody with this address may look and drive"), (True, "anybody on this machine may look and drive")],
)
def test_who_may_drive_is_told_with_the_address(monkeypatch, capsys, no_token, says):
    def run(supervisor):
        supervisor._tell({"event": "page", "url": "http://127.0.0.1:1/?token=x", "port": 1})
        supervisor._note.unlink()
        return OK

    monkeypatch.setattr(_Supervisor, "run", run)
    serve(ServeSettings(page=PageSettings(port=0, no_token=no_token), zenoh_port=0))
    said = capsys.readouterr().out
    assert "http://127.0.0.1:1/?token=x" in said and says in said


def test_a_private_folder_of_somebody_else_is_a_sentence(monkeypatch, capsys, started):
    def somebody_elses():
        raise PermissionError("it belongs to somebody else")

    monkeypatch.setattr("motm_twin.ui.page_server.folder", somebody_elses)
    assert serve(ServeSettings(page=PageSettings(port=0), zenoh_port=0)) == 2
    assert "belongs to somebody else" in capsys.readouterr().out


@pytest.fixture
def server():
    server = open_page("127.0.0.1", 0)
    yield server
    server.stop()


def test_it_is_a_visitor_that_sees_widgets_and_nodes_and_counts_what_moves(server):
    server.gui.add_checkbox("Paths", False)
    still = server.scene.add_frame("/still")
    moving = server.scene.add_frame("/moving")
    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: reader.replayed is not None and reader.find("Paths", "Checkbox"), 10.0)
        assert reader.wait(lambda _: len(server.get_clients()) == 1, 10.0)  # named a moment after it got the scene
        assert reader.bytes > 0
        reader.moved()
        moving.position = (1.0, 0.0, 0.0)
        moving.wxyz = (0.0, 0.0, 0.0, 1.0)
        assert reader.wait(lambda reader: len(reader.moving["pose"]) == 1, 10.0)
        assert (reader.moved(), reader.moved()) == (1, 0)
    assert still.position[0] == 0.0


def test_it_changes_widgets_as_a_page_does(server):
    box, button = server.gui.add_checkbox("Paths", False), server.gui.add_button("Play")
    changed, clicked = threading.Event(), threading.Event()
    box.on_update(lambda _: changed.set())
    button.on_click(lambda _: clicked.set())
    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: reader.find("Play"), 10.0)
        assert reader.set("Paths", True, "Checkbox")
        assert reader.set("Play", True)
        assert not reader.set("Fly", True)
        assert changed.wait(10.0) and clicked.wait(10.0)
    assert box.value is True


def test_it_drags_a_node_from_start_to_end(server):
    node, phases, ended = server.scene.add_box("/temi", dimensions=(1.0, 1.0, 1.0)), [], threading.Event()

    @node.on_drag("left")
    async def _(event):
        phases.append((event.phase, event.end_position[0]))
        if event.phase == "end":
            ended.set()

    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: "/temi" in reader.draggable, 10.0)
        reader.drag("/temi", np.zeros(3), np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]), 0.01)
        assert ended.wait(10.0)
    assert phases == [("start", 0.0), ("update", 0.1), ("update", 0.2), ("end", 0.2)]


def test_a_picture_is_complete_when_it_is_first_the_one_that_stays():
    blank = np.full((SMALL[1], SMALL[0], 3), 255.0)
    half, whole = blank.copy(), blank.copy()
    half[:50] = 40.0
    whole[::2] = 0.0
    little = whole.copy()
    little[0, 0] = 90.0
    assert alike(whole, little)
    assert not alike(whole, half)
    load = Load(pictures=[(0.5, blank), (1.0, half), (2.0, whole), (2.5, little), (3.0, whole)])
    assert load.complete_at == 2.0
    assert np.isnan(Load(pictures=[(0.5, blank)]).complete_at)
    assert np.isnan(Load().complete_at)


def test_slopes_of_both_halves_and_whether_the_second_is_steeper():
    time = np.linspace(0.0, 10.0, 201)
    value = np.where(time < 5.0, 100.0 * time, 500.0 + 2.0 * (time - 5.0))
    early, late = slopes(time, value)
    assert (early.value, late.value) == (pytest.approx(100.0), pytest.approx(2.0))
    assert rise(early, late) < 0.0
    noise = np.random.default_rng(0).normal(0.0, 1.0, len(time))
    assert rise(*slopes(time, noise)) <= 0.0
    assert rise(*slopes(time, noise + time**2)) > 0.0
    assert np.isnan(rise(*slopes(time, value * np.nan)))
    assert np.isnan(rise(*slopes(time[:9], value[:9])))
