"""The reader without a browser that the benchmark uses, against a real Viser server."""

import threading

import numpy as np
import pytest

from motm_twin.perf.page import rise, slopes
from motm_twin.perf.page_reader import SMALL, Load, PageReader, alike
from motm_twin.ui.page_server import open_page


@pytest.fixture
def server():
    server = open_page("127.0.0.1", 0)
    yield server
    server.stop()


def test_it_is_a_visitor_that_sees_widgets_and_nodes_and_counts_what_moves(server):
    server.gui.add_checkbox("Paths", False)
    still = server.scene.add_frame("/still")
    moving = server.scene.add_frame("/moving")
    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: reader.replayed is not None and reader.find("Paths", "Checkbox"), 10.0)
        assert reader.wait(lambda _: len(server.get_clients()) == 1, 10.0)  # named a moment after it got the scene
        assert reader.bytes > 0
        reader.moved()
        moving.position = (1.0, 0.0, 0.0)
        moving.wxyz = (0.0, 0.0, 0.0, 1.0)
        assert reader.wait(lambda reader: len(reader.moving["pose"]) == 1, 10.0)
        assert reader.moved() == 1
        assert reader.moved() == 0
    assert still.position[0] == 0.0


def test_it_changes_widgets_as_a_page_does(server):
    box, button = server.gui.add_checkbox("Paths", False), server.gui.add_button("Play")
    changed, clicked = threading.Event(), threading.Event()
    box.on_update(lambda _: changed.set())
    button.on_click(lambda _: clicked.set())
    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: reader.find("Play"), 10.0)
        assert reader.set("Paths", True, "Checkbox")
        assert reader.set("Play", True)
        assert not reader.set("Fly", True)
        assert changed.wait(10.0)
        assert clicked.wait(10.0)
    assert box.value is True


def test_it_drags_a_node_from_start_to_end(server):
    node, phases, ended = server.scene.add_box("/temi", dimensions=(1.0, 1.0, 1.0)), [], threading.Event()

    @node.on_drag("left")
    async def _(event):
        phases.append((event.phase, event.end_position[0]))
        if event.phase == "end":
            ended.set()

    with PageReader(server.get_port()) as reader:
        assert reader.wait(lambda reader: "/temi" in reader.draggable, 10.0)
        reader.drag("/temi", np.zeros(3), np.array([[0.1, 0.0, 0.0], [0.2, 0.0, 0.0]]), 0.01)
        assert ended.wait(10.0)
    assert phases == [("start", 0.0), ("update", 0.1), ("update", 0.2), ("end", 0.2)]


def test_a_picture_is_complete_when_it_is_first_the_one_that_stays():
    blank = np.full((SMALL[1], SMALL[0], 3), 255.0)
    half, whole = blank.copy(), blank.copy()
    half[:50] = 40.0
    whole[::2] = 0.0
    little = whole.copy()
    little[0, 0] = 90.0
    assert alike(whole, little)
    assert not alike(whole, half)
    load = Load(pictures=[(0.5, blank), (1.0, half), (2.0, whole), (2.5, little), (3.0, whole)])
    assert load.complete_at == 2.0
    assert np.isnan(Load(pictures=[(0.5, blank)]).complete_at)
    assert np.isnan(Load().complete_at)


def test_slopes_of_both_halves_and_whether_the_second_is_steeper():
    time = np.linspace(0.0, 10.0, 201)
    value = np.where(time < 5.0, 100.0 * time, 500.0 + 2.0 * (time - 5.0))
    early, late = slopes(time, value)
    assert (early.value, late.value) == (pytest.approx(100.0), pytest.approx(2.0))
    assert rise(early, late) < 0.0
    noise = np.random.default_rng(0).normal(0.0, 1.0, len(time))
    assert rise(*slopes(time, noise)) <= 0.0
    assert rise(*slopes(time, noise + time**2)) > 0.0
    assert np.isnan(rise(*slopes(time, value * np.nan)))
    assert np.isnan(rise(*slopes(time[:9], value[:9])))
