"""Doubts about scenes that load and run: each is one line with file, line and place, and nothing is refused."""

import pytest

from motm_twin.model.names import SceneError
from motm_twin.model.scene_doubts import doubts
from motm_twin.model.scene_file import check_document, load_document, load_scene, shipped_names, strangers_names
from motm_twin.sessions.scene_limits import check_scene

GOOD = """\
format: motm-scene/1
title: A good small scene
furniture:
  table: {shape: box, centre: [2.0, 0.0], size: [1.0, 1.0], z: [0.7, 0.75]}
  desk: {shape: polygon, corners: [[0, 2], [1, 2], [1, 3], [0, 3]], z: [0, 0.6]}
slots:
  A: {surface: table, at: [1.6, 0.3]}
  B: {surface: table, at: [1.6, -0.3]}
objects:
  cube: {surface: table, at: [1.6, 0.0], yaw_deg: 20}
  other: {z: 0.75, at: [2.4, 0.0]}
bins:
  tray: {at: [0.5, 2.3]}
tasks:
  - pick: cube
  - place: tray
variants:
  one: {}
  two: {deliver: {slots: [A, B], to: [tray]}}
"""

A = "  A: {surface: table, at: [1.6, 0.3]}"
CUBE = "cube: {surface: table, at: [1.6, 0.0], yaw_deg: 20"
OTHER = "other: {z: 0.75, at: [2.4, 0.0]"
DESK = "  desk: {shape"
TRAY = "tray: {at: [0.5, 2.3]"
POSTS = "  {}: {{shape: box, centre: {}, size: [0.02, 0.02], z: [0.75, {}]}}\n"
WALLS = POSTS.format("left", [1.6, 0.04], 0.85) + POSTS.format("right", [1.64, 0.0], 0.85)

# name: (old text, new text, place, what the doubt says)
DOUBTFUL = {
    "a bin on nothing": (TRAY, "tray: {at: [-1.0, -2.0]", "bins.tray", "under its middle is the floor: move it over"),
    "a bin over an edge": (TRAY, "tray: {at: [0.5, 1.95]", "bins.tray", "it floats: its floor_z is 0.62 m, and under"),
    "a bin above its desk": (TRAY, TRAY + ", floor_z: 0.65", "bins.tray", "under its middle is 'desk', 0.6 m high"),
    "a bin that floats in one variant": ("one: {}", "one: {furniture: {desk: null}}", "bins.tray",
                                         "or lower floor_z and rim_z (in the variant 'one')"),
    "a bin too full": (TRAY, TRAY + ", side: 0.08, rim_z: 0.64", "bins.tray",
                       "0.13 litres of cubes go into it, up to its rim it holds 0.072: make it larger, or put less "
                       "into it (in the variant 'two')"),
    "an unused slot off its table": (A, A + "\n  C: {surface: table, at: [1.3, 0.3]}", "slots.C.at", "is off its surf"),
    "an unused slot on nothing": (A, A + "\n  C: {surface: tabel, at: [1.6, 0.4]}", "slots.C.surface", "mean table?"),
    "an unused slot in a bin": (A, A + "\n  C: {surface: desk, at: [0.5, 2.3]}", "slots.C.at", "in the bin 'tray'"),
    "a colour with a typo": (CUBE, CUBE + ", colour: blu", "objects.cube.colour",
                             "'blu' is no known colour, and drawn red; did you mean blue?"),
    "a colour of slots": ("to: [tray]}", "to: [tray], colour: pink}", "variants.two.deliver.colour", "'pink' is no"),
    "walls beside a cube": (DESK, WALLS + DESK, "objects.cube.at",
                            "which need 27 mm beside two opposite faces: 'right' and 'left' are in the way"),
}  # fmt: skip

GOOD_TOO = {
    "a known colour": (CUBE, CUBE + ", colour: purple"),
    "a colour by its numbers": (CUBE, CUBE + ", colour: '#7a3fa1'"),
    "a basket on the floor": (TRAY, "tray: {at: [-1.0, -2.0], floor_z: 0.2, rim_z: 0.4"),
    "a slot that one variant can use": (A + "\n", A + "\n  C: {surface: shelf, at: [-1.0, -3.0]}\n"),
    "a wall beside one pair of faces": (DESK, POSTS.format("left", [1.6, 0.04], 0.85) + DESK),
    "walls lower than the fingers": (DESK, WALLS.replace("0.85", "0.765") + DESK),
    "a cube that is not picked": (OTHER, OTHER.replace("[2.4, 0.0]", "[1.6, 0.05]")),
}


