"""Drawing on the floor plan of a scene, and the first period of a scene to draw."""

import functools
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import Normal, Stroke

from motm_twin.methods.registry import MOTM
from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.known import KnownWorld, known_world
from motm_twin.model.profile import Footprint
from motm_twin.model.scene import Bin, Cylinder, Scene, Solid
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.distance import proximity_cost
from motm_twin.perception.footprints import outline
from motm_twin.perception.world_map import WorldMap
from motm_twin.studies.paper.part import BLACK, BLUE, GREY, OCCUPANCY
from motm_twin.twin import Twin

INFLATION, BLUR = 0.6, 0.2  # [m] of STAA*'s grid
CLEAR = 0.7  # [m] above the floor: what begins higher is a table top, drawn as a surface


def metres(axes: Axes, x: tuple[float, float], y: tuple[float, float]) -> None:
    """Equal axes in metres over a region."""
    axes.set_aspect("equal")
    axes.set_xlim(*x)
    axes.set_ylim(*y)
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")


def occupancy(axes: Axes, world: WorldMap) -> Any:
    """The proximity grid, inflated as widely as STAA* does, from free (light green) to occupied (dark red)."""
    cost = proximity_cost(world.distance, INFLATION, round(0.5 * BLUR / world.resolution))
    rows, columns = cost.shape
    x, y = (float(value) for value in world.origin)
    extent = (x, x + columns * world.resolution, y, y + rows * world.resolution)
    return axes.imshow(cost, cmap=OCCUPANCY, vmin=0.0, vmax=1.0, origin="lower", extent=extent, interpolation="nearest")


def furniture(axes: Axes, solids: Iterable[Solid], *, face: str = "#E8E2D6", hatch: str | None = None) -> None:
    """Outlines of furniture, low things first."""
    look: dict[str, Any] = {"facecolor": face, "edgecolor": GREY, "linewidth": 0.6, "hatch": hatch, "zorder": 1}
    for solid in sorted(solids, key=lambda each: each.z_max):
        if isinstance(solid.shape, Cylinder):
            axes.add_patch(Circle(solid.shape.centre, solid.shape.radius, **look))
        else:
            axes.add_patch(Polygon(outline(solid.shape), closed=True, **look))


def bins(axes: Axes, scene_bins: Iterable[Bin]) -> None:
    """Bins as open squares."""
    for item in scene_bins:
        corner = (item.centre[0] - 0.5 * item.side, item.centre[1] - 0.5 * item.side)
        axes.add_patch(Rectangle(corner, item.side, item.side, facecolor="white", edgecolor=BLACK, lw=0.8, zorder=2))


def cubes(axes: Axes, points: Sequence[Any], colour: str, size: float = 9.0) -> None:
    """Cubes as small squares, larger than they are."""
    if len(points):
        at = np.asarray(points, dtype=float)
        axes.scatter(at[:, 0], at[:, 1], s=size, marker="s", c=colour, edgecolors=BLACK, linewidths=0.4, zorder=4)


def robot(
    axes: Axes, pose: Array, footprint: Footprint, *, colour: str = BLUE, alpha: float = 1.0, fill: bool = True
) -> None:
    """The base as its rectangle, with an arrow forwards."""
    b, w = 0.5 * footprint.length, 0.5 * footprint.width
    corners = np.array([[b, w], [-b, w], [-b, -w], [b, -w]]) + np.array([footprint.offset_x, 0.0])
    tip = np.array([[0.8 * b, 0.0], [0.2 * b, 0.5 * w], [0.2 * b, -0.5 * w]])
    body, arrow = (from_frame(pose, points) for points in (corners, tip))
    face = colour if fill else "none"
    axes.add_patch(Polygon(body, closed=True, facecolor=face, edgecolor=BLACK, lw=0.6, alpha=alpha, zorder=5))
    axes.add_patch(Polygon(arrow, closed=True, facecolor="white", edgecolor=BLACK, lw=0.5, alpha=alpha, zorder=6))


def temi(axes: Axes, x: float, y: float, radius: float, *, colour: str, alpha: float = 1.0) -> None:
    """A Temi as its disc."""
    axes.add_patch(Circle((x, y), radius, facecolor=colour, edgecolor=BLACK, lw=0.6, alpha=alpha, zorder=5))


def path(
    axes: Axes, points: Array, colour: str, style: Any = "-", *, width: float = 1.8, casing: str = "white", **more: Any
) -> None:
    """A path with a casing, so that it is seen on any ground."""
    if len(points) < 2:
        return
    effects = [Stroke(linewidth=width + 1.6, foreground=casing), Normal()]
    axes.plot(
        points[:, 0], points[:, 1], linestyle=style, color=colour, lw=width, zorder=7, path_effects=effects,
        solid_capstyle="round", **more,
    )  # fmt: skip


def setting(axes: Axes, scene: Scene) -> None:
    """Mapped furniture and bins of a scene; table posts below a top are not drawn."""
    furniture(axes, [solid for solid in scene.solids if solid.mapped and not _below_top(solid, scene)])
    furniture(axes, [solid for solid in scene.solids if not solid.mapped], face="#FFE08A", hatch="//")
    bins(axes, scene.bins)


def _below_top(solid: Solid, scene: Scene) -> bool:
    """Posts and feet under a table of the same group."""
    tops = [other for other in scene.solids if other.group == solid.group and other.z_min > CLEAR]
    return bool(solid.group and tops and solid not in tops)


class FirstPeriod(NamedTuple):
    """A scene, what the robot knows of it, and its map in the first period."""

    scene: Scene
    known: KnownWorld
    world: WorldMap


@functools.cache
def first_period(scene: str, variant: str) -> FirstPeriod:
    """The first period of a scene."""
    loaded = load_scene(scene, variant)
    return FirstPeriod(loaded, known_world(loaded), Twin(loaded, method=MOTM).advance().map)
