"""A room for tests of edits: a table with cubes, a stand with a bin and a cube in it, a loose crate, a Temi."""

from sim_scenes import box, scene

from motm_twin.model.scene import Agent, Bin, Box, Cylinder, Pick, Place, SceneObject, Solid

TABLE_TOP = 0.75  # [m]


def table():
    """A slab on one post: one piece of furniture, called table."""
    slab = Solid(
        name="slab", shape=Box(centre=(3.0, 2.0), size=(1.6, 0.8)), z_min=0.72, z_max=0.75, mapped=True, group="table"
    )
    post = Solid(
        name="post", shape=Cylinder(centre=(3.0, 2.0), radius=0.05), z_min=0.0, z_max=0.72, mapped=True, group="table"
    )
    return slab, post


def room(**changes):
    """The whole room; the robot stands at the origin and looks along x."""
    cubes = (
        SceneObject(name="cube1", position=(2.5, 1.8, 0.77), yaw=0.3),
        SceneObject(name="cube2", position=(3.5, 2.2, 0.77)),
    )
    defaults = {
        "solids": (
            *table(),
            box("stand", (3.0, -2.0), (0.8, 0.8), 0.6),
            box("cabinet", (-2.0, 2.0), (0.4, 0.4), 0.8),
            box("crate", (-2.0, -2.0), (0.5, 0.5), 0.6, mapped=False),
        ),
        "objects": cubes,
        "bins": (Bin(name="bin", centre=(3.0, -2.0)),),
        "agents": (Agent(name="temi", start=(0.0, 3.5, 0.0), waypoints=((3.0, 3.5), (0.0, 3.5))),),
        "tasks": (Pick(object="cube1"), Place(bin="bin")),
    }
    return scene(**{**defaults, **changes})


def body(plant, name):
    """What is true of an object, agent, obstacle or moved piece."""
    truth = plant.truth()
    groups = (truth.objects, truth.agents, truth.obstacles, truth.furniture)
    return next(item for group in groups for item in group if item.name == name)
