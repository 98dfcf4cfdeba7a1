"""The page in Chromium: what is shown, looking back, branching, saving, a what-if by mouse, and the tour."""

import os
import re
import signal
import time

import msgspec
import numpy as np
import pytest
from page import ROW, Visitor, changed, until, visiting

from motm_twin.bus.commands import Pause
from motm_twin.perf.processes import act
from motm_twin.sessions.session import Session
from motm_twin.ui.colours import OTHERS
from motm_twin.ui.hub import LAYERS, OFF_AT_FIRST
from motm_twin.ui.panel.tune_tab import SHOWN, WATCH
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT, RING

pytestmark = [pytest.mark.browser, pytest.mark.timeout(600)]
SIGHT = 1e-4  # share of the pixels that must change at least
BACK = 3  # periods
MOVED = 60  # periods after which the Temis have trails
SEEN = 0.7  # [m] of the path at least: more than the robot stands on


def test_layers_candidates_looking_back_branching_and_saving_by_mouse(browser, begun, tmp_path):
    with visiting(browser, begun("exp2", play=False)) as visitor:
        client, page, server = visitor.twin.client, visitor.page, visitor.twin.server
        candidates(visitor)

        pause_on_the_way(visitor)
        layers(visitor)

        newest = client.tick()
        visitor.tab("Replay")
        visitor.says("(live)")
        for back in range(1, BACK + 1):
            visitor.press("Back by one period")
            visitor.says(f"period {newest.index - back}")
        visitor.says("Looking back")
        assert client.tick().index == newest.index  # the twin does not notice
        visitor.press("Branch")
        branched = until(lambda: client.tick().run > newest.run and client.tick(), 30.0, "no branch")
        assert branched.index == newest.index - BACK
        visitor.says("(live)")
        visitor.says("kept: 0 to")  # the past that the branch shares
        run = branched.run
        page.get_by_role("button", name="Undo the branch").locator("visible=true").first.click(timeout=60_000)
        until(lambda: client.tick().run > run, 60.0, "nothing is undone")
        visitor.says("Branch undone")
        assert newest.index <= client.tick().index <= newest.index + 1

        with page.expect_download() as download:
            visitor.press("Save the session")
        path = tmp_path / download.value.suggested_filename
        assert path.name.startswith("exp2-trial1-0-")
        download.value.save_as(path)
        session = msgspec.json.decode(path.read_bytes(), type=Session)
        assert (session.periods, bool(session.state_hash)) == (client.tick().index + 1, True)

        os.kill(server, signal.SIGSTOP)
        visitor.press("Save the session")
        visitor.says("This did not work")  # an error in a callback is shown
        os.kill(server, signal.SIGCONT)
        visitor.state("Paused")
        visitor.tab("Drive")
        visitor.press("Play")
        visitor.state("Running")  # and does no harm


def pause_on_the_way(visitor):
    """Drive on and pause where there is a path to be seen: at a target the robot stands on what is left of it."""
    client = visitor.twin.client
    visitor.tab("Drive")
    for _ in range(10):
        begin = client.tick().index
        visitor.press("Play")
        until(lambda begin=begin: client.tick().index > max(MOVED, begin), 60.0, "the twin does not run")
        visitor.press("Pause")
        until(lambda: client.status().state == "paused", 30.0, "not paused")
        path = np.array(client.tick().plan.global_path)
        if np.hypot(*np.diff(path, axis=0).T).sum() > SEEN:
            return
    raise AssertionError("never on the way")


def candidates(visitor):
    """Click the chosen place and one that is out; both are explained."""
    placement = visitor.twin.client.tick().placement
    count, chosen = len(placement.poses), placement.chosen
    visitor.tab("Why")
    visitor.click((*placement.poses[chosen][:2], CANDIDATE_HEIGHT))
    visitor.says(re.compile(r"^Place to stand, (\d+(st|nd|rd|th) )?best of \d+, chosen$"))
    named = visitor.page.get_by_title(f"Candidate no. {chosen + 1} of {count}")
    named.locator("visible=true").first.wait_for(timeout=60_000)
    visitor.says(f"{placement.cost[chosen]:.1f} s")
    inspected = until(lambda: visitor.twin.client.tick().inspected, 30.0, "its paths are not computed")
    assert inspected.candidate == chosen and inspected.path
    out = [i for i in range(1, RING - 1) if all(placement.rejected[i + step] for step in (-1, 0, 1))]
    nearest = min(out, key=lambda i: placement.poses[i][1])  # in front of the table
    visitor.click((*placement.poses[nearest][:2], CANDIDATE_HEIGHT))
    visitor.says("Not possible: ")