@pytest.fixture
def scene(tmp_path):
    return tmp_path / "scene.yaml"


def test_the_scene_that_the_mutations_start_from_gives_no_doubt(scene):
    scene.write_text(GOOD, encoding="utf-8")
    assert doubts(load_document(str(scene))) == ()


@pytest.mark.parametrize(("old", "new", "place", "says"), DOUBTFUL.values(), ids=DOUBTFUL.keys())
def test_a_doubt_has_file_line_and_place_and_the_scene_loads(scene, old, new, place, says):
    assert old in GOOD
    scene.write_text(GOOD.replace(old, new, 1), encoding="utf-8")
    document = load_document(str(scene))
    assert len(check_document(document)) == 2
    for variant in ("one", "two"):
        check_scene(load_scene(str(scene), variant))
    (doubt,) = doubts(document)
    assert isinstance(doubt, SceneError)
    assert str(doubt).startswith(f"{scene}:{doubt.line}: {place}: ")
    assert says in str(doubt)


@pytest.mark.parametrize(("old", "new"), GOOD_TOO.values(), ids=GOOD_TOO.keys())
def test_what_is_in_order_gives_no_doubt(scene, old, new):
    assert old in GOOD
    shelf = "{shape: box, centre: [-1, -3], size: [0.6, 0.6], z: [0, 0.7]}"
    text = GOOD.replace("one: {}", f"one: {{}}\n  more: {{furniture: {{shelf: {shelf}}}}}")
    scene.write_text(text.replace(old, new, 1), encoding="utf-8")
    document = load_document(str(scene))
    check_document(document)
    assert doubts(document) == ()


@pytest.mark.parametrize(("first", "doubted"), [("", True), ("  - pick: other\n  - place: tray\n", False)])
def test_a_cube_that_is_taken_away_before_leaves_room_for_the_fingers(scene, first, doubted):
    text = GOOD.replace(OTHER, OTHER.replace("[2.4, 0.0]", "[1.6, 0.06]")).replace("yaw_deg: 20", "yaw_deg: 0")
    text = text.replace(DESK, POSTS.format("right", [1.64, 0.0], 0.85) + DESK)
    scene.write_text(text.replace("tasks:\n", "tasks:\n" + first), encoding="utf-8")
    document = load_document(str(scene))
    check_document(document)
    assert [doubt.place for doubt in doubts(document)] == ["objects.cube.at"] * doubted


@pytest.mark.parametrize(("detections", "bin_", "apart", "doubted"), [
    ("anonymous", "tub", 0.08, True), ("anonymous", "tub", 0.09, False), ("anonymous", "tray", 0.08, False),
    ("named", "tub", 0.08, False),
])  # fmt: skip
def test_cubes_for_two_bins_nearer_than_their_places_are_known_may_be_taken_for_each_other(
    scene, detections, bin_, apart, doubted
):
    text = GOOD.replace(OTHER, OTHER.replace("[2.4, 0.0]", f"[1.6, {apart}]"))
    text = text.replace("  tray:", "  tub: {at: [0.3, 2.7], side: 0.3}\n  tray:").replace("[0.5, 2.3]", "[0.7, 2.3]")
    tasks = f"tasks:\n  - pick: other\n  - place: {bin_}\n"
    scene.write_text(f"detections: {detections}\n" + text.replace("tasks:\n", tasks), encoding="utf-8")
    found = doubts(load_document(str(scene)))
    assert [doubt.place for doubt in found] == ["objects.other.at"] * doubted
    assert all("taken for 'cube', 80 mm away, which goes into another bin" in str(doubt) for doubt in found)


def test_several_doubts_are_in_the_order_of_the_file(scene):
    text = GOOD.replace(TRAY, "tray: {at: [-1.0, -2.0]").replace(CUBE, CUBE + ", colour: blu")
    scene.write_text(text.replace(A, A + "\n  C: {surface: table, at: [1.3, 0.3]}"), encoding="utf-8")
    places = [doubt.place for doubt in doubts(load_document(str(scene)))]
    assert places == ["slots.C.at", "objects.cube.colour", "bins.tray"]


def test_shipped_scenes_give_no_doubt_but_one_cube_too_tight_and_two_that_look_alike():
    found = [doubt for name in [*shipped_names(), *strangers_names()] for doubt in doubts(load_document(name))]
    assert [(doubt.file, doubt.place) for doubt in found] == [
        ("scenes/strangers/cluttered_workbench.yaml", "objects.cork.at"),
        ("scenes/strangers/floorbin_workshop_n.yaml", "objects.shim.at"),
    ]
