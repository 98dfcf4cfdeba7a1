"""Malformed scene files: each gives one clear line with file, line, place and what to do."""

import pytest

from motm_twin.model.names import SceneError
from motm_twin.model.scene_file import check_all, load_scene

GOOD = """\
format: motm-scene/1
title: A good small scene
robot:
  name: test_base
  footprint: {length: 0.70, width: 0.50}
  base: {forward_speed_mps: 0.5}
start: {x: 0.0, y: 0.0, heading_deg: 0}
furniture:
  table: {shape: box, centre: [2.0, 0.0], size: [1.0, 1.0], z: [0.7, 0.75]}
  desk: {shape: polygon, corners: [[0, 2], [1, 2], [1, 3], [0, 3]], z: [0, 0.6]}
  pillar: {shape: cylinder, centre: [-2.0, 0.0], radius: 0.2, z: [0, 2]}
slots:
  A: {surface: table, at: [1.6, 0.3]}
  B: {surface: table, at: [1.6, -0.3]}
objects:
  cube: {surface: table, at: [1.6, 0.0], yaw_deg: 20}
  other: {z: 0.75, at: [2.4, 0.0]}
bins:
  tray: {at: [0.5, 2.3]}
agents:
  temi:
    waypoints: [[-1, -1], [-1, 1], [-3, 1], [-3, -1]]
    speed_mps: 0.4
tasks:
  - pick: cube
  - place: tray
  - drive_to: {x: 0.0, y: -1.0, heading_deg: 90}
noise: {lidar_range_sd: 0.01}
seed: 3
time_limit: 60
default_variant: one
variants:
  one: {}
  two: {deliver: {slots: [A, B], to: [tray]}}
"""

TABLE = "centre: [2.0, 0.0], size: [1.0, 1.0], z: [0.7, 0.75]}"
ROBOT = "  name: test_base\n  footprint: {length: 0.70, width: 0.50}\n  base: {forward_speed_mps: 0.5}\n"
WAYS = "[[-1, -1], [-1, 1], [-3, 1], [-3, -1]]"

BENCH = """\
  seat: {shape: box, centre: [1.6, -3.0], size: [1.0, 0.4], z: [0.6, 0.7], group: bench}
  back: {shape: box, centre: [1.6, -3.3], size: [1.0, 0.1], z: [0.6, 0.9], group: bench}
"""

B = "  B: {surface: table, at: [1.6, -0.3]}"
TRAY = "tray: {at: [0.5, 2.3]"
WORK = "  - pick: cube\n  - place: tray\n  - drive_to: {x: 0.0, y: -1.0, heading_deg: 90}\n"

