"""The page looks as it did when somebody last looked at it. To renew: python tools/picture.py --references"""

import os
import shutil
import subprocess

import pytest
import states
from PIL import Image


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_the_page_looks_like_its_reference_pictures(browser, begun, tmp_path):
    require_fonts()
    scene, visitor = "exp1", states.visitor(browser, begun("exp1", play=False))
    for name, state in states.STATES.items():
        if state.scene[0] != scene:
            scene = state.scene[0]
            begun(scene, play=False)
            visitor.anew(visitor.page.viewport_size)
        state.show(visitor)
        picture = states.screenshot(visitor)
        picture.save(tmp_path / f"{name}.png")
        reference = Image.open(states.FOLDER / f"{name}.png").convert("RGB")
        apart = states.difference(picture, reference)
        assert states.alike(apart), (
            f"{tmp_path / name}.png differs from its reference: {apart} (levels, share of pixels); if it is "
            "as wanted, renew it with tools/picture.py --references"
        )
    visitor.page.close()


def require_fonts():
    """A skip (a failure where a browser is required) with other letters than those of the references."""
    if shutil.which("fc-match") is None:  # nobody can say: the pictures will tell
        return
    asked = ["fc-match", "-f", "%{family}", "Arial"]
    family = subprocess.run(asked, capture_output=True, check=True, text=True).stdout
    if "Liberation Sans" in family:
        return
    reason = f"the references are written in Liberation Sans, not {family}: install fonts-liberation"
    if os.environ.get("MOTM_REQUIRE_BROWSER") == "1":
        pytest.fail(reason)
    pytest.skip(reason)


def test_references_are_small_and_a_changed_picture_is_noticed():
    for name in states.STATES:
        path = states.FOLDER / f"{name}.png"
        assert path.stat().st_size < 150_000
        reference = Image.open(path).convert("RGB")
        assert reference.size == states.SIZE
        assert states.difference(reference, reference) == {"whole": (0.0, 0.0), "scene": (0.0, 0.0)}
        for hole in ((100, 100, 300, 250), (650, 100, 900, 400)):
            darker = reference.copy()
            darker.paste((90, 90, 90), hole)
            assert not states.alike(states.difference(darker, reference))
