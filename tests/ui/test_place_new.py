"""A new body stands where the robot goes and where it is seen; the next click on the floor puts it elsewhere."""

import asyncio
import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fake_twin import FakeTwin, fake_scene

from motm_twin.bus.commands import Answer, MoveBody, TakeWheel
from motm_twin.bus.encode import tick_message
from motm_twin.bus.messages import TickMessage
from motm_twin.ui.hub import View
from motm_twin.ui.panel.disturb import NEAREST, free_place
from motm_twin.ui.scene.cameras import FIELD_OF_VIEW, Visibility, overview
from motm_twin.ui.scene.drag import Drag
from motm_twin.ui.scene.picking import Clicks, Surroundings

SCENE = fake_scene()
TABLE = (4.2, 1.77)


@pytest.fixture
def tick():
    """A tick as a client receives it."""
    sent = msgspec.json.encode(tick_message(FakeTwin(SCENE).advance(), 1, 0.0))
    return msgspec.json.decode(sent, type=TickMessage)


@pytest.fixture
def surroundings(tick):
    found = Surroundings(SCENE)
    found.update(tick)
    return found


def camera(position, look_at):
    return SimpleNamespace(
        position=position, look_at=look_at, fov=FIELD_OF_VIEW, image_width=900, image_height=760
    )  # fmt: skip