# name: (old text, new text, place, what the message says)
BAD = {
    # YAML itself
    "broken YAML": ("start: {x: 0.0,", "start: {x: 0.0,,", "", "not valid YAML"),
    "a tab": ("  table: {", "\ttable: {", "", "not valid YAML"),
    "a tag": ("title: A", "title: !!python/object:os.system A", "title", "tag"),
    "an anchor": ("start: {", "start: &s {", "start", "anchors and aliases are not allowed"),
    "an alias": ("seed: 3", "seed: *s", "seed", "anchors and aliases are not allowed"),
    "a merge key": ("start: {x", "start: {<<: {y: 1}, x", "start.<<", "unknown key '<<'"),
    "a key twice": ("seed: 3", "seed: 3\nseed: 4", "seed", "appears twice (first in line 29)"),
    "a name twice": ("  desk: {", "  table: {", "furniture.table", "appears twice (first in line 9)"),
    "a list as key": ("seed: 3", "[1, 2]: 3", "", "a key must be plain text"),
    "too deep": ("seed: 3", "seed: " + "[" * 40 + "]" * 40, "seed" + "[0]" * 24, "nested deeper than 24"),
    "a second document": ("seed: 3", "seed: 3\n---\nformat: motm-scene/1", "", "one file holds one scene"),
    # keys
    "an unknown section": ("seed: 3", "wheels: 3", "wheels", "unknown key 'wheels'"),
    "a near section": ("furniture:", "furnitures:", "furnitures", "did you mean furniture?"),
    "a near key": ("size: [1.0, 1.0]", "sise: [1.0, 1.0]", "furniture.table.sise", "did you mean size?"),
    "a missing key": ("size: [1.0, 1.0], ", "", "furniture.table", "the key 'size' is missing"),
    "no format": ("format: motm-scene/1\n", "", "", "write 'format: motm-scene/1'"),
    "another format": ("motm-scene/1", "motm-scene/9", "format", "motm-scene/1"),
    "a bad name": ("  desk: {", "  'my desk!': {", "furniture.my desk!", "begins with a letter"),
    # units
    "heading without unit": ("heading_deg: 0}", "heading: 0}", "start.heading", "missing unit: write 'heading_deg'"),
    "yaw without unit": ("yaw_deg: 20", "yaw: 20", "objects.cube.yaw", "missing unit: write 'yaw_deg' (degrees)"),
    "speed without unit": ("    speed_mps", "    speed", "agents.temi.speed", "missing unit: write 'speed_mps' (m/s)"),
    "limit without unit": ("forward_speed_mps", "forward_speed", "robot.base.forward_speed", "forward_speed_mps"),
    "radians": ("heading_deg: 0}", "heading_rad: 0}", "start.heading_rad", "wrong unit 'rad': write 'heading_deg'"),
    "centimetres": ("radius: 0.2", "radius_cm: 20", "furniture.pillar.radius_cm", "lengths are in m"),
    "a unit in the value": ("speed_mps: 0.4", "speed_mps: 0.4 m/s", "agents.temi.speed_mps", "write the bare number"),
    # kinds of values
    "text for a number": ("radius: 0.2", "radius: wide", "furniture.pillar.radius", "expected a number, got 'wide'"),
    "a number for text": ("pick: cube", "pick: 7", "tasks[0].pick", "expected text, got 7"),
    "a list for a mapping": ("start: {x: 0.0, y: 0.0, heading_deg: 0}", "start: [0, 0]", "start", "expected a mapping"),
    "a number for a list": ("size: [1.0, 1.0]", "size: 1.0", "furniture.table.size", "expected a list, got 1.0"),
    "three for two": ("size: [1.0, 1.0]", "size: [1, 1, 1]", "furniture.table.size", "exactly 2 values, got 3"),
    "yes for true": (TABLE, TABLE[:-1] + ", mapped: yes}", "furniture.table.mapped", "expected true or false"),
    "an unknown shape": (
        *("shape: cylinder", "shape: cone", "furniture.pillar.shape"),
        "there are: box, cylinder, polygon",
    ),
    "no shape": ("shape: cylinder, ", "", "furniture.pillar", "the key 'shape' is missing"),
    "an unknown behaviour": ("speed_mps: 0.4", "behaviour: yeild", "agents.temi.behaviour", "did you mean yield?"),
    "an unknown robot": ("robot:\n" + ROBOT, "robot: fetch\n", "robot", "'fetch' is not allowed; there are: frankie"),
    "half a seed": ("seed: 3", "seed: 3.5", "seed", "expected a whole number, got 3.5"),
    "a negative seed": ("seed: 3", "seed: -3", "seed", "must be >= 0"),
    # numbers
    "NaN": ("radius: 0.2", "radius: .nan", "furniture.pillar.radius", "nan is not a usable number"),
    "infinity": ("x: 0.0, y: 0.0", "x: .inf, y: 0.0", "start.x", "inf is not a usable number"),
    "overflow": ("x: 0.0, y: 0.0", "x: 1e999, y: 0.0", "start.x", "inf is not a usable number"),
    "zero size": ("size: [1.0, 1.0]", "size: [1.0, 0]", "furniture.table.size[1]", "must be > 0 and <= 100, got 0"),
    "negative radius": ("radius: 0.2", "radius: -0.2", "furniture.pillar.radius", "must be > 0"),
    "far away": ("centre: [-2.0", "centre: [-2000", "furniture.pillar.centre[0]", "must be >= -100"),
    "zero speed": ("speed_mps: 0.4", "speed_mps: 0", "agents.temi.speed_mps", "must be > 0"),
    "negative noise": ("sd: 0.01", "sd: -0.01", "noise.lidar_range_sd", "must be >= 0"),
    "heights upside down": ("z: [0.7, 0.75]", "z: [0.75, 0.7]", "furniture.table.z", "must be above the lower one"),
    # shapes
    "two corners": ("[[0, 2], [1, 2], [1, 3], [0, 3]]", "[[0, 2], [1, 2]]", "furniture.desk.corners", "at least 3"),
    "an outline that crosses itself": ("[1, 3], [0, 3]", "[0, 3], [1, 3]", "furniture.desk.corners", "crosses itself"),
    "an outline without area": ("[1, 3], [0, 3]]", "[2, 2]]", "furniture.desk.corners", "has no area"),
    # start, objects, bins
    "a post in the arm": ("[-2.0, 0.0], radius: 0.2", "[0.6, 0.0], radius: 0.05", "start", "inside 'pillar'"),
    "an overlapping start": ("{x: 0.0, y: 0.0, h", "{x: 1.2, y: 0.0, h", "start", "overlaps 'table' at the start"),
    "a turned start": ("x: 0.0, y: 0.0, heading_deg: 0", "x: 1.12, y: 0, heading_deg: 30", "start", "'table'"),
    "a cube off its table": ("at: [1.6, 0.0]", "at: [1.3, 0.0]", "objects.cube.at", "off its surface 'table' (not"),
    "a cube over the edge": ("at: [1.6, 0.0]", "at: [1.5, 0.0]", "objects.cube.at", "the edge of its surface 'table'"),
    "a cube on nothing": ("{z: 0.75,", "{z: 0.9,", "objects.other.at", "is off its surface (nothing"),
    "a cube off the top of a group": ("slots:\n  A: {surface: table", BENCH + "slots:\n  A: {surface: bench",
                                      "slots.A.at", "is off its surface 'back', the highest piece of 'bench' (nothing"),
    "a cube on no furniture": ("cube: {surface: table", "cube: {surface: tabel", "objects.cube.surface", "mean table?"),
    "a cube in two ways": ("{z: 0.75,", "{surface: table, z: 0.75,", "objects.other", "exactly one of 'surface'"),
    "two cubes in one place": ("[2.4, 0.0]", "[1.63, 0.0]", "objects.other.at", "overlaps the object 'cube'"),
    "a cube in a bin": ("{z: 0.75, at: [2.4, 0.0]", "{surface: desk, at: [0.5, 2.4]", "objects.other.at", "in the bin"),
    "a cube too wide": ("yaw_deg: 20", "side: 0.09", "objects.cube.side", "too wide for the gripper"),
    "a colour in capitals": ("yaw_deg: 20", "colour: BLUE", "objects.cube.colour", "'#rrggbb'; did you mean blue?"),
    "cubes of slots too wide": ("to: [tray]}", "to: [tray], side: 0.08}", "variants.two.deliver.side", "too wide"),
    "a gripper too narrow": (ROBOT, ROBOT + "  gripper: {max_width: 0.045}\n", "robot.gripper.max_width", "too wide"),
    "a bin upside down": ("at: [0.5, 2.3]", "at: [0.5, 2.3], rim_z: 0.6", "bins.tray", "must be above the floor"),
    "a bin in the desk": ("at: [0.5, 2.3]", "at: [0.5, 2.3], floor_z: 0.5", "bins.tray", "sunk into 'desk'"),
    "a bin too narrow": ("at: [0.5, 2.3]", "at: [0.5, 2.3], side: 0.06", "bins.tray", "too narrow"),
    "a name for two things": ("  tray: {", "  table: {", "bins.table", "also used in furniture"),
    # reach
    "an unreachable cube": ("[2.0, 0.0], size: [1.0, 1.0]", "[3.5, 0.0], size: [4, 4]", "objects.other", "unreachable"),
    "a cube too high": ("table, at: [1.6, 0.0]", "pillar, at: [-2, 0]", "objects.cube", "2.02 m high, the arm reaches"),
    "an unreachable bin": ("tray: {at: [0.5, 2.3]", "tray: {at: [8, 8], rim_z: 4, floor_z: 3.9", "bins.tray", "unreac"),
    "a goal in the desk": ("x: 0.0, y: -1.0", "x: 0.5, y: 2.5", "tasks[2].drive_to", "cannot get to (0.5, 2.5)"),
    "a tight goal": ("y: -1.0, heading_deg: 90", "y: 1.7, heading_deg: 90", "tasks[2].drive_to", "overlaps 'de"),
    "out of bounds": ("seed: 3", "bounds: [-1, -1, 1, 1]", "bounds", "outside the bounds"),
    "bounds upside down": ("seed: 3", "bounds: [1, 1, -1, -1]", "bounds", "min below max"),
    "a huge map": ("centre: [-2.0, 0.0]", "centre: [-90, 0.0]", "", "at most 60 m a side"),
    # tasks
    "an unknown object": ("pick: cube", "pick: cueb", "tasks[0].pick", "did you mean cube?"),
    "an unknown bin": ("place: tray", "place: tary", "tasks[1].place", "did you mean tray?"),
    "a cube picked twice": ("  - drive_to", "  - pick: cube\n  - drive_to", "tasks[2].pick", "already picked"),
    "nothing held": ("  - pick: cube\n", "", "tasks[0].place", "nothing is held"),
    "two held": ("  - place: tray", "  - pick: other", "tasks[1].pick", "'cube' is still held"),
    "a task of two kinds": ("  - place: tray", "  - {pick: other, place: tray}", "tasks[1]", "exactly one of pick"),
    "no tasks": (WORK, "  []\n", "tasks", "at least 1 entries"),
    # agents
    "a waypoint in furniture": ("[-3, 1],", "[-2.1, 0.1],", "agents.temi.waypoints[2]", "inside 'pillar'"),
    "a way through furniture": (WAYS, "[[-1, 0], [-3, 0]]", "agents.temi.waypoints[1]", "leads through 'pillar'"),
    "an agent in the robot": (WAYS, "[[0.2, 0], [1, 0.9]]", "agents.temi", "starts inside the robot"),
    "an agent nowhere": ("    waypoints: " + WAYS + "\n", "", "agents.temi", "where does it stand?"),
    "a lane round nothing": (f"waypoints: {WAYS}", "around: {furniture: sofa, distance: 1}",
                             "agents.temi.around.furniture", "there is no furniture 'sofa'"),
    "too many waypoints": (WAYS, str([[-1, 1]] * 300), "agents.temi.waypoints", "at most 200, got 300"),
    # robot
    "a slow lidar": ("  base: {", "  lidar: {rate_hz: 6}\n  base: {", "robot.lidar", "set rate_hz to 6.7 or more"),
    "an arm beside the base": ("  base: {", "  arm: {mount_x: 0.6}\n  base: {", "robot.arm", "outside the footprint"),
    # variants and files
    "an unknown default": ("default_variant: one", "default_variant: oen", "default_variant", "did you mean one?"),
    "an unknown slot": ("slots: [A, B]", "slots: [A, C]", "variants.two.deliver.slots[1]", "there is no slot 'C'"),
    "a slot twice": ("slots: [A, B]", "slots: [A, A]", "variants.two.deliver.slots[1]", "already picked"),
    "too many random slots": ("slots: [A, B]", "slots: {random: 3}", "variants.two.deliver.slots.random", "only 2"),
    "deliver to nowhere": ("to: [tray]", "to: [try]", "variants.two.deliver.to[0]", "did you mean tray?"),
    "an unknown key in a variant": ("one: {}", "one: {sede: 3}", "variants.one.sede", "did you mean seed?"),
    "an unknown agent": ("one: {}", "one: {keep_agents: [bob]}", "variants.one.keep_agents[0]", "no agent 'bob'"),
    "nothing to remove": ("one: {}", "one: {bins: {tub: null}}", "variants.one.bins.tub", "could be removed"),
    "a path outside the folder": ("seed: 3", "extends: ../secret", "extends", "leaves the folder"),
    "an absolute path": ("seed: 3", "extends: /etc/passwd", "extends", "leaves the folder"),
    "extends nothing": ("seed: 3", "extends: exp11", "extends", "did you mean exp1"),
    "extends itself": ("seed: 3", "extends: scene", "extends", "break the circle"),
}  # fmt: skip


