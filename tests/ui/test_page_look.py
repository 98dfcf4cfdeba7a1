"""The page in Chromium: understanding what is shown, looking back, branching, and taking a session home."""

import os
import re
import signal

import msgspec
import numpy as np
import pytest
from page import changed, until, visiting

from motm_twin.sessions.session import Session
from motm_twin.ui.hub import LAYERS, OFF_AT_FIRST
from motm_twin.ui.scene.picking import CANDIDATE_HEIGHT, RING

SIGHT = 1e-4  # share of the pixels that must change at least
BACK = 3  # periods
MOVED = 60  # periods after which the Temis have trails
SEEN = 0.7  # [m] of the path at least: more than the robot stands on


@pytest.mark.browser
@pytest.mark.timeout(600)
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
    assert inspected.candidate == chosen
    assert inspected.path
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
