"""Widgets that follow what others do, and what a person has just chosen."""

import time
from types import SimpleNamespace

import pytest

from motm_twin.ui.panel import widgets
from motm_twin.ui.panel.widgets import HOLD, follow


@pytest.fixture
def box():
    impl = SimpleNamespace(update_timestamp=0.0)

    class Box:
        value, _impl = True, impl

        @property
        def update_timestamp(self):
            return impl.update_timestamp

    return Box()


def test_what_a_person_has_just_chosen_is_not_set_back(box, monkeypatch):
    """Viser has set the new value and not called back yet: the program still wants the old one."""
    now = time.time()
    box.value, box._impl.update_timestamp = False, now
    follow(box, True)
    assert box.value is False
    monkeypatch.setattr(widgets, "time", SimpleNamespace(time=lambda: now + HOLD + 0.1))
    follow(box, True)  # nobody took it over: it was refused, say
    assert box.value is True


def test_what_others_choose_is_followed_at_once(box):
    follow(box, False)
    follow(box, True)
    assert box.value is True
    assert box.update_timestamp == 0.0