def refusal(path) -> str:
    with pytest.raises(SceneError) as caught:
        check_all(str(path))
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.fixture
def scene(tmp_path):
    path = tmp_path / "scene.yaml"
    path.write_text(GOOD, encoding="utf-8")
    return path


def test_the_scene_that_the_mutations_start_from_is_good(scene):
    assert [found.variant for found in check_all(str(scene))] == ["one", "two"]


@pytest.mark.parametrize(("old", "new", "place", "says"), BAD.values(), ids=BAD.keys())
def test_a_malformed_file_gives_one_message_with_file_line_and_place(scene, old, new, place, says):
    assert old in GOOD
    text = GOOD.replace(old, new, 1)
    scene.write_text(text, encoding="utf-8")
    message = refusal(scene)
    head, _, rest = message.removeprefix(str(scene)).partition(": ")
    assert message.startswith(f"{scene}:")
    assert 1 <= int(head.removeprefix(":")) <= text.count("\n") + 1
    assert rest.startswith(f"{place}: ") if place else True
    assert says in message


@pytest.mark.parametrize(("old", "line"), [("radius: 0.2", 11), ("x: 0.0, y: 0.0", 7), ("pick: cube", 25)])
def test_the_line_is_that_of_the_wrong_value(scene, old, line):
    scene.write_text(GOOD.replace(old, old.split(":")[0] + ": .nan", 1), encoding="utf-8")
    assert refusal(scene).startswith(f"{scene}:{line}: ")


