"""The published layout of Experiments 1 and 1a, written once more: the scene files must not check themselves."""

from motm_twin.model.known import KnownWorld
from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Bin, Box, Cylinder, Pick, Place, SceneObject, Solid

SLOTS = {f"F{i + 1}": (3.10 + 0.55 * i, 1.47) for i in range(5)} | {
    f"B{i + 1}": (3.10 + 0.55 * i, 2.07) for i in range(5)
}
SLOTS |= {"L": (3.10, 1.77), "R": (5.30, 1.77)}
DROPS = {"drop1": (4.25, -1.29), "drop2": (0.10, 2.13)}
TRIALS = [
    "F1 F5 B3 F2 L F3", "F5 B2 F1 R B4 B3", "B5 F4 L B1 F5 B2", "B2 R F5 B3 B4 F3", "F4 R F3 F5 F2 B3",
    "L B1 F5 R F1 B4", "B4 B1 R B5 F1 F3", "F5 L F1 R F2 F3", "F5 B3 F3 B2 F1 F4", "B3 B1 F4 B5 F3 B2",
]  # fmt: skip


def solid(name: str, shape, height: float) -> Solid:
    return Solid(name=name, shape=shape, z_min=0.0, z_max=height, mapped=True)


FURNITURE = (
    solid("table", Box(centre=(4.2, 1.77), size=(2.4, 0.8)), 0.78),
    solid("desk", Box(centre=(-0.095, 2.22), size=(0.77, 1.18)), 0.6),
    solid("round", Cylinder(centre=(4.27, -1.44), radius=0.365), 0.6),
    solid("cabinet", Box(centre=(0.335, -1.5525), size=(1.87, 0.295)), 0.69),
)
BOXES_1A = tuple(solid(f"box{c}", Box(centre=c, size=(0.5, 0.5)), 0.6) for c in ((2.7, 1.7), (3.9, 0.96)))


def world(slots: str, boxes: bool = False) -> KnownWorld:
    """One trial: the cubes in pick order, alternately to drop 1 and drop 2."""
    names = slots.split()
    tasks = [task for i, name in enumerate(names) for task in (Pick(object=name), Place(bin=f"drop{i % 2 + 1}"))]
    return KnownWorld(
        robot=RobotProfile(),
        start=(0.0, 0.0, 0.0),
        solids=FURNITURE + (BOXES_1A if boxes else ()),
        objects=tuple(SceneObject(name=name, position=(*SLOTS[name], 0.8)) for name in names),
        object_sd=0.03,
        bins=tuple(Bin(name=name, centre=centre) for name, centre in DROPS.items()),
        tasks=tuple(tasks),
        bounds=(-2.0, -3.0, 7.0, 4.5),
    )
