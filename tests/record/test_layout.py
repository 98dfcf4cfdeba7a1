"""The layout for Foxglove and Lichtblick names what recordings have."""

import json
from pathlib import Path

import msgspec

from motm_twin.bus.encode import RobotEncoder
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene_file import load_scene
from motm_twin.record import channels as ch
from motm_twin.record.foxglove import WORLD
from motm_twin.twin import Twin

LAYOUT = json.loads((Path(__file__).parents[2] / "docs" / "foxglove_layout.json").read_text())
PANELS = LAYOUT["configById"]


def leaves(node):
    if isinstance(node, str):
        return [node]
    return [*leaves(node["first"]), *leaves(node["second"])]


def test_every_panel_is_placed_and_every_placed_panel_is_there():
    placed = leaves(LAYOUT["layout"])
    tabs = [leaf for tab in PANELS["Tab!right"]["tabs"] for leaf in leaves(tab["layout"])]
    assert sorted([*placed, *tabs]) == sorted(PANELS)


def test_the_scene_shows_every_drawn_topic_and_no_other():
    shown = set(PANELS["3D!motm"]["topics"])
    drawn = {topic for topic, channel in ch.CHANNELS.items() if channel.schema}
    assert shown == drawn - {ch.DRAWN_FRAMES.topic, ch.DRAWN_LOG.topic}
    assert PANELS["RosOut!log"]["topicToRender"] == ch.DRAWN_LOG.topic
    assert PANELS["RawMessages!tick"]["topicPath"] == ch.TICK.topic


def test_no_frame_is_drawn_over_the_robot():
    """Foxglove draws axes at every frame that is not hidden, and a line from it to its parent."""
    hidden = {name for name, frame in PANELS["3D!motm"]["transforms"].items() if not frame["visible"]}
    robot = RobotEncoder(RobotProfile()).state(Twin(load_scene("exp1", "trial1", 0)).advance().observation, 1, 0.0)
    assert hidden == {f"frame:{name}" for name in (WORLD, *robot.frames)}


def test_every_curve_is_a_field_of_the_plots():
    fields = {field.name for field in msgspec.structs.fields(ch.PlotsMessage)}
    paths = [path["value"] for name, panel in PANELS.items() if name.startswith("Plot!") for path in panel["paths"]]
    assert paths
    for path in paths:
        topic, _, name = path.partition(".")
        assert topic == ch.PLOTS.topic
        assert name in fields