def test_an_error_inherited_from_another_file_names_that_file(tmp_path):
    (tmp_path / "base.yaml").write_text(GOOD.replace("radius: 0.2", "radius: -1"), encoding="utf-8")
    top = tmp_path / "top.yaml"
    top.write_text("format: motm-scene/1\nextends: base\n", encoding="utf-8")
    assert refusal(top).startswith(f"{tmp_path / 'base.yaml'}:11: furniture.pillar.radius: ")


def test_a_link_that_leaves_the_folder_is_refused(tmp_path, scene):
    inner = tmp_path / "inner"
    inner.mkdir()
    (inner / "linked.yaml").symlink_to(scene)
    top = inner / "top.yaml"
    top.write_text("format: motm-scene/1\nextends: linked\n", encoding="utf-8")
    assert "leaves the folder" in refusal(top)


def test_files_that_extend_one_another_in_a_circle_are_refused(tmp_path):
    for name, other in (("a", "b"), ("b", "a")):
        (tmp_path / f"{name}.yaml").write_text(f"format: motm-scene/1\nextends: {other}\n", encoding="utf-8")
    assert "break the circle" in refusal(tmp_path / "a.yaml")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"# only a comment\n", "the file is empty"),
        (b"- a\n- b\n", "a scene is a mapping"),
        (b"just words", "a scene is a mapping"),
        (b"format: motm-scene/1\n", "nothing to do"),
        (b"format: motm-scene/1\ntitle: \xff\xfe\n", "not UTF-8"),
        (b"format: motm-scene/1\ntitle: \x07\n", "not valid YAML"),
        (b"#" * ((1 << 20) + 1), "larger than 1 MiB"),
        (b"[" * 100_000, "nested deeper"),
        (b"bounds: [" + b"1, " * 100_000 + b"1]", "more than 100000 values"),
        (b"? " + b"k" * 5000 + b"\n: 1\n", "at most 80"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_scene_is_refused(tmp_path, content, says):
    path = tmp_path / "scene.yaml"
    path.write_bytes(content)
    message = refusal(path)
    assert message.startswith(str(path))
    assert says in message


def test_a_billion_laughs_are_not_expanded(tmp_path):
    lines = ["a0: &a0 [x, x]"] + [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]" for i in range(1, 12)]
    path = tmp_path / "laughs.yaml"
    path.write_text("\n".join(lines), encoding="utf-8")
    assert "anchors and aliases are not allowed" in refusal(path)


def test_a_wrong_scene_name_lists_the_near_ones():
    with pytest.raises(SceneError, match=r"no scene is called 'playgroud'.*did you mean playground\?"):
        load_scene("playgroud")


def test_a_wrong_variant_lists_the_near_ones():
    with pytest.raises(SceneError, match=r"scenes/exp1.yaml: there is no variant 'trail1'; did you mean trial1"):
        load_scene("exp1", "trail1")


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nowhere/mine.yaml", "no such scene file"),
        ("scenes/exp1.yml", "'exp1' is called without folder"),
        ("/etc/hostname", "ends with .yaml"),
        (".", "'.': it is a folder: name a scene file in it"),
        ("scenes", "'scenes': it is a folder"),
        ("", "no scene is called ''"),
        ("a\0b.yaml", "no such scene file"),
        ("x" * 5000, "no scene is called"),
        ("x" * 5000 + ".yaml", "no such scene file"),
    ],
)
def test_a_wrong_path_says_what_to_do(name, says):
    with pytest.raises(SceneError, match=says.replace(".", r"\.")):
        load_scene(name)


