"""Markers of scenes with polygons, moved furniture and things that are gone."""

import pytest
from ear import JAZZY

from motm_twin.bus.encode import tick_message
from motm_twin.model.edits import MoveBody, RemoveBody
from motm_twin.model.furniture import pieces, stands_on
from motm_twin.model.scene import Prism
from motm_twin.model.scene_file import load_scene
from motm_twin.ros2.cdr import encode
from motm_twin.ros2.convert import DELETE, TRIANGLE_LIST, Markers
from motm_twin.ros2.forms import MARKERS
from motm_twin.twin import Twin


@pytest.fixture(scope="module")
def twin():
    return Twin(load_scene("playground", None, None))


def drawn(markers, tick):
    """What rosbags reads, by namespace and number."""
    message = JAZZY.deserialize_cdr(encode(MARKERS.message, markers.array(tick_message(tick, 1, 0.0))), MARKERS.message)
    return {(marker.ns, marker.id): marker for marker in message.markers}


def test_every_solid_and_bin_of_a_scene_is_drawn(twin):
    twin.reset()
    markers = Markers()
    markers.show(twin.scene)
    found = drawn(markers, twin.advance())
    assert sum(ns == "furniture" for ns, _ in found) == len(twin.scene.solids)
    assert sum(ns == "bins" for ns, _ in found) == len(twin.scene.bins)
    assert sum(ns == "agents" for ns, _ in found) == len(twin.scene.agents)
    prisms = [solid for solid in twin.scene.solids if isinstance(solid.shape, Prism)]
    shapes = [marker for marker in found.values() if marker.type == TRIANGLE_LIST]
    assert len(shapes) == len(prisms) > 0
    for marker, solid in zip(shapes, prisms, strict=True):
        corners = len(solid.shape.corners)
        assert len(marker.points) == 3 * (2 * corners + corners - 2)  # two for each side, and the top
        assert {point.z for point in marker.points} == {solid.z_min, solid.z_max}


def empty(scene, piece):
    cubes = [stands_on(scene, piece, item.position[:2], item.position[2] - 0.5 * item.side) for item in scene.objects]
    return not piece.bins and not any(cubes)


def test_moved_furniture_keeps_its_number_and_what_is_gone_is_deleted_once(twin):
    twin.reset()
    markers = Markers()
    markers.show(twin.scene)
    before = drawn(markers, twin.advance())
    piece = next(piece for piece in pieces(twin.scene).values() if empty(twin.scene, piece))
    x, y = piece.centre
    twin.post(MoveBody(name=piece.name, x=x + 0.1, y=y, held=False))
    moved = drawn(markers, twin.advance())
    assert set(moved) == set(before)
    shifts = {round(moved[k].pose.position.x - before[k].pose.position.x, 3) for k in before if k[0] == "furniture"}
    assert shifts == {0.0, 0.1}
    twin.post(RemoveBody(name=piece.name))
    after = drawn(markers, twin.advance())
    gone = [key for key, marker in after.items() if marker.action == DELETE]
    assert len(gone) == len(piece.solids)
    again = drawn(markers, twin.advance())
    assert not [marker for marker in again.values() if marker.action == DELETE]
    assert set(again) == set(before) - set(gone)


def test_a_candidate_that_was_rejected_is_grey_and_cheap_is_brighter_than_dear(twin):
    twin.reset()
    markers = Markers()
    tick = twin.advance()
    dots = drawn(markers, tick)["candidates", 0]
    cost = tick.placement.cost.tolist()
    viable = [i for i, why in enumerate(tick.placement.rejected) if not why]
    cheap, dear = min(viable, key=cost.__getitem__), max(viable, key=cost.__getitem__)
    brightness = [colour.r + colour.g + colour.b for colour in dots.colors]
    assert brightness[cheap] > brightness[dear]
    assert all((dots.colors[i].a < 0.5) == (i not in viable) for i in range(len(cost)))
