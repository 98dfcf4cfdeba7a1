"""The pointer: the first thing along a ray, the meaning of a click, dragging and throwing."""

import asyncio
import math
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest
from fake_twin import fake_scene

from motm_twin.bus.commands import Answer, MoveBody, SendAgent, TakeWheel
from motm_twin.bus.messages import BodyMessage
from motm_twin.ui.hub import View
from motm_twin.ui.scene.drag import Drag, on_plane, spot_of, throw
from motm_twin.ui.scene.picking import CANDIDATES, Clicks, Ray, Surroundings, drawn_candidates, waiting_job

TABLE = (4.2, 1.77)


def test_every_possible_place_of_any_ring_is_drawn_and_impossible_ones_of_the_smallest_only(tick):
    def drawn(possible, chosen):
        rejected = ["" if k in possible else "no" for k in range(360)]
        poses = [[0.0, 0.0, 0.0]] * 360
        placement = msgspec.structs.replace(tick.placement, rejected=rejected, chosen=chosen, poses=poses)
        return drawn_candidates(placement).tolist()

    assert drawn({3, 100, 359}, 359) == [*range(72), 100, 359]
    many = drawn(set(range(360)), 300)
    assert len(many) == CANDIDATES and 300 in many and many == sorted(many)
    assert drawn(set(), -1) == list(range(72))


def test_a_ray_meets_the_plane_it_points_at_and_no_other():
    eye = np.array([0.0, 0.0, 2.0])
    assert on_plane(eye, np.array([1.0, 0.5, 1.0]), 0.0) == pytest.approx((2.0, 1.0))
    assert on_plane(eye, np.array([1.0, 0.5, 3.0]), 0.0) is None
    assert on_plane(eye, np.array([1.0, 0.0, 2.0]), 0.0) is None


def test_a_hand_that_moves_on_release_throws_and_one_that_rests_does_not():
    moving = [(0.05 * i, 0.05 * i, 0.0) for i in range(9)]  # 1 m/s along x
    assert throw(moving, 0.42) == pytest.approx((1.0, 0.0))
    assert throw(moving, 0.9) == (0.0, 0.0)
    assert throw([(t, 0.2 * x, 0.0) for t, x, _ in moving], 0.42) == (0.0, 0.0)
    assert math.hypot(*throw([(t, 9.0 * x, 9.0 * x) for t, x, _ in moving], 0.42)) == pytest.approx(2.5)
    assert throw(moving[:1], 0.0) == (0.0, 0.0)
    slow_page = [(0.0, 0.0, 0.0), (0.5, 0.5, 0.0), (0.97, 1.0, 0.0), (1.0, 1.0, 0.0)]
    assert throw(slow_page, 1.0) == pytest.approx((1.0, 0.0))
    assert throw([*moving, (0.9, 0.4, 0.0)], 0.9) == (0.0, 0.0)
    rested = [*moving, *((0.4 + 0.05 * i, 0.4, 0.0) for i in range(1, 9))]
    assert throw(rested, 0.82) == (0.0, 0.0)


@pytest.fixture
def around(tick):
    """Pieces that the pointer can be at."""
    surroundings = Surroundings(fake_scene())
    surroundings.update(tick)
    return surroundings


def aimed(around, tick, point, *, candidates=True):
    return around.first(Ray.through((point[0] - 1.0, point[1] - 2.0, 3.0), point), tick, candidates=candidates)


def test_the_pointer_finds_the_first_thing_on_its_way(around, tick):
    item, box = tick.objects[0], around.now.bins[0]
    assert aimed(around, tick, item.position).name == item.name
    hit = aimed(around, tick, (*box.centre, box.rim_z))
    assert (hit.kind, hit.name) == ("bin", box.name)
    piece = next(iter(around.pieces.values()))
    top = max(solid.z_max for solid in around.now.solids if solid.name in piece.solids)
    corner = (piece.centre[0], piece.centre[1], top)
    assert aimed(around, tick, corner, candidates=False).kind in ("piece", "bin", "object")
    x, y, _ = tick.robot.true_pose
    assert aimed(around, tick, (x, y, 0.4), candidates=False).kind == "robot"
    far = (tick.robot.true_pose[0] + 40.0, 40.0, 0.0)
    assert aimed(around, tick, far).kind == "floor"
    assert around.first(Ray.through((0.0, 0.0, 1.0), (1.0, 0.0, 2.0)), tick, candidates=True) is None


def test_a_candidate_is_found_only_while_they_are_shown_and_far_away_may_be_missed_by_some_pixels(around, tick):
    viable = next(i for i, reason in enumerate(tick.placement.rejected) if not reason)
    x, y, _ = tick.placement.poses[viable]
    hit = aimed(around, tick, (x, y, 0.035))
    assert hit.kind == "candidate" and math.dist(tick.placement.poses[hit.index][:2], (x, y)) < 0.05
    assert aimed(around, tick, (x, y, 0.035), candidates=False).kind != "candidate"
    eye = np.array([x, y - 12.0, 9.0])
    beside = np.array([x, y - 0.1, 0.035])  # 6 mrad from there: seven pixels of a picture with 900
    assert around.first(Ray.through(eye, beside), tick, candidates=True).kind == "candidate"


