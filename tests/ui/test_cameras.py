"""Cameras: whose hand moved them, that of the visitor or of the program; poses, and the things in sight."""

import asyncio
import itertools
import math
import time
from contextlib import nullcontext
from types import SimpleNamespace

import numpy as np
import pytest
from fake_twin import fake_scene

from motm_twin.model.scene import DriveTo
from motm_twin.model.scene_file import load_scene
from motm_twin.ui.scene import cameras as module
from motm_twin.ui.scene.cameras import FIELD_OF_VIEW, FROM_FAR, Cameras, Visibility, extent, from_above, overview
from motm_twin.ui.scene.picking import Surroundings

SCENE = load_scene("exp1", "trial1")
LIBRARY = np.array([3.0, 3.0, 3.0])  # where a page of Viser puts its camera until it hears where
ROOM = fake_scene()
TABLE = (4.2, 1.77)


def camera(position, look_at, width=900, height=760):
    return SimpleNamespace(
        position=position, look_at=look_at, fov=FIELD_OF_VIEW, image_width=width, image_height=height
    )


class Page:
    """What a page and its connection are for the cameras; it answers as late as it likes."""

    def __init__(self, position):
        self.client_id, self.atomic, self.camera = 1, nullcontext, camera(np.array(position), np.zeros(3), 1024, 700)
        self.camera.on_update = self._keep

    def tells(self, position, look_at=None):
        """Where its camera is, or was; it looks where it was told to, unless it is said."""
        seen = self.camera.look_at if look_at is None else look_at
        asyncio.run(self._moved(SimpleNamespace(position=np.array(position), look_at=np.array(seen))))

    def _keep(self, moved):
        self._moved = moved


class Sends(SimpleNamespace):
    """A camera that notes the positions that Viser would send: it keeps back those that are as the last one."""

    def __init__(self, camera, sent):
        super().__init__(**vars(camera))
        self.sent = sent

    def __setattr__(self, name, value):
        if name == "position" and not np.allclose(value, self.position):
            self.sent.append(value)
        super().__setattr__(name, value)


@pytest.fixture
def entered():
    """A page that has just come, with the camera at the start that it was given, and the cameras."""
    return enter(overview(SCENE)[0])


def enter(position):
    page, handlers = Page(position), []
    server = SimpleNamespace(
        initial_camera=SimpleNamespace(position=LIBRARY),
        on_client_connect=handlers.append,
        on_client_disconnect=handlers.append,
        get_clients=lambda: {page.client_id: page},
    )
    cameras = Cameras(server)
    cameras.show(SCENE)
    asyncio.run(handlers[0](page))
    return page, cameras


def pictures(cameras, count=3):
    for _ in range(count):
        cameras.update(np.zeros(3), np.eye(4), 0.03)


def test_a_page_that_tells_its_first_camera_late_has_not_moved_it(entered) -> None:
    page, cameras = entered
    first = page.camera.position.copy()
    pictures(cameras)
    assert np.linalg.norm(page.camera.position - first) > 0.3, "the panel is beside the picture: another place"
    page.tells(first)  # its size has changed, and what was sent is still on the way
    page.tells(page.camera.position)
    assert cameras.mode(page) == "Overview"
    before, cameras = enter(LIBRARY)
    pictures(cameras)
    before.tells(overview(SCENE)[0])  # where it was before it began
    assert cameras.mode(before) == "Overview"


def test_a_page_that_put_its_camera_back_when_it_began_is_sent_there_again(entered) -> None:
    page, cameras = entered
    first = page.camera.position.copy()
    pictures(cameras)
    there = page.camera.position.copy()
    page.camera.position = first
    page.tells(first)
    pictures(cameras)
    assert np.allclose(page.camera.position, there)
    page.camera.position = first.copy()
    page.tells(there)
    pictures(cameras)
    assert np.allclose(page.camera.position, first), "nothing is sent to a page that is there"