@pytest.mark.parametrize("seed", [-1, 2**63])
def test_a_seed_out_of_range_is_refused(seed):
    with pytest.raises(SceneError, match="the seed must be a whole number from 0"):
        load_scene("exp1", "random", seed)


@pytest.mark.parametrize(("height", "good"), [(0.9, True), (1.1, True), (1.2, False), (1.4, False)])
def test_a_cube_is_refused_that_the_hand_cannot_get_over(tmp_path, height, good):
    """Reach was a sphere round the shoulder: a cube 1.2 m high passed, and no hand that points down gets there."""
    text = GOOD.replace("table, at: [1.6, 0.0]", "pillar, at: [-2, 0]").replace("[0, 2]}", f"[0, {height - 0.02:g}]}}")
    (tmp_path / "high.yaml").write_text(text)
    if good:
        load_scene(str(tmp_path / "high.yaml"))
    else:
        with pytest.raises(SceneError, match=f"{height:.2f} m high, the arm reaches up to 1.1"):
            load_scene(str(tmp_path / "high.yaml"))


ON_AN_EDGE = "  B: {surface: table, at: [1.5, -0.3]}"
BESIDE = "  B: {surface: table, at: [1.63, 0.3]}\n  C: {surface: table, at: [2.3, 0.3]}"  # B is partly where A is