def layers(visitor):
    """Each layer, switched off or on at its chip, changes the picture; then all are as they were."""
    chips = {layer.key: visitor.page.get_by_role("button", name=layer.title, exact=True) for layer in LAYERS}
    before = visitor.settled()
    for key, chip in chips.items():
        if key in OFF_AT_FIRST:  # the server sends it
            before = visitor.settled(quiet=1)
        chip.click()
        visitor.page.mouse.move(2, 2)
        before = until(lambda before=before: other(visitor, before), 30.0, f"{key} changes nothing")[0]
    for chip in chips.values():
        chip.click()


def other(visitor, before):
    """The picture, in a list; none while it is as before."""
    picture = visitor.picture()
    return [picture] if changed(before, picture) > SIGHT else []


TINTED = 100  # pixels of a robot that must be seen
DIFFERENT = 20.0  # [grey levels]
WATCHED = 20.0  # [s] after which both runs have been shown
SLIDER = "Smallest ring"


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
    track = visitor.page.get_by_text(label).locator("visible=true").first.locator(ROW).locator(".mantine-Slider-track")
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
    """Number of pixels that now have the hue of each tint and had another colour: glass lets the rest through."""
    picture = visitor.picture()
    other = np.abs(picture - alone).max(axis=2) > DIFFERENT
    shade = picture - picture.mean(axis=2, keepdims=True)
    length = np.linalg.norm(shade, axis=2)
    hues = [np.array(tint, dtype=float) - np.mean(tint) for tint in OTHERS]
    along = [shade @ hue / np.linalg.norm(hue) for hue in hues]
    return [int((other & (length > DIFFERENT) & (share > 0.9 * length)).sum()) for share in along]


def test_the_tour_shows_a_place_and_its_costs_a_temi_in_the_way_and_why_it_plans_ahead(browser, begun):
    visitor = Visitor.enter(browser, begun("exp1"), welcome=True)
    client, page = visitor.twin.client, visitor.page
    visitor.press("Tour of one minute")
    visitor.says("1 of 4")
    until(lambda: client.status().state == "paused", 30.0, "it does not wait")
    visitor.press("Reset")
    until(lambda: client.tick().index == 0, 30.0, "not at the start")
    placement = client.tick().placement
    visitor.click((*placement.poses[placement.chosen][:2], CANDIDATE_HEIGHT))
    visitor.says("2 of 4")  # by itself
    visitor.says("and on to the next target")
    visitor.press("Next")
    visitor.press("Drop a Temi")
    until(lambda: len(client.tick().obstacles) == 1, 30.0, "no Temi")
    until(lambda: client.status().state == "playing", 30.0, "it does not go on")
    visitor.press("Next")
    visitor.press("Why plan for the next target?")
    visitor.says("as it was")
    visitor.press("Stop")
    visitor.press("Done")
    assert page.locator("#motm-tour").count() == 0
    page.goto("about:blank")
    act(client, Pause())
    until(lambda: client.status().state == "paused", 30.0, "it does not pause")
    page.goto(f"{visitor.twin.url}&fixedDpr=1#cam=Top")  # a link, of a twin that tells nothing new
    page.locator(".cover").wait_for(state="detached", timeout=60_000)
    assert page.locator("#motm-tour").count() == 0  # once is enough
    until(lambda: looks_down(visitor), 60.0, "the link does not choose the camera")
    assert visitor.errors == []
    page.close()


def looks_down(visitor):
    """True while the camera is above the scene."""
    camera = visitor._camera()
    return camera is not None and camera[0][2, 1] > 0.95
