"""The scenes and methods that a server offers: chosen by name, a wrong one refused, an edited file loaded again."""

import os
import shutil

import msgspec
import pytest
from fake_twin import FakeLibrary, fake_server
from running import Running
from waiting import until

from motm_twin.bus.client import TwinClient
from motm_twin.bus.commands import Load, Reset, Seed
from motm_twin.bus.library import FileLibrary, MethodLibrary
from motm_twin.measures.reference_tour import reference_tour_s
from motm_twin.methods.registry import METHODS, MOTM, STAA
from motm_twin.model.data_dirs import scenes_dir
from motm_twin.model.names import MethodError
from motm_twin.model.scene_file import load_scene
from motm_twin.record.replay import rerun
from motm_twin.sessions.session import Session, SessionError
from motm_twin.twin import Twin
from motm_twin.ui.what_if import WhatIf

OWN = """
from motm_twin.control.method import Method

SLOW = Method(name="slow", title="Slow", summary="Drives slowly.", source="own", parameters={"next_weight": 0.5})
SAME = Method(name="motm", title="Not the paper's", summary="-", source="own")
"""


@pytest.fixture
def own(tmp_path):
    """A file with a method of a user's."""
    path = tmp_path / "own.py"
    path.write_text(OWN, encoding="utf-8")
    return f"{path}:SLOW"


def test_every_shipped_method_is_offered_and_one_of_a_file_besides(own):
    shipped = [choice.name for choice in MethodLibrary().choices()]
    assert shipped == list(METHODS)
    library = MethodLibrary(own)
    assert library.own_name == "slow"
    assert [choice.name for choice in library.choices()] == [*shipped, "slow"]
    assert library.find("slow").parameters == {"next_weight": 0.5}


def test_a_file_is_no_name_and_no_file_may_take_the_name_of_a_shipped_method(own):
    with pytest.raises(MethodError, match="no method is called"):
        MethodLibrary().find(own)
    with pytest.raises(MethodError, match="'motm', as a shipped method"):
        MethodLibrary(own.replace("SLOW", "SAME"))
    with pytest.raises(MethodError, match="SLOW"):
        MethodLibrary(own.replace("SLOW", "SLOWW"))


def test_a_load_chooses_the_method_and_reset_and_seed_keep_it(running):
    assert running.loop.status().method == "motm"
    assert [choice.name for choice in running.loop.status().methods] == list(METHODS)
    assert running.ask(Load(scene="other", method="staa")) == ""
    assert running.twins[-1].method is STAA
    assert running.ask(Seed(seed=7)) == ""
    status = running.loop.status()
    assert (status.scene, status.variant, status.seed, status.state) == ("other", "a", 7, "paused")
    assert (running.twins[-1].method, running.library.loads[-1]) == (STAA, ("other", "a", 7))
    assert running.ask(Reset()) == ""
    assert (running.loop.status().method, running.loop.status().seed) == ("staa", 7)
    assert running.ask(Load(scene="other")) == ""
    assert (running.loop.status().method, running.twins[-1].method) == ("motm", MOTM)


def test_a_wrong_name_is_refused_with_the_near_ones_and_changes_nothing(own, running):
    assert running.ask(Load(scene="other", method="no_bezierr")).endswith("did you mean no_bezier?")
    for name in (own, "", "x" * 10_000):
        assert running.ask(Load(scene="other", method=name)).startswith("no method is called")
    status = running.loop.status()
    assert (status.scene, status.method, status.run, len(running.twins)) == ("fake", "motm", 1, 1)


def test_a_changed_scene_file_is_loaded_again_under_the_same_method():
    class Edited(FakeLibrary):
        title = "first"

        def load(self, scene, variant, seed):
            return msgspec.structs.replace(super().load(scene, variant, seed), title=self.title)

    with Running(library=Edited()) as running:
        assert running.ask(Load(scene="fake", method="staa")) == ""
        running.library.title = "second"
        running.loop.reload()
        until(lambda: len(running.twins) == 3, "it is not loaded again")
        assert running.twins[-1].method is STAA