@pytest.mark.parametrize(
    ("slots", "number", "says"),
    [
        (ON_AN_EDGE, 1, "slots.B.at: the cube at (1.5, -0.3) hangs over the edge"),
        (ON_AN_EDGE, 2, "slots.B.at: the cube at (1.5, -0.3) hangs over the edge"),
        (BESIDE, 2, ".at: it overlaps the object 'cube_"),
        (BESIDE, 1, ""),  # they are never there together
    ],
)
def test_every_slot_that_a_seed_may_draw_is_checked(scene, slots, number, says):
    """Only those that the seed of the file draws were: a run with another seed was refused."""
    text = GOOD.replace("  B: {surface: table, at: [1.6, -0.3]}", slots)
    text = text.replace("slots: [A, B]", f"slots: {{random: {number}}}")
    for seed in range(4):
        scene.write_text(text.replace("seed: 3", f"seed: {seed}"), encoding="utf-8")
        if says:
            assert says in refusal(scene)
        else:
            check_all(str(scene))


@pytest.mark.parametrize(
    ("board", "says"),
    [  # the cube is 1.6 m ahead, on a table from 1.5 m on
        (
            "centre: [2.0, 0.0], size: [1.0, 1.0], z: [0.825, 0.85]",
            "objects.cube.at: the hand reaches it only from above",
        ),
        ("centre: [1.9, 0.0], size: [1.2, 1.0], z: [0.94, 0.96]", "'board' is 0.15 m above it"),
        ("centre: [1.9, 0.0], size: [1.2, 1.0], z: [0.96, 0.98]", ""),  # above the tool; the arm may not get there
        ("centre: [2.1, 0.0], size: [1.0, 1.0], z: [0.825, 0.85]", ""),  # the cube is at its edge
        ("centre: [0.5, 2.3], size: [0.6, 0.6], z: [0.76, 0.78]", "bins.tray.at: the hand reaches it only from above"),
        ("centre: [0.5, 2.5], size: [0.6, 0.6], z: [0.76, 0.78]", ""),  # over half of the bin
    ],
)
def test_a_board_so_low_that_no_hand_comes_between_is_refused(scene, board, says):
    """A board 3.5 cm above a cube, or over a whole bin, was good: the robot tried for all of its time."""
    text = GOOD.replace("slots:\n", f"  board: {{shape: box, {board}}}\nslots:\n")
    scene.write_text(text.replace("  other: {z: 0.75, at: [2.4, 0.0]}\n", ""), encoding="utf-8")
    if says:
        assert says in refusal(scene)
    else:
        check_all(str(scene))


