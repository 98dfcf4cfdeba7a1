"""Layers of the scene: the chips of the legend, and the nodes that each switches. Each page has its own choice."""

import math
from typing import Any

import msgspec

from motm_twin.model.scene import Scene
from motm_twin.ui import colours

PLACES, LIDAR, STAA = "places", "lidar", "staa"


class Layer(msgspec.Struct, frozen=True):
    """One chip."""

    key: str
    title: str
    hint: str  # one sentence
    swatch: str  # CSS background
    shape: str  # of the swatch: area | dots | line | dashed | frame
    nodes: tuple[str, ...]  # paths of nodes, or of their parents
    on: bool = True  # at first


LAYERS = (
    Layer("grid", "Ground", "what the robot takes for occupied: brown, and lighter the margin round it",
          colours.ground_css(), "area", ("/map",)),
    Layer(PLACES, "Where the base could stand", "each dot is a place for the next target, and its nose the heading: "
          "yellow costs little time, violet much, grey is impossible; click one to read its costs",
          colours.viridis_css(), "dots", ("/plan/candidates",)),
    Layer("there", "Way there", "way of the base to the chosen place; dashed: to the place that you clicked",
          colours.css(colours.WAY_THERE), "line", ("/plan/global_path", "/plan/inspected")),
    Layer("on", "Way on", "way from there to the next target, whose time the choice of the place counts as well; "
          "dashed: from the place that you clicked", colours.css(colours.WAY_ON), "line",
          ("/plan/next_path", "/plan/inspected_next")),
    Layer("plan", "Plan", "motion of the next seconds: silhouettes of the base, and the whole robot at its next grasp "
          "or release; light blue: the curve on which the search judges how to arrive", colours.css(colours.PLAN),
          "line", ("/plan/local_plan", "/plan/bezier", "/robot/silhouette", "/robot/arrival")),
    Layer("target", "Target", "the chosen place of the base, and where the robot believes its target to be",
          colours.css(colours.TARGET), "frame", ("/plan/goal", "/marks")),
    Layer("people", "People and Temis", "followed by the robot: number, arrow to where each will be in 1 s, ellipses "
          "of where it may be in 1 s and 2 s, and its trail; bold ring: the robot waits for it, or passes it",
          colours.css(colours.PEOPLE), "line", ("/bodies/trails", "/tracks")),
    Layer(LIDAR, "Lidar", "what the beams of the newest sweep have met", colours.css(colours.LIDAR), "dots",
          ("/lidar",), on=False),
    Layer(STAA, "STAA* path", "path of the unmodified STAA*, for comparison", colours.css(colours.STAA_PATH),
          "dashed", ("/plan/staa_path",), on=False),
)  # fmt: skip
OFF_AT_FIRST = frozenset(layer.key for layer in LAYERS if not layer.on)


def names_of(scene: Scene) -> dict[str, Any]:
    """Names of the scene and of what stands still in it, with places [m]; opening [deg] of the wrist camera."""
    bins = [(box.name, *box.centre, box.rim_z) for box in scene.bins]
    wrist = 2.0 * math.degrees(scene.robot.camera.half_cone) if scene.robot.has_arm else 0.0
    return {"scene": scene.title or scene.name, "bins": bins, "wrist": wrist}