def test_a_session_says_its_method_and_is_rerun_with_it():
    first = Load(scene="exp1", variant="trial1", method="staa")
    with Running(Twin, library=FileLibrary("exp1"), first=first) as running:
        running.step(5)
        kept = []
        running.loop.session(lambda payload, info, problem: kept.append(payload))
        session = msgspec.json.decode(until(lambda: kept, "no session")[0], type=Session)
    assert (session.method, session.periods) == ("staa", 6)
    again = rerun(session)
    assert again.ok, again.first_sign
    with pytest.raises(SessionError, match="made with the method 'staa', not with 'motm'"):
        rerun(session, MOTM)


def test_a_method_of_a_file_is_served_by_its_name_and_loaded_again_by_it(own):
    server = fake_server(first=Load(scene="fake", method="slow"), methods=MethodLibrary(own), playing=False)
    with server, TwinClient(server.endpoint) as client:
        status = until(lambda: (s := client.status()) and s.state == "paused" and s, "it does not start")
        assert status.method == "slow"
        assert status.methods[-1].title == "Slow"
        assert client.command(Load(scene="other", method="motm")).ok
        until(lambda: client.status().scene == "other" and client.status().state == "paused", "it is not loaded")
        refused = client.command(Load(scene="fake", method=own))
        assert not refused.ok and refused.reason.startswith("no method is called")
        assert client.command(Load(scene="fake", method="slow")).ok
        until(lambda: client.status().method == "slow", "it is not loaded again")


def test_a_comparison_is_told_where_the_method_of_the_session_is(own):
    what_if = WhatIf(bytes, own_method=("slow", own))
    scene = FakeLibrary().load("fake", None, None)
    assert what_if._method_of(msgspec.json.encode(Session(scene=scene, method="slow"))) == ["--method", own]
    assert what_if._method_of(msgspec.json.encode(Session(scene=scene))) == []


@pytest.fixture
def file(tmp_path):
    return shutil.copy(scenes_dir() / "exp1.yaml", tmp_path / "mine.yaml")


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def watched(running):
    """Heartbeat of the server, by hand."""
    if running.library.changed():
        running.loop.reload()
    return running.loop.status()


def test_a_changed_file_is_told_once_and_only_when_it_is_at_rest(file):
    library = FileLibrary(str(file))
    assert not library.changed()
    library.load("mine", "trial2", None)
    assert not library.changed()
    edit(file, "Experiment 1:", "New:")
    assert [library.changed() for _ in range(4)] == [False, True, False, False]
    os.utime(file, (1.0, 1.0))
    assert [library.changed() for _ in range(3)] == [False, True, False]
    library.load("exp2", None, None)
    edit(file, "New:", "Newer:")
    assert [library.changed() for _ in range(3)] == [False, False, False]


def test_a_saved_scene_is_loaded_again_and_a_wrong_one_leaves_the_old_one_running(file):
    with Running(Twin, library=FileLibrary(str(file)), first=Load(scene="mine", variant="trial2")) as running:
        assert running.loop.status().run == 1
        running.step(5)
        edit(file, "Experiment 1:", "Changed:")
        status = until(lambda: (s := watched(running)).run == 2 and s.state == "paused" and s, "it is not loaded")
        assert (status.text, status.variant) == ("scene file changed: loaded again", "trial2")
        assert running.last.index == 0
        assert running.sink.scenes[-1].title.startswith("Changed:")
        assert next(choice for choice in status.scenes if choice.name == "mine").title.startswith("Changed:")

        running.step(3)
        edit(file, "title:", "titel:")
        status = until(lambda: (s := watched(running)).text.startswith("the scene file") and s, "no error")
        assert "titel" in status.text
        assert "mine.yaml:" in status.text
        running.step(2)
        assert running.loop.status().text == status.text

        edit(file, "titel:", "title:")
        until(lambda: not watched(running).text, "the error stays")
        assert (running.loop.status().run, running.last.index) == (2, 5)


def test_the_bound_of_the_scene_is_told():
    scene = load_scene("exp1")
    library = FileLibrary("exp1")
    with Running(Twin, library=library, first="exp1", reference_tour=reference_tour_s) as running:
        assert running.loop.status().reference_tour == reference_tour_s(scene)
