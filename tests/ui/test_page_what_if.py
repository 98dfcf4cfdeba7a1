"""The page in Chromium: looking back, then a what-if from that moment with a parameter that is changed by mouse."""

import re
import time

import numpy as np
import pytest
from page import until, visiting

from motm_twin.ui.colours import OTHERS
from motm_twin.ui.panel.tune_tab import SHOWN, WATCH

TINTED = 100  # pixels of a robot that must be seen
DIFFERENT = 20.0  # [grey levels]
WATCHED = 20.0  # [s] after which both runs have been shown
SLIDER = "Smallest ring"


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_a_what_if_from_an_earlier_moment_by_mouse_shows_both_robots_and_both_times(browser, begun):
    with visiting(browser, begun("room", "delivery")) as visitor:
        client, page = visitor.twin.client, visitor.page
        visitor.speed("8x")
        until(lambda: client.status().state == "done", 240.0, "the run does not end")
        visitor.state("Finished")
        newest = client.tick()

        visitor.tab("Replay")
        visitor.look_back_to(0.1)
        visitor.says("Looking back")
        period = until(lambda: 0 < shown(page) < newest.index // 2 and shown(page), 30.0, "it does not look back")

        visitor.tab("Tune")
        page.get_by_label("Try in what-if only").click()
        visitor.choose("Changed", SHOWN)
        before = dict(client.status().parameters)
        slide(visitor, SLIDER, 0.95)
        visitor.says(f"● {SLIDER}")
        visitor.press("Compare")
        visitor.says(f"the same until {period * 0.05:.1f} s")
        visitor.button("Clear the comparison").wait_for(timeout=180_000)
        rows = compared(visitor)
        was, changed = map(seconds, rows["time"])
        assert newest.time - 4.0 < was <= newest.time  # the settling at the end is not counted
        assert changed > period * 0.05
        assert any(cell != other for cell, other in rows.values())
        assert client.tick().index == newest.index  # the twin itself stays as it is
        assert dict(client.status().parameters) == before

        visitor.tab("Tune")
        alone = visitor.picture()
        watch_until(visitor, lambda: min(tinted(visitor, alone)) > TINTED, "not both robots are seen")
        visitor.press("Clear the comparison")
        visitor.says("Both runs are computed beside the twin")
        until(lambda: max(tinted(visitor, alone)) < TINTED, 60.0, "they stay for ever")


def shown(page):
    """The period that is looked back to."""
    return int(re.search(r"\(period (\d+)\)", page.get_by_text(re.compile(r"\(period \d+\)")).first.inner_text())[1])


def watch_until(visitor, seen, what):
    """Watch both runs, once more when they are over: a slow page may have few pictures of them, or none."""
    pressed = -WATCHED

    def watched():
        nonlocal pressed
        if time.monotonic() - pressed >= WATCHED:
            visitor.press(WATCH)
            pressed = time.monotonic()
        return seen()

    until(watched, 6 * WATCHED, what)


def slide(visitor, label, share):
    """Click on the track of a slider, this share of its length from the left."""
    row = "xpath=ancestor::div[contains(@class, 'mantine-Flex-root')][1]"
    track = visitor.page.get_by_text(label).locator("visible=true").first.locator(row).locator(".mantine-Slider-track")
    track.scroll_into_view_if_needed()
    box = track.bounding_box()
    visitor.page.mouse.click(box["x"] + share * box["width"], box["y"] + box["height"] / 2)


def compared(visitor):
    """Rows of the panel's table by name: as it was, and changed."""
    rows = visitor.page.locator("tr", has_text=re.compile("time|picked|placed|contacts|driven")).locator("visible=true")
    rows = [row.locator("td").all_inner_texts() for row in rows.all()]
    return {name: (was, changed) for name, was, changed in rows}


def seconds(cell):
    """The time [s] in a cell."""
    return float(re.search(r"(\d+\.\d) s", cell).group(1))


def tinted(visitor, alone):
    """How many pixels now have the hue of each tint and had another colour before: glass lets the rest through."""
    picture = visitor.picture()
    other = np.abs(picture - alone).max(axis=2) > DIFFERENT
    shade = picture - picture.mean(axis=2, keepdims=True)
    length = np.linalg.norm(shade, axis=2)
    hues = [np.array(tint, dtype=float) - np.mean(tint) for tint in OTHERS]
    along = [shade @ hue / np.linalg.norm(hue) for hue in hues]
    return [int((other & (length > DIFFERENT) & (share > 0.9 * length)).sum()) for share in along]
