"""Keys of the page work wherever the focus is, except where somebody types."""

import gzip
import http.client

import pytest
from page import serving, until, visiting

from motm_twin.ui.page_scripts import SCRIPTS
from motm_twin.ui.page_server import open_page


@pytest.mark.parametrize("accepted", ["identity", "gzip"])
def test_the_page_carries_our_scripts_whole_and_once(accepted):
    server = open_page("127.0.0.1", 0)
    try:
        for _ in range(2):
            connection = http.client.HTTPConnection("127.0.0.1", server.get_port(), timeout=10)
            connection.request("GET", "/", headers={"Accept-Encoding": accepted})
            answer = connection.getresponse()
            body = answer.read()
            connection.close()
            assert answer.getheader("Content-Encoding") == accepted
            assert int(answer.getheader("Content-Length")) == len(body)
            page = gzip.decompress(body) if accepted == "gzip" else body
            assert [page.count(script.encode()) for script in SCRIPTS] == [1] * len(SCRIPTS)
            assert page.rstrip().endswith(b"</html>")
    finally:
        server.stop()


@pytest.mark.browser
@pytest.mark.timeout(600)
def test_space_plays_and_pauses_from_tabs_buttons_lists_sliders_and_checkboxes_but_not_from_a_field():
    with serving("exp1") as twin, visiting(twin) as visitor:
        client, page = twin.client, visitor.page
        visitor.state("Running")

        def space(state, where):
            page.keyboard.press("Space")
            until(lambda: client.status().state == state, 30.0, f"Space at {where}: not {state}")
            index = client.tick().index
            page.wait_for_timeout(700)  # a button that was pressed as well would turn it back
            assert client.status().state == state, where
            assert state == "playing" or client.tick().index == index, where

        space("paused", "the page")
        visitor.tab("Why")
        space("playing", "a tab")
        visitor.tab("Drive")
        space("paused", "a tab")
        visitor.press("Step")
        until(lambda: client.tick().time > 0.0, 30.0, "no step")
        space("playing", "a button")
        visitor.choose("Speed", "1/2")
        until(lambda: client.status().speed == 0.5, 30.0, "speed")
        space("paused", "a closed list")
        visitor.unfold("Layers")
        box = page.get_by_label("Trails")
        box.uncheck()  # fails here when the click does nothing
        space("playing", "a checkbox")
        assert not box.is_checked()
        visitor.tab("Tune")
        page.locator("[role=slider]").locator("visible=true").first.focus()
        space("paused", "a slider")
        page.locator("input.mantine-NumberInput-input").locator("visible=true").first.focus()
        page.keyboard.press("Space")
        page.wait_for_timeout(700)
        assert client.status().state == "paused", "Space belongs to the field"
        assert visitor.errors == []
