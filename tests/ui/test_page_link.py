"""The page in Chromium when its server goes away and comes back."""

import pytest
from page import SHOWN, chromium, until

from motm_twin.bus.connection import free_port
from motm_twin.ui.guard import open_page

LOST = "Connection to the server lost"
REFUSED = """(address) => new Promise((done) => {
  const socket = new WebSocket(address);
  socket.onclose = done;
})"""  # an attempt that fails, as those of a page whose server is away
FAILED = 32  # from about here on Chromium waits for 1 to 5 s before another, where one has opened before


@pytest.mark.browser
@pytest.mark.timeout(300)
def test_a_page_says_that_its_server_is_away_and_comes_back_however_often_it_has_tried_in_vain():
    port = free_port()
    server = open_page("127.0.0.1", port)
    try:
        with chromium() as browser:
            page = browser.new_page()
            page.goto(f"http://127.0.0.1:{port}")
            until(lambda: len(server.get_clients()) == 1, SHOWN, "the page does not connect")
            assert not page.get_by_text(LOST).count()

            server.stop()
            page.get_by_text(LOST).wait_for(timeout=SHOWN * 1000)
            for _ in range(FAILED):
                page.evaluate(REFUSED, f"ws://127.0.0.1:{port}")
            server = open_page("127.0.0.1", port)
            until(lambda: len(server.get_clients()) == 1, SHOWN, "the page does not come back")
            until(lambda: not page.get_by_text(LOST).count(), SHOWN, "the line stays")
    finally:
        server.stop()