def test_a_slow_page_that_reports_late_on_its_way_to_a_view_has_not_moved_its_camera(entered, monkeypatch) -> None:
    page, cameras = entered
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pictures(cameras)
    page.tells(page.camera.position)
    cameras.turned(page)
    cameras.choose(page, "Top")
    now[0] += 0.3
    pictures(cameras)
    aside = page.camera.position + np.array([0.4, 0.0, 0.0])
    now[0] += 20.0
    pictures(cameras)
    there = page.camera.position.copy()
    page.tells(aside)
    pictures(cameras)
    assert cameras.mode(page) == "Top"
    assert np.allclose(page.camera.position, there)
    cameras.turned(page)
    page.tells(aside)
    assert cameras.mode(page) == "Free", "a hand moves it"


@pytest.mark.parametrize("arrived", [False, True])
@pytest.mark.parametrize("place", [LIBRARY, np.array([-5.0, 0.0, 0.0])])
def test_a_slow_page_that_tells_late_where_it_began_is_sent_to_its_view_again(arrived, place) -> None:
    page, cameras = enter(np.array([-5.0, 0.0, 0.0]))
    pictures(cameras)
    there = page.camera.position.copy()
    if arrived:
        page.tells(there)
    page.camera.position = place.copy()
    page.tells(place)
    pictures(cameras)
    assert cameras.mode(page) == "Overview"
    assert np.allclose(page.camera.position, there)


def test_a_page_that_is_there_but_looks_elsewhere_is_told_again_where_to_look(entered) -> None:
    page, cameras = entered
    pictures(cameras)
    place, look_at = page.camera.position.copy(), page.camera.look_at.copy()
    page.tells(place)
    page.camera.look_at = look_at + np.array([0.4, 0.0, 0.0])
    page.tells(place, page.camera.look_at)
    pictures(cameras)
    assert np.allclose(page.camera.look_at, look_at)
    assert cameras.mode(page) == "Overview"


@pytest.mark.parametrize(
    ("reported", "turned", "way", "aside", "mode"),
    [
        pytest.param(True, True, 1.0, 0.3, "Free", id="a hand makes the camera free"),
        pytest.param(False, True, 1.0, 0.0, "Overview", id="a grip that does not turn the view leaves it fixed"),
        pytest.param(False, False, 1.0, 0.3, "Overview", id="a page that is not there yet was moved by no hand"),
        pytest.param(False, False, 0.5, 0.0, "Overview", id="on its way to a view a page was moved by no hand"),
    ],
)
def test_only_a_hand_makes_the_camera_free(entered, reported, turned, way, aside, mode) -> None:
    page, cameras = entered
    first = page.camera.position.copy()
    pictures(cameras)
    if reported:
        page.tells(page.camera.position)
    if turned:
        cameras.turned(page)
    page.tells(first + way * (page.camera.position - first) + np.array([0.0, aside, aside]))
    assert cameras.mode(page) == mode


@pytest.mark.parametrize("aspect", [0.7, module.ASPECT, 2.2])
@pytest.mark.parametrize(("view", "fov"), [(overview, FIELD_OF_VIEW), (from_above, FROM_FAR)])
def test_everything_is_in_the_picture_and_fills_it(view, fov, aspect):
    points = extent(fake_scene())
    position, look_at = view(fake_scene(), aspect)
    forward = (look_at - position) / np.linalg.norm(look_at - position)
    right = np.cross(forward, [0.0, 0.0, 1.0]) / np.linalg.norm(np.cross(forward, [0.0, 0.0, 1.0]))
    seen = points - position
    depth = seen @ forward
    half = math.tan(fov / 2)
    across = np.abs(seen @ right / depth / (half * aspect)).max()
    high = np.abs(seen @ np.cross(right, forward) / depth / half).max()
    assert depth.min() > 0.0
    assert max(across, high) == pytest.approx(0.93, abs=0.01)


