"""The texts of the page."""

import msgspec
import pytest
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import TickMessage
from motm_twin.ui.panel.panel import status_card
from motm_twin.ui.panel.why_tab import candidate_card, task_card

EVIL = "<img src=x onerror=alert(1)>"


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    sent = msgspec.json.encode(tick_message(FakeTwin(fake_scene()).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


def test_names_from_outside_are_escaped_on_every_card(tick):
    tasks = [msgspec.structs.replace(task, target=EVIL) for task in tick.tasks]
    placement = msgspec.structs.replace(tick.placement, rejected=[EVIL] * 72)
    bad = msgspec.structs.replace(tick, tasks=tasks, stop_reason=EVIL, placement=placement)
    texts = [task_card(bad), candidate_card(placement, 0), status_card("error", None, EVIL)]
    for text in texts:
        assert "<img" not in text
        assert "&lt;img" in text


def test_a_candidate_tells_its_costs_or_why_it_is_out(tick):
    placement = tick.placement
    chosen = candidate_card(placement, placement.chosen)
    assert "chosen" in chosen
    assert "<span>1 of " in chosen
    out = next(index for index, reason in enumerate(placement.rejected) if reason)
    assert "rejected: collision with object table" in candidate_card(placement, out)
    assert "global path" in candidate_card(placement, None)