def test_it_stands_on_the_way_and_says_so():
    place = free_place([0.0, 0.0, 0.0], None, [], way=[(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])
    assert (place.x, place.y) == pytest.approx((1.0, 0.5))
    assert place.where == "1.5 m before the robot, on its way"
    taken = free_place([0.0, 0.0, 0.0], None, [place[:2]], way=[(0.0, 0.0), (1.0, 0.0), (1.0, 3.0)])
    assert math.dist(taken[:2], place[:2]) > 0.7


def test_without_a_way_it_stands_before_the_robot_and_out_of_sight_only_when_nothing_else_is_left():
    before = free_place([0.0, 0.0, math.pi / 2], None, [])
    assert (before.x, before.y) == pytest.approx((0.0, 1.5)) and before.where == "1.5 m before the robot"
    seen = free_place([0.0, 0.0, 0.0], None, [], sees=lambda p: p[1] > 1.0)
    assert seen.y > 1.0
    looked_at = free_place([0.0, 0.0, 0.0], None, [], look_at=(9.0, 9.0), sees=lambda p: math.dist(p, (9, 9)) < 1)
    assert (looked_at.x, looked_at.y) == (9.0, 9.0) and looked_at.where == "in the middle of the view"
    assert free_place([0.0, 0.0, 0.0], None, [], sees=lambda _: False).x == 1.5
    assert all(
        math.hypot(*free_place([0.0, 0.0, 0.0], None, [], look_at=(0.2, 0.0), sees=lambda p, k=k: p[0] < k)[:2])
        >= NEAREST
        for k in (-2.0, 0.0, 1.0)
    )


def test_behind_a_table_or_beside_the_picture_is_out_of_sight(tick, surroundings):
    low = Visibility(camera((TABLE[0], 7.0, 0.9), (TABLE[0], 1.77, 0.6)), surroundings, tick)
    assert low.sees((TABLE[0] + 0.7, 3.0), 0.8)
    assert not low.sees((TABLE[0], 0.5), 0.8)  # behind the table
    assert not low.sees((TABLE[0] + 6.0, 3.0), 0.8)
    assert not low.sees((TABLE[0], 9.0), 0.8)
    high = Visibility(camera(*overview(SCENE)), surroundings, tick)
    x, y = high.middle()
    assert high.sees((x, y), 0.5) or (x, y) == pytest.approx(TABLE, abs=1.5)
    assert Visibility(camera((0.0, 0.0, 1.0), (3.0, 0.0, 1.5)), surroundings, tick).middle() is None


class Hub:
    """What pointing needs of a hub: who drives, the view, the way to the twin."""

    def __init__(self):
        self.view, self.sent, self.kept, self.told = View(), [], 0, []

    def watching(self, act):
        return act

    def drives(self, _):
        return True

    def refusal(self, _):
        return ""

    def keep_wheel(self, _):
        self.kept += 1

    def inspect(self):
        pass

    def tell(self, _, text, *__):
        self.told.append(text)

    def command(self, _, command):
        self.sent.append(command)
        return Answer(ok=True)


@pytest.fixture
def pointing(tick, surroundings):
    def on_click():
        return lambda act: act

    made = Clicks(SimpleNamespace(scene=SimpleNamespace(on_click=on_click)), Hub())
    made.tick, made.surroundings = tick, surroundings
    return made


def click(pointing, point):
    """Look at a point from above and click it."""
    eye = np.array([point[0], point[1], 5.0])
    event = SimpleNamespace(ray_origin=eye, ray_direction=np.array([0.0, 0.0, -1.0]))
    asyncio.run(pointing._click(event, None))
    return pointing._hub


def test_the_next_click_on_the_floor_puts_a_new_body_there_and_the_one_after_lets_it_go(pointing):
    pointing._hub.view.selected = pointing._hub.view.placing = "temi 1"
    hub = click(pointing, (6.0, -1.5))
    assert hub.sent == [MoveBody(name="temi 1", x=6.0, y=-1.5, held=False)]
    assert (hub.view.selected, hub.view.placing) == ("temi 1", "")
    hub = click(pointing, (6.0, -1.0))
    assert len(hub.sent) == 1 and hub.view.selected == ""


def test_a_dot_of_a_candidate_is_no_more_than_floor_while_something_is_placed(pointing):
    x, y, _ = pointing.tick.placement.poses[pointing.tick.placement.chosen]
    hub = click(pointing, (x, y))
    assert hub.view.picked is not None
    hub.view.picked, hub.view.selected, hub.view.placing = None, "temi 1", "temi 1"
    click(pointing, (x, y))
    assert hub.view.picked is None
    (placed,) = hub.sent
    assert math.dist((placed.x, placed.y), (x, y)) < 0.05


def test_a_refused_place_can_be_tried_again(pointing):
    pointing._hub.view.selected = pointing._hub.view.placing = "temi 1"
    pointing._hub.command = lambda *_: Answer(ok=False, reason="the twin server does not answer")
    hub = click(pointing, (6.0, -1.5))
    assert hub.view.placing == "temi 1"


def test_a_click_on_something_else_ends_placing(pointing):
    pointing._hub.view.selected = pointing._hub.view.placing = "temi 1"
    hub = click(pointing, TABLE)
    assert hub.view.placing == "" and hub.view.selected != "temi 1" and not hub.sent


def test_a_cube_that_is_selected_already_is_still_taken_to_the_bin_that_is_clicked_next(pointing, tick):
    cube, box = tick.objects[0], pointing.surroundings.now.bins[0]
    pointing._hub.view.selected = cube.name  # since it was dragged here
    hub = click(pointing, cube.position)
    assert hub.view.selected == cube.name
    hub = click(pointing, box.centre)
    assert hub.view.selected == "" and any(cube.name in note for note in hub.told)


def test_every_click_of_who_may_drive_takes_the_free_wheel_and_dots_need_nothing_else(pointing, tick):
    free = next(i for i, reason in enumerate(tick.placement.rejected) if not reason)
    hub = click(pointing, tick.placement.poses[free][:2])
    assert hub.kept == 1 and hub.view.picked is not None and not any(isinstance(c, TakeWheel) for c in hub.sent)


def test_furniture_that_is_only_touched_stays_and_a_body_that_is_dragged_is_placed():
    hub = Hub()
    drag = Drag(hub)
    eye = SimpleNamespace(camera=SimpleNamespace(position=(0.0, 0.0, 5.0)))

    def gesture(name, slack, *ends):
        phases = ("start", *("update" for _ in ends[1:-1]), "end")
        for phase, x in zip(phases, ends, strict=True):
            event = SimpleNamespace(
                phase=phase, client_id=1, client=eye, start_position=(0.0, 0.0, 0.5), end_position=(x, 0.0, 0.5)
            )
            drag._on_drag(name, lambda: (1.0, 2.0), slack, event, None)

    try:
        hub.view.placing = "box 1"
        gesture("table", 0.04, 0.0, 0.02, 0.03)
        assert drag.held("table") is None and hub.view.placing == "box 1"
        gesture("table", 0.04, 0.0, 0.02, 0.3)
        assert (drag.held("table").x, drag.held("table").y) == (pytest.approx(1.3), pytest.approx(2.0))
        gesture("box 1", 0.0, 0.0, 0.01)
        assert drag.held("box 1").x == pytest.approx(1.01) and hub.view.placing == ""
    finally:
        drag.stop()
