"""The command line: a signal at any moment of its start, and a standard output that is full, closed or unread."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from motm_twin.cli.serve import _Supervisor
from motm_twin.processes import interrupt_deferred
from motm_twin.program import plain_console

PIPE = subprocess.PIPE
# Sends itself a signal when a module is about to be imported.
WHEN = """
import builtins, os, signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a background job
loaded = builtins.__import__
def interrupted(name, *others):
    if name.startswith({module!r}):
        builtins.__import__ = loaded
        os.kill(os.getpid(), {number})
    return loaded(name, *others)
builtins.__import__ = interrupted
sys.argv = ["motm-twin", *{words!r}]
from motm_twin.__main__ import main
main()
"""
SERVE = ("serve", "exp1", "--port", "0", "--zenoh-port", "0")


@pytest.mark.parametrize(
    ("module", "words", "number"),
    [
        ("tyro", SERVE, signal.SIGINT),
        ("tyro", SERVE, signal.SIGTERM),
        ("motm_twin.cli.serve", SERVE, signal.SIGTERM),
        ("viser", SERVE, signal.SIGINT),
        ("numba", ("run", "exp1"), signal.SIGINT),
        ("motm_twin.external.robot_server", ("robot", "exp1"), signal.SIGINT),
        ("motm_twin.client.discover", ("record", "x.mcap"), signal.SIGTERM),
    ],
)
def test_a_signal_while_it_starts_is_one_line(module, words, number):
    code = WHEN.format(module=module, number=int(number), words=list(words))
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (128 + number, "", "motm-twin: stopped\n")


@pytest.mark.parametrize("first", [["motm-twin"], ["/usr/bin/motm-twin", "serve"]])
def test_a_signal_as_soon_as_the_package_of_the_command_is_there_is_one_line(first):
    """Before even the module that runs it was imported."""
    code = (
        "import os, signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler);"
        f"sys.argv = {first}; import motm_twin; os.kill(os.getpid(), signal.SIGINT)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stderr) == (130, "motm-twin: stopped\n")


def test_a_program_that_imports_the_package_keeps_its_own_signals():
    code = "import signal; before = signal.getsignal(2); import motm_twin; assert signal.getsignal(2) is before"
    assert subprocess.run([sys.executable, "-c", code], timeout=60, check=False).returncode == 0


@pytest.mark.parametrize("words", [("scene", "list"), ("--help",)])
def test_a_full_standard_output_is_a_sentence(words):
    with Path("/dev/full").open("wb") as full:
        command = [sys.executable, "-m", "motm_twin", *words]
        done = subprocess.run(command, stdout=full, stderr=PIPE, text=True, timeout=60, check=False)
    said = "motm-twin: standard output cannot be written: No space left on device\n"
    assert (done.returncode, done.stderr) == (2, said)


@pytest.mark.parametrize("closed", [(1,), (0, 1, 2)])
def test_closed_standard_files_are_as_if_nobody_read_them(closed):
    def close():
        for number in closed:
            os.close(number)

    command = [sys.executable, "-m", "motm_twin", "scene", "list"]
    done = subprocess.run(command, stderr=PIPE, text=True, timeout=60, check=False, preexec_fn=close)
    assert (done.returncode, done.stderr) == (0, "")


def test_serve_goes_on_when_nobody_reads_it_or_the_disk_is_full():
    read, unread = os.pipe()
    os.close(read)
    for descriptor in (unread, os.open("/dev/full", os.O_WRONLY)):
        console = plain_console()
        console.file = os.fdopen(descriptor, "w", encoding="utf-8")
        supervisor = _Supervisor(console, "frankie", 7447, None)
        for _ in range(3):
            supervisor._tell({"event": "state", "state": "paused", "text": "x" * 10_000})
        os.dup2(os.open(os.devnull, os.O_WRONLY), descriptor)  # what waits to be written goes there


def test_ctrl_c_is_put_off_but_not_lost():
    done = []
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # a background job ignores it
    try:
        with pytest.raises(KeyboardInterrupt), interrupt_deferred():
            signal.pthread_kill(threading.get_ident(), signal.SIGINT)
            done.append("the block")
    finally:
        signal.signal(signal.SIGINT, before)
    assert done == ["the block"]
