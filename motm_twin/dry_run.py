"""Dry run of a task: the paper's method in the world as known beforehand, without noise.

The world is the input of a planner of whole trajectories: mapped furniture, believed positions of the cubes, perfect
sensors and actuators, no agents. The run is deterministic, and cached.
"""

from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import numpy as np

from motm_twin.control.method import Rehearsed, Timed
from motm_twin.control.parameters import Parameters
from motm_twin.control.tick import Tick
from motm_twin.model.geometry import frozen
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import command_pose
from motm_twin.model.plant import ARM_STEPS, PERIOD, Actuation, Observation, Plant
from motm_twin.model.scene import Noise, Scene
from motm_twin.planning.types import BoolArray, Mode, PlanStatus

LONGEST = round(900.0 / PERIOD)  # periods
_NOISELESS = Noise(
    localisation_position_sd=0.0,
    localisation_heading_sd=0.0,
    lidar_range_sd=0.0,
    slot_error_until_seen=0.0,
    camera_position_sd_at_1m=0.0,
    camera_position_sd_at_01m=0.0,
)


def nominal_scene(known: KnownWorld) -> Scene:
    """The scene that results when the robot's knowledge is taken as the truth."""
    return Scene(
        name="rehearsal", variant="", seed=0, title="What is known beforehand", robot=known.robot, start=known.start,
        solids=known.solids, objects=known.objects, bins=known.bins, agents=(), tasks=known.tasks, noise=_NOISELESS,
        bounds=known.bounds,
    )  # fmt: skip


@lru_cache(maxsize=4)
def dry_run(
    make_twin: Callable[..., Any],
    known: KnownWorld,
    parameters: Parameters,
    edits: Timed = (),
) -> Rehearsed:
    """Run the tasks to their end, with edits of the task list at their periods; raises ValueError for a refused edit.

    ``make_twin``: the class `Twin`, passed in because it makes dry runs itself.
    """
    from motm_twin.methods.registry import MOTM  # imported late: its methods use dry runs

    twin = make_twin(nominal_scene(known), method=MOTM, numbers=parameters)
    twin.loop.plant = log = _Log(twin.plant)
    ticks: list[Tick] = []
    while len(ticks) < LONGEST and not (twin.done and all(at < len(ticks) for at, _ in edits)):
        for at, edit in edits:
            if at == len(ticks):
                twin.post(edit)
        ticks.append(twin.advance())
    return _kept(known, ticks, log, twin.loop.sequence.failures)


class _Log:
    """A plant with a log of its commands."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.commands: list[Actuation] = []

    def observe(self) -> Observation:
        return self._plant.observe()

    def command(self, actuation: Actuation) -> None:
        self.commands.append(actuation)
        self._plant.command(actuation)

    def step(self, dt: float) -> None:
        self._plant.step(dt)


def _kept(known: KnownWorld, ticks: list[Tick], log: _Log, failures: tuple[str, ...]) -> Rehearsed:
    commands, lag = log.commands, known.robot.base.velocity_lag
    assert len(commands) == ARM_STEPS * len(ticks)
    twists = np.array([actuation.twist for actuation in commands[ARM_STEPS - 1 :: ARM_STEPS]]).reshape(-1, 2)
    seen = [tick.observation for tick in ticks]
    poses = np.array([command_pose(one.pose, one.twist, lag) for one in seen]).reshape(-1, 3)
    steps = [step for tick in ticks for step in tick.arm]
    samples = [sample for tick in ticks for sample in tick.samples]
    return Rehearsed(
        poses=frozen(poses),
        twists=frozen(twists),
        in_range=_flags(tick.plan.time_to_range == 0.0 for tick in ticks),
        blocked=_flags(tick.placement.mode == Mode.CLOSEST and tick.plan.status == PlanStatus.IDLE for tick in ticks),
        q=frozen(np.array([sample.q for sample in samples])),
        rates=frozen(np.array([actuation.joint_velocity for actuation in commands])),
        closed=_flags(actuation.gripper == "close" for actuation in commands),
        phases=tuple(step.phase for step in steps),
        outcomes=tuple((n, step.outcome) for n, step in enumerate(steps) if step.outcome),
        failures=failures,
    )


def _flags(values: Iterable[bool]) -> BoolArray:
    flags = np.fromiter(values, dtype=np.bool_)
    flags.setflags(write=False)
    return flags
