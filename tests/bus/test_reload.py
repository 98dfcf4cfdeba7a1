"""A scene file that is edited while it runs, with the real twin."""

import os
import shutil

import pytest
from running import Running
from waiting import until

from motm_twin.bus.commands import Load
from motm_twin.bus.library import FileLibrary
from motm_twin.measures.reference_tour import reference_tour_s
from motm_twin.model.data_dirs import scenes_dir
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin


@pytest.fixture
def file(tmp_path):
    return shutil.copy(scenes_dir() / "exp1.yaml", tmp_path / "mine.yaml")


def edit(file, old, new):
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))


def watched(running):
    """What the heartbeat of the server does."""
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
