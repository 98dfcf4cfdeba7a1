"""Every example runs against a real twin, and the texts show the examples as they are."""

import re
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest
from waiting import until

from motm_twin.bus.commands import Load
from motm_twin.bus.library import FileLibrary, TwinSetup
from motm_twin.bus.server import TwinServer
from motm_twin.client import connect
from motm_twin.twin import Twin

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    with TwinServer(
        TwinSetup(library=FileLibrary("exp1"), make_twin=Twin, first=Load(scene="exp1")), data=data
    ) as running:
        until(lambda: running.loop.status().state == "playing", "the twin never started", 240.0)
        yield running


def run(name, *arguments):
    done = subprocess.run(
        [sys.executable, EXAMPLES / name, *arguments], capture_output=True, text=True, timeout=200.0, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_a_program_with_zenoh_alone_reads_commands_and_hears(server):
    said = run("plain_zenoh.py", server.endpoint)
    assert "exp1 trial1 is playing" in said
    assert "was refused: 'nobody'" in said or "nobody" in said
    assert "edit: add obstacle example_box" in said
    assert said.endswith("done\n")


def test_the_plain_example_needs_nothing_of_this_package():
    for name in ("plain_zenoh.py", "listen.py"):
        assert "motm_twin" not in (EXAMPLES / name).read_text(encoding="utf-8"), name


@pytest.mark.parametrize(("name", "endpoint"), [("plain_zenoh.py", "tcp/127.0.0.1:9"), ("robot_skeleton.py", "foo")])
def test_an_example_of_plain_zenoh_says_in_one_line_that_nobody_answers(name, endpoint):
    done = subprocess.run([sys.executable, EXAMPLES / name, endpoint], capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.startswith(f"nobody answers at {endpoint}: start `motm-twin serve")
    assert done.stderr.count("\n") == 1


def test_listening_prints_ticks(server):
    command = [sys.executable, EXAMPLES / "listen.py", server.endpoint]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        line = process.stdout.readline()
        process.terminate()
    assert line.startswith('motm/frankie/tick {"version":"motm.tick/1"')


def test_the_speed_is_plotted(server, tmp_path):
    pytest.importorskip("matplotlib")
    said = run("plot_speed.py", "--endpoint", server.endpoint, "--seconds", "1", "--save", str(tmp_path / "speed.png"))
    assert len(said.splitlines()) > 5
    assert (tmp_path / "speed.png").read_bytes().startswith(b"\x89PNG")


def test_an_obstacle_chases_the_robot(server):
    said = run("chasing_obstacle.py", "--endpoint", server.endpoint, "--seconds", "2")
    assert said.startswith("chased for 2.")


@pytest.mark.slow
def test_the_rig_runs_a_scene_at_full_speed_and_asserts(server):
    said = run("test_rig.py", "exp1", "--variant", "trial1", "--places", "1", "--endpoint", server.endpoint)
    assert said.startswith("1 placed after")
    assert "picked" in said
    assert "placed" in said


def test_a_twin_that_is_not_there_is_one_sentence():
    command = [sys.executable, EXAMPLES / "plot_speed.py", "--endpoint", "tcp/127.0.0.1:9"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert line.startswith("no twin is running at tcp/127.0.0.1:9")


@pytest.mark.slow
def test_what_the_text_shows_waits_for_the_last_cube(server, capsys):
    text, shown = "docs/zenoh.md", r"(?<=```python\n)from motm_twin\.client import connect\n[^`]+"
    with connect(server.endpoint) as twin:
        twin.load("exp1", "trial1")
        twin.speed(8.0)
        twin.hand_over()
    program = textwrap.dedent(re.search(shown, (ROOT / text).read_text(encoding="utf-8"), re.M)[0])
    one_cube = "    for _ in range(5):\n        twin.remove_task(2)\n    twin.play()\n"
    assert program.count("    twin.play()\n") == 1
    program = program.replace("    twin.play()\n", one_cube)
    here = {}
    exec(program.replace("connect()", f"connect({server.endpoint!r})"), here)  # noqa: S102 - our own text
    said = capsys.readouterr().out
    assert "places=1" in (str(here["tick"].score) if "tick" in here else said)


def test_what_the_text_shows_is_the_example():
    page = (ROOT / "docs" / "zenoh.md").read_text(encoding="utf-8")
    listen, send, ours = re.findall(r"```python\n(.*?)```", page, re.S)
    assert listen == (EXAMPLES / "listen.py").read_text(encoding="utf-8"), "examples/listen.py is shown otherwise"
    assert f"\n\n{send}\n\n" in (EXAMPLES / "plain_zenoh.py").read_text(encoding="utf-8")
    assert "motm_twin" not in listen + send and "from motm_twin.client import connect" in ours
