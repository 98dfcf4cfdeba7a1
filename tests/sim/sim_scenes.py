"""Scenes for the tests of the simulation, built directly, and the tracks of their agents."""

from itertools import combinations

import msgspec
import numpy as np

from motm_twin.model.profile import RobotProfile
from motm_twin.model.scene import Agent, Bin, Box, Cylinder, Noise, Pick, Place, Scene, SceneObject, Solid

QUIET = Noise(
    localisation_position_sd=0.0,
    localisation_heading_sd=0.0,
    lidar_range_sd=0.0,
    slot_error_until_seen=0.0,
    camera_position_sd_at_1m=0.0,
    camera_position_sd_at_01m=0.0,
)


def box(name, centre, size, height, z_min=0.0, mapped=True, yaw=0.0):
    """A box on the floor."""
    return Solid(name=name, shape=Box(centre=centre, size=size, yaw=yaw), z_min=z_min, z_max=height, mapped=mapped)


def table():
    """The object table of Experiment 1: slab, posts, feet."""
    slab = Solid(name="slab", shape=Box(centre=(4.2, 1.77), size=(2.4, 0.8)), z_min=0.75, z_max=0.78, mapped=True)
    legs = []
    for i, x in enumerate((3.6, 4.8)):
        post = Cylinder(centre=(x, 1.77), radius=0.05)
        foot = Cylinder(centre=(x, 1.77), radius=0.30)
        legs.append(Solid(name=f"post{i}", shape=post, z_min=0.0, z_max=0.75, mapped=True))
        legs.append(Solid(name=f"foot{i}", shape=foot, z_min=0.0, z_max=0.08, mapped=True))
    return (slab, *legs)


def furniture():
    """All furniture of Experiment 1."""
    return (
        *table(),
        box("desk", (-0.095, 2.22), (0.77, 1.18), 0.6),
        Solid(name="round", shape=Cylinder(centre=(4.27, -1.44), radius=0.365), z_min=0.0, z_max=0.6, mapped=True),
        box("cabinet", (0.335, -1.5525), (1.87, 0.295), 0.69),
    )


def scene(**changes):
    """An empty hall, or whatever the changes make of it."""
    plain = Scene(
        name="test",
        variant="",
        seed=1,
        title="test",
        robot=RobotProfile(),
        start=(0.0, 0.0, 0.0),
        solids=(),
        objects=(),
        bins=(),
        agents=(),
        tasks=(),
        noise=QUIET,
        bounds=(-3.0, -4.0, 7.0, 5.0),
    )
    return msgspec.structs.replace(plain, **changes)


def experiment(**changes):
    """Experiment 1 with two cubes and, on demand, more."""
    cubes = (
        SceneObject(name="cube1", position=(3.1, 1.47, 0.80)),
        SceneObject(name="cube2", position=(4.2, 1.47, 0.80)),
    )
    defaults = {
        "solids": furniture(),
        "objects": cubes,
        "bins": (Bin(name="drop1", centre=(4.25, -1.29)), Bin(name="drop2", centre=(0.1, 2.13))),
        "tasks": (Pick(object="cube1"), Place(bin="drop1"), Pick(object="cube2"), Place(bin="drop2")),
        "noise": Noise(),
    }
    return scene(**{**defaults, **changes})


def temis(count=4):
    """Temis driving round the table of Experiment 1, in both directions."""
    ring = ((2.2, 0.6), (6.2, 0.6), (6.2, 2.95), (2.2, 2.95))
    starts = ((2.4, 0.6), (6.2, 0.8), (6.0, 2.95), (2.2, 2.7))
    agents = []
    for i in range(count):
        order = (ring[i:] + ring[:i])[1:] + ring[i : i + 1] if i % 2 == 0 else ring[i::-1] + ring[:i:-1]
        agents.append(Agent(name=f"temi{i}", start=(*starts[i], 0.0), waypoints=order))
    return tuple(agents)


def track_of(plant, seconds, step=0.05):
    """Positions of all agents every ``step`` [s], shape (steps, n, 2)."""
    track = []
    for _ in range(round(seconds / step)):
        plant.step(step)
        track.append([agent.position[:2] for agent in plant.truth().agents])
    return np.array(track)


def least_gap(track, radius):
    pairs = combinations(range(track.shape[1]), 2)
    return min(np.hypot(*(track[:, i] - track[:, j]).T).min() for i, j in pairs) - 2.0 * radius
