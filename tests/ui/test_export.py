"""The last seconds as a page that plays from a file, and the page beside pictures of how it looked.

To renew those: python tools/picture.py --references
"""

import io
import os
import shutil
import subprocess

import msgspec
import numpy as np
import pytest
import states
from fake_twin import FakeTwin, fake_scene
from page import LIGHTLY, chromium
from PIL import Image

from motm_twin.bus.encode import grid_bytes, grid_info, tick_message
from motm_twin.ui.colours import ground_table
from motm_twin.ui.export import ExportFailed, Ground, export_html, record
from motm_twin.ui.history import History

SLOW = 120_000  # [ms] software rendering on a busy machine


@pytest.fixture(scope="module")
def history():
    twin, kept = FakeTwin(fake_scene()), History()
    for _ in range(81):
        tick = twin.advance()
        kept.add(msgspec.json.encode(tick_message(tick, 1, 0.0)))
        kept.add_grid(grid_bytes(tick.map), msgspec.json.encode(grid_info(tick.map, 1)))
    return kept


def scene():
    return msgspec.structs.replace(fake_scene(), title="Circles </title><img src=x onerror=alert(1)>")


def test_frames_are_thinned_to_the_rate(history):
    assert len(record(history, scene(), 2.0, 20.0).frames) == 41
    assert len(record(history, scene(), 2.0, 10.0).frames) == 21
    assert len(record(history, scene(), 1e9, 20.0).frames) == 81


def test_nothing_recorded_is_a_sentence_not_a_page():
    with pytest.raises(ExportFailed, match="let the robot move first"):
        export_html(History(), scene(), 10.0)


def test_a_process_that_fails_tells_why(history):
    with pytest.raises(ExportFailed, match="took more than 0 s"):
        export_html(history, scene(), 1.0, timeout=0.01)


def test_pictures_of_the_ground_come_back_from_what_differs_between_them():
    rng, ground, table = np.random.default_rng(1), Ground(), ground_table()
    shown = [rng.integers(0, 256, (300, 250), dtype=np.uint8)]
    for count in (40, 0, 75_000):  # a few cells, none, all
        changed = shown[-1].copy()
        changed.flat[rng.permutation(changed.size)[:count]] ^= 77
        shown.append(changed)

    def png(cells):
        file = io.BytesIO()
        Image.fromarray(table[cells]).save(file, "png")
        return file.getvalue()

    assert [ground.add(png(cells)) for cells in shown] == [0, 1, 2, 3]
    assert ground.add(png(shown[0][:-1])) is None, "of another size"
    cells = np.zeros(shown[0].size, dtype=np.uint8)
    for number, (gaps, bits) in enumerate(ground.steps):
        cells[np.cumsum(gaps, dtype=int)] ^= bits
        assert np.array_equal(table[cells.reshape(shown[0].shape)], table[shown[number]])
    assert len(ground.steps[1][0]) < 50


def test_the_page_plays_from_a_file_without_a_server(history, tmp_path):
    told = []
    path = tmp_path / "page.html"
    path.write_bytes(export_html(history, scene(), 4.0, told.append))
    assert told == sorted(told)
    assert told[-1] == 1.0
    with chromium() as browser:
        page = browser.new_page(viewport={"width": 640, "height": 400})
        page.add_init_script(path=LIGHTLY)
        errors, requests = [], []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        page.locator("canvas").first.wait_for(timeout=SLOW)
        assert page.title().startswith(scene().title)
        first = picture(page)
        while first.std() < 10.0:  # not drawn yet
            first = picture(page)
        while np.abs(picture(page) - first).max() < 50.0:  # the robot is still where it was
            page.wait_for_timeout(200)
        moves_in_time(page)
        assert not errors
        assert [url for url in requests if not url.startswith(("file:", "data:", "blob:"))] == []
        assert page.locator("img[src=x]").count() == 0


def moves_in_time(page):
    """Back to the start by the timeline, and on again; the picture and the sentence go along."""
    track, clock = page.get_by_role("slider", name="Time", exact=True), page.locator("#motm .clock")
    assert page.locator(".says").inner_text().endswith(".")
    box = track.bounding_box()
    for share in (0.0, 1.0, 0.0):
        before = picture(page)
        page.mouse.click(box["x"] + 1 + share * (box["width"] - 2), box["y"] + box["height"] / 2)
        first, last = (float(track.get_attribute(f"aria-value{end}")) for end in ("min", "max"))
        while abs(float(clock.inner_text().split()[0]) - (last if share else first)) > 0.1:  # with the next frame
            page.wait_for_timeout(20)
        while np.abs(picture(page) - before).max() < 50.0:
            page.wait_for_timeout(200)
    page.get_by_role("button", name="Play", exact=True).click()
    while float(clock.inner_text().split()[0]) < first + 0.5:
        page.wait_for_timeout(100)


def picture(page):
    shot = page.screenshot(timeout=SLOW, clip={"x": 0, "y": 60, "width": 640, "height": 280})
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=float)


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
