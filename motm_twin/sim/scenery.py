"""The world that a layout makes, as arrays for sensors, objects and agents. Derived, so it is no part of the state."""

from dataclasses import dataclass

from motm_twin.model.geometry import Array
from motm_twin.sim.layout import Furnishings, Layout
from motm_twin.sim.solids import Solids, with_obstacles


@dataclass(frozen=True, kw_only=True)
class Scenery:
    """Everything that stands and does not drive."""

    layout: Layout
    solids: Solids
    in_the_way: Solids  # what the tallest agent can run into
    tallest: float  # [m]
    lidar_segments: Array  # at the lidar's height, shape (s, 4)
    lidar_discs: Array  # shape (d, 3)


def build_scenery(furnishings: Furnishings, layout: Layout, tallest: float) -> Scenery:
    """Arrays of the world for a layout, with agents up to ``tallest`` [m]."""
    solids = with_obstacles(furnishings.fixed(layout), layout.obstacles)
    lidar_z = furnishings.scene.robot.lidar.z
    return Scenery(
        layout=layout,
        solids=solids,
        in_the_way=solids.below(tallest),
        tallest=tallest,
        lidar_segments=solids.segments_at(lidar_z),
        lidar_discs=solids.discs_at(lidar_z),
    )
