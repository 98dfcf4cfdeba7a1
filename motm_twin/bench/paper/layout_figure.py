"""Layout of the experiments: table, slots, drop locations, furniture, and the boxes of Experiment 1a."""

from motm_twin.bench.paper import ground
from motm_twin.bench.paper.part import Drawn
from motm_twin.bench.paper.style import BLACK, ONE_COLUMN, figure, styled
from motm_twin.model.scene_file import load_scene
from motm_twin.model.scene_load import load_document

ABOVE = (0.0, 0.08, "center", "bottom")  # of a slot: where its name is [m], and how it is aligned
RIGHT, LEFT = (0.1, 0.02, "left", "center_baseline"), (-0.1, 0.02, "right", "center_baseline")
BESIDE = {"L": RIGHT, "F1": RIGHT, "R": LEFT, "F5": LEFT}  # others are above; all but those at the back on the table


def slots() -> dict[str, tuple[float, float]]:
    """Name and place [m] of the twelve object positions, from the shipped scene."""
    nodes = load_document("exp1").root.value["slots"].value
    pairs = {name: [float(each.value) for each in node.value["at"].value] for name, node in nodes.items()}
    return {name: (x, y) for name, (x, y) in pairs.items()}


def draw() -> Drawn:
    """Everything with its dimensions, seen from above."""
    scene = load_scene("exp1a", "trial1")
    places = slots()
    boxes = [solid for solid in scene.solids if not solid.mapped]
    with styled():
        fig = figure(ONE_COLUMN, 69.0)
        axes = fig.add_subplot()
        ground.setting(axes, scene)
        ground.cubes(axes, list(places.values()), "#C00000", 10.0)
        for name, (x, y) in places.items():
            dx, dy, ha, va = BESIDE.get(name, ABOVE)
            axes.text(x + dx, y + dy, name, fontsize=7, ha=ha, va=va, zorder=9)
        for item in scene.bins:
            axes.text(*item.centre, item.name[-1], ha="center", va="center", fontsize=8, weight="bold", zorder=9)
        start = scene.start
        ground.robot(axes, start, scene.robot.footprint)  # type: ignore[arg-type]
        _labels(axes, boxes)
        _measures(axes)
        ground.metres(axes, (-1.0, 6.4), (-2.1, 3.1))
    rows = [{"what": "slot", "name": name, "x_m": x, "y_m": y} for name, (x, y) in places.items()]
    rows += [{"what": "drop", "name": each.name, "x_m": each.centre[0], "y_m": each.centre[1]} for each in scene.bins]
    rows += [
        {"what": "box of 1a", "name": box.name, "x_m": box.shape.centre[0], "y_m": box.shape.centre[1]}  # type: ignore[union-attr]
        for box in boxes
    ]
    rows.append({"what": "start", "name": "robot", "x_m": start[0], "y_m": start[1]})
    return Drawn(
        name="layout",
        title="Layout of Experiments 1, 1a and 2",
        caption=(
            "Six of the twelve object positions (squares) are filled in each trial and delivered alternately to drop "
            "locations 1 and 2. Hatched yellow: the two boxes of Experiment 1a, which the robot's map does not have. "
            "In Experiment 2 the Temis drive round the object table."
        ),
        n="no trial: drawn from the shipped scenes",
        rows=rows,
        figure=fig,
    )


def _labels(axes, boxes) -> None:
    for text, x, y in (("start", 0.0, -0.45), ("cabinet", 0.335, -1.55)):
        axes.text(x, y, text, ha="center", va="center", fontsize=7, zorder=9)
    for box in boxes:
        axes.text(*box.shape.centre, "1a", ha="center", va="center", fontsize=7, zorder=9)


def _measures(axes) -> None:
    """Lengths of the table and its distance from the start."""
    look = {"arrowstyle": "<->", "color": BLACK, "lw": 0.6, "shrinkA": 0, "shrinkB": 0}
    for a, b, text, dx, dy in (
        ((3.0, 2.55), (5.4, 2.55), "object table, 2.4 m", 0.0, 0.16),
        ((5.6, 1.37), (5.6, 2.17), "0.8 m", 0.40, 0.0),
        ((0.0, 0.75), (3.0, 0.75), "3 m", 0.0, 0.12),
        ((5.0, 0.0), (5.0, 1.37), "1.37 m", 0.47, 0.0),
    ):
        axes.annotate("", b, a, arrowprops=look, zorder=8)
        x, y = 0.5 * (a[0] + b[0]) + dx, 0.5 * (a[1] + b[1]) + dy
        axes.text(x, y, text, ha="center", va="center", fontsize=7)
    axes.plot([0, 5.2], [0, 0], ":", color="#999999", lw=0.6, zorder=0)
    axes.plot([0, 0], [0.4, 0.85], ":", color="#999999", lw=0.6, zorder=0)