def test_a_cube_is_put_on_the_surface_under_the_pointer(around):
    box = around.now.bins[0]
    down = Ray.through((*box.centre, 3.0), (*box.centre, 0.0))
    put = around.surface(down)
    tops = [s.z_max for s in around.now.solids] + [b.floor_z for b in around.now.bins]
    assert any(abs(put[2] - top) < 1e-9 for top in tops)
    assert around.surface(Ray.through((40.0, 40.0, 2.0), (40.0, 41.0, 0.0)))[2] == pytest.approx(0.0)


def test_a_moved_piece_is_found_where_it_is_now(around, tick):
    name, piece = next(iter(around.pieces.items()))
    body = BodyMessage(name=name, kind="furniture", position=[20.0, 20.0, 0.0], yaw=1.0, state="", size=[1.0, 1.0, 1.0])
    moved = msgspec.structs.replace(tick, furniture=[body])
    around.update(moved)
    spot = spot_of(name, moved, around)
    assert (spot.x, spot.y, spot.heading) == (20.0, 20.0, 1.0)
    assert around.first(Ray.through((20.0, 19.9, 9.0), (20.0, 20.0, 0.0)), moved, candidates=False).kind != "floor"
    assert spot_of(name, msgspec.structs.replace(tick, removed=[name]), around) is None
    assert piece.centre != (20.0, 20.0)


def test_a_cube_that_waits_in_the_list_is_found_with_its_bin(tick):
    waiting, done = ([msgspec.structs.replace(t, status=kind) for t in tick.tasks] for kind in ("waiting", "done"))
    assert waiting_job(waiting, waiting[0].target) == (0, waiting[1].target)
    assert waiting_job(waiting, "nothing") is waiting_job(done, done[0].target) is None


class Hub:
    """The part of a hub that pointing needs: who drives, the view, the way to the twin."""

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
def pointing(tick, around):
    made = Clicks(SimpleNamespace(scene=SimpleNamespace(on_click=lambda: lambda act: act)), Hub())
    made.tick, made.surroundings = tick, around
    return made


def click(pointing, point, hidden=frozenset()):
    """Look at a point from above and click it."""
    eye = np.array([point[0], point[1], 5.0])
    event = SimpleNamespace(ray_origin=eye, ray_direction=np.array([0.0, 0.0, -1.0]))
    asyncio.run(pointing._click(event, SimpleNamespace(hidden=hidden)))
    return pointing._hub


@pytest.fixture
def placing(pointing):
    """A body was just added."""
    pointing._hub.view.selected = pointing._hub.view.placing = "temi 1"
    return pointing


def test_the_next_click_on_the_floor_puts_a_new_body_there_and_the_one_after_lets_it_go(placing):
    hub = click(placing, (6.0, -1.5))
    assert hub.sent == [MoveBody(name="temi 1", x=6.0, y=-1.5, held=False)]
    assert (hub.view.selected, hub.view.placing) == ("temi 1", "")
    hub = click(placing, (6.0, -1.0))
    assert len(hub.sent) == 1 and hub.view.selected == ""


def test_a_click_on_the_floor_sends_the_agent_that_is_to_go_somewhere(pointing):
    pointing._hub.view.sending = "temi 1"
    hub = click(pointing, (6.0, -1.5))
    assert hub.sent == [SendAgent(name="temi 1", x=6.0, y=-1.5)] and hub.view.sending == ""


def test_one_click_on_the_floor_proposes_a_drive_that_a_second_one_there_confirms(pointing):
    hub = click(pointing, (6.0, -1.5))
    assert hub.view.going == (6.0, -1.5) and not hub.sent
    hub = click(pointing, (6.0, 0.2))
    assert hub.view.going == (6.0, 0.2) and not hub.sent  # elsewhere: proposed there instead
    hub = click(pointing, TABLE)
    assert hub.view.going is None and not hub.sent
    hub.view.selected = ""
    for _ in range(2):
        click(pointing, (6.0, -1.5))
    assert [task.point for task in hub.sent[0].tasks] == [(6.0, -1.5)] and len(hub.sent) == 1
    assert (hub.view.going, hub.view.sent_to) == (None, "(6.00, -1.50)")


def test_a_dot_of_a_candidate_is_no_more_than_floor_while_something_is_placed(pointing):
    x, y, _ = pointing.tick.placement.poses[pointing.tick.placement.chosen]
    hub = click(pointing, (x, y))
    assert hub.view.picked is not None
    hub.view.picked, hub.view.selected, hub.view.placing = None, "temi 1", "temi 1"
    click(pointing, (x, y))
    assert hub.view.picked is None
    (placed,) = hub.sent
    assert math.dist((placed.x, placed.y), (x, y)) < 0.05


def test_a_refused_place_can_be_tried_again_and_a_click_on_something_else_ends_placing(placing):
    placing._hub.command = lambda *_: Answer(ok=False, reason="the twin server does not answer")
    hub = click(placing, (6.0, -1.5))
    assert hub.view.placing == "temi 1"
    hub = click(placing, TABLE)
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