def test_a_cube_below_a_bin_is_refused(scene):
    """Furniture above a cube was looked for, bins were not."""
    text = GOOD.replace(
        "slots:\n", "  pole: {shape: cylinder, centre: [2.33, 0.07], radius: 0.02, z: [0.75, 0.86]}\nslots:\n"
    )
    scene.write_text(
        text.replace("bins:\n", "bins:\n  high: {at: [2.33, 0.07], rim_z: 0.97, floor_z: 0.87}\n"), "utf-8"
    )
    assert "objects.other.at: the hand reaches it only from above, and 'high' is 0.07 m above it" in refusal(scene)


@pytest.mark.parametrize(
    ("doorway", "goal", "says"),
    [
        (
            0.4,
            "y: -1.0",
            "bins.tray: the bin 'tray' is unreachable: there is a free base position near it, but no way to",
        ),
        (
            0.4,
            "y: 4.0",
            "tasks[0].drive_to: the robot cannot get to (0, 4): there is room for the base, but no way to it",
        ),
        (0.6, "y: 4.0", ""),
    ],
)
def test_a_place_behind_a_narrow_doorway_is_told_from_one_without_room(scene, doorway, goal, says):
    """A doorway too narrow for the base was told as no free position beside the bin."""
    wall = 6.0 - doorway / 2.0
    walls = "".join(
        f"  {name}: {{shape: box, centre: [{side * (6.0 - wall / 2.0)}, 1.35], size: [{wall}, 0.1], z: [0, 2]}}\n"
        for name, side in (("left", 1.0), ("right", -1.0))
    )
    text = GOOD.replace("slots:\n", walls + "slots:\n").replace(TRAY, "tray: {at: [0.5, 2.8]")
    text = text.replace("seed: 3", "bounds: [-6, -4, 6, 5]").replace("y: -1.0", goal)
    if goal != "y: -1.0":
        text = text.replace("  - pick: cube\n  - place: tray\n", "").replace("robot:\n", "robot:\n  arm: none\n")
        text = text.replace("two: {deliver: {slots: [A, B], to: [tray]}}", "two: {}")
    scene.write_text(text, encoding="utf-8")
    if not says:
        check_all(str(scene))
        return
    message = refusal(scene)
    assert says in message
    assert message.endswith("make a passage wider than 0.5 m")


@pytest.mark.parametrize(
    ("slots", "says"),
    [
        ("[A, B]", "deliver.slots[1]: there is no slot 'B'; there are: A (in the variant 'two')"),
        ("[A, C]", "deliver.slots[1]: there is no slot 'C'; there are: A, B"),  # without variants, too
    ],
)
def test_a_refusal_names_the_variant_that_is_the_cause(scene, slots, says):
    """A variant took a slot away that the scene's own `deliver` used, and the message pointed at `deliver`."""
    text = GOOD.replace("tasks:\n" + WORK, f"deliver: {{slots: {slots}, to: [tray]}}\n")
    scene.write_text(text.replace("two: {deliver: {slots: [A, B], to: [tray]}}", "two: {slots: {B: null}}"), "utf-8")
    assert refusal(scene).endswith(says)
