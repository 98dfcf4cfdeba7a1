"""Plants under contact dynamics for the tests: a hand over a cube, an empty hall."""

import msgspec
from sim_hands import DOWN, over_a_cube

from motm_twin.model.scene import Physics
from motm_twin.physics.mechanics import Dynamics
from motm_twin.plants import make_plant
from motm_twin.sim.plant import SimulatedPlant


def physical(scene, **numbers):
    return make_plant(msgspec.structs.replace(scene, physics=Physics(**numbers)))


def hand_over_a_cube(offset=(0.0, 0.0, 0.0), turn=0.0, **numbers):
    scene = msgspec.structs.replace(over_a_cube(offset=offset, turn=turn).scene, physics=Physics(**numbers))
    return SimulatedPlant(scene, arm_start=DOWN, mechanics=Dynamics)


def in_hand(plant):
    """Place of the cube seen from the tool centre point [m]."""
    state = plant.snapshot()
    return state.objects[0].position - state.tcp