def test_on_the_way_to_the_plan_view_and_back_the_middle_of_the_picture_keeps_its_size(entered, monkeypatch):
    page, cameras = entered
    now = [0.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])
    pictures(cameras)
    for preset, end in (("Top", FROM_FAR), ("Overview", FIELD_OF_VIEW)):
        cameras.choose(page, preset)
        sizes = []
        for _ in range(12):
            now[0] += module.EASE / 10
            pictures(cameras, 1)
            far = np.linalg.norm(page.camera.position - page.camera.look_at)
            sizes.append(far * math.tan(page.camera.fov / 2))
        assert page.camera.fov == pytest.approx(end)
        assert max(sizes) < 1.35 * min(sizes)


def test_the_camera_of_the_hand_frames_its_target_too_when_it_is_near(entered, monkeypatch):
    page, cameras = entered
    now = itertools.count()
    monkeypatch.setattr(time, "monotonic", lambda: float(next(now)))
    hand = np.eye(4)
    hand[:3, 3] = (1.0, 0.0, 1.0)

    def looks(target):
        cameras.choose(page, "Gripper")
        for _ in range(400):
            cameras.update(np.zeros(3), hand, 0.05, target=target)
        return page.camera.look_at, np.linalg.norm(page.camera.position - page.camera.look_at)

    (alone, near), (both, back) = looks(None), looks(np.array([1.6, 0.0, 0.7]))
    assert both[0] - alone[0] == pytest.approx(0.3) and both[2] - alone[2] == pytest.approx(-0.15)
    assert back > near
    assert looks(np.array([9.0, 0.0, 0.7]))[0][0] == pytest.approx(alone[0])


@pytest.mark.parametrize(
    ("pixels", "aspect"),
    [((1024, 2216), 390 / 844), ((690, 700), 690 / 700)],
    ids=["a phone of many pixels", "a page that connects again, its panel docked"],
)
def test_a_view_fits_the_picture_that_the_page_tells(entered, pixels, aspect):
    page, cameras = entered
    page.camera.image_width, page.camera.image_height = pixels
    cameras.tell_aspect(page, aspect)
    pictures(cameras)
    assert np.allclose(page.camera.position, overview(SCENE, aspect)[0])


@pytest.mark.parametrize("aspect", [math.nan, math.inf, -1.0, 0.0])
def test_a_picture_of_an_impossible_shape_has_a_view_all_the_same(entered, aspect):
    page, cameras = entered
    cameras.tell_aspect(page, aspect)
    pictures(cameras)
    assert np.isfinite(page.camera.position).all()


def test_a_page_that_has_drawn_the_scene_is_sent_its_view_once_more(entered):
    page, cameras = entered
    pictures(cameras)
    page.tells(page.camera.position)
    there, sent = page.camera.position.copy(), []
    page.camera = Sends(page.camera, sent)
    pictures(cameras)
    assert not sent
    cameras.drawn(page)
    pictures(cameras)
    assert len(sent) == 2 and np.allclose(sent[-1], there)


def test_the_picture_of_a_scene_holds_where_its_robot_is_sent():
    scene = load_scene("line")
    (end,) = (task.point for task in scene.tasks if isinstance(task, DriveTo))
    assert end[0] + 0.4 < extent(scene)[:, 0].max()


def test_behind_a_table_or_beside_the_picture_is_out_of_sight(tick):
    surroundings = Surroundings(ROOM)
    surroundings.update(tick)
    low = Visibility(camera((TABLE[0], 7.0, 0.9), (TABLE[0], 1.77, 0.6)), surroundings, tick)
    assert low.sees((TABLE[0] + 0.7, 3.0), 0.8)
    assert not low.sees((TABLE[0], 0.5), 0.8)  # behind the table
    assert not low.sees((TABLE[0] + 6.0, 3.0), 0.8)
    assert not low.sees((TABLE[0], 9.0), 0.8)
    high = Visibility(camera(*overview(ROOM)), surroundings, tick)
    x, y = high.middle()
    assert high.sees((x, y), 0.5) or (x, y) == pytest.approx(TABLE, abs=1.5)
    assert Visibility(camera((0.0, 0.0, 1.0), (3.0, 0.0, 1.5)), surroundings, tick).middle() is None
