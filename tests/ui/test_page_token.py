"""The secret of the pages of a user: asked for unless somebody wants none, kept, and nobody else's to read."""

import contextlib
import stat
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from motm_twin.bus import private_folder as running
from motm_twin.cli.serve import OK, _Supervisor, serve, serve_recording
from motm_twin.cli.settings import PageSettings, ReplaySettings, ServeSettings
from motm_twin.ui.page_server import FILE, VARIABLE, check_token, chosen_token, own_token

GIVEN = "0123456789abcdefghijklmnopqrstuv"


@pytest.fixture(autouse=True)
def private(tmp_path, monkeypatch):
    """The private folder of a user who has none yet."""
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return running.folder()


def test_the_own_token_is_strong_private_and_the_same_again(private):
    token = own_token()
    check_token("0.0.0.0", token)
    assert stat.S_IMODE((private / FILE).stat().st_mode) == 0o600
    assert own_token() == token
    assert [path.name for path in private.iterdir()] == [FILE]


@pytest.mark.parametrize("spoilt", ["readable", "empty", "link"])
def test_a_token_that_others_may_know_is_made_anew(private, tmp_path, spoilt):
    before, path = own_token(), private / FILE
    if spoilt == "readable":
        path.chmod(0o644)
    elif spoilt == "empty":
        path.write_bytes(b"")
    else:
        path.rename(tmp_path / "elsewhere")
        path.symlink_to(tmp_path / "elsewhere")
    assert own_token() not in (before, "")
    assert not path.is_symlink()


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
    assert chosen_token(GIVEN, none=False) == GIVEN
    assert chosen_token(None, none=True) is None
    monkeypatch.setenv(VARIABLE, GIVEN)
    assert chosen_token(None, none=False) == GIVEN
    assert chosen_token(None, none=True) is None
    with pytest.raises(ValueError, match="--token and --no-token exclude each other"):
        chosen_token(GIVEN, none=True)


@pytest.fixture
def started(monkeypatch):
    """The processes that would be started."""
    found = []
    monkeypatch.setattr(_Supervisor, "run", lambda self: found.extend(self._children) or OK)
    return found


def page_of(children):
    return next(child for child in children if child.name == "page")


@pytest.mark.parametrize("how", ["twin", "recording"])
def test_the_page_asks_for_a_token_unless_that_is_switched_off(started, how):
    def begin(**wishes):
        started.clear()
        choice = PageSettings(port=0, **wishes)
        done = serve(ServeSettings(page=choice, zenoh_port=0)) if how == "twin" else serve_recording(
            ReplaySettings(file="x.mcap", page=choice, zenoh_port=0)
        )  # fmt: skip
        assert done == OK
        return page_of(started)

    page = begin()
    assert page._env[VARIABLE] == own_token()
    assert "--no-token" not in page._arguments
    assert page._env["PYTHONMALLOC"] == "malloc"  # else a crowd leaves 18 MB
    assert not any(own_token() in word for word in page._arguments)  # which everybody can read
    assert begin(token=GIVEN)._env[VARIABLE] == GIVEN
    open_to_all = begin(no_token=True, names=("lab.example",))
    assert VARIABLE not in open_to_all._env
    assert "--no-token" in open_to_all._arguments
    assert open_to_all._arguments[-2:] == ["--name", "lab.example"]
    others = [child for child in started if child.name != "page"]
    assert others
    assert not any(VARIABLE in child._env for child in others)


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
    assert "http://127.0.0.1:1/?token=x" in said
    assert says in said


def test_a_private_folder_of_somebody_else_is_a_sentence(monkeypatch, capsys, started):
    def somebody_elses():
        raise PermissionError("it belongs to somebody else")

    monkeypatch.setattr("motm_twin.ui.page_server.folder", somebody_elses)
    assert serve(ServeSettings(page=PageSettings(port=0), zenoh_port=0)) == 2
    assert "belongs to somebody else" in capsys.readouterr().out
