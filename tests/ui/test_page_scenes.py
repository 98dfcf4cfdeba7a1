"""The page in Chromium: every shipped scene is chosen by mouse and runs, in its last variant."""

import pytest
from page import serving, until, visiting

from motm_twin.bus.library import FileLibrary

PERIODS = 3  # that a scene must run
LITTLE = {"width": 720, "height": 440}  # the lists are the point here, and drawing takes time


@pytest.mark.browser
@pytest.mark.timeout(900)
def test_every_shipped_scene_is_chosen_by_mouse_and_runs():
    """All variants are offered; every one is loaded by the page's own messages in `test_page_drive`."""
    with serving("exp1") as twin, visiting(twin, LITTLE) as visitor:
        client, page = twin.client, visitor.page
        visitor.unfold("Scene")
        choices = sorted(FileLibrary("exp1").choices(), key=lambda choice: choice.name == "exp1")  # that one runs
        scenes = visitor.offered("Scene")
        assert scenes == [choice.name for choice in FileLibrary("exp1").choices()]
        assert {"exp1", "exp2", "playground"} <= set(scenes)
        for choice in choices:
            visitor.choose("Scene", choice.name)
            until(lambda c=choice: visitor.offered("Variant") == c.variants, 30.0, f"other variants for {choice.name}")
            run, variant = client.tick().run, choice.variants[-1]
            visitor.choose("Variant", variant)
            visitor.press("Load")
            loaded = f"{choice.name} / {variant}"
            try:
                until(lambda run=run: client.tick().run > run and client.tick().index > PERIODS, 60.0, "not loaded")
            except AssertionError as error:
                raise AssertionError(f"{loaded}: {client.status()}\n{page.inner_text('body')}") from error
            assert (client.status().scene, client.status().variant) == (choice.name, variant)
            visitor.says(loaded)
            visitor.state("Running")
            assert visitor.picture().std() > 10.0  # something is drawn
        assert page.get_by_text("This did not work").count() == 0
        assert visitor.errors == []
