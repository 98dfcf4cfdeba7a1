"""Compile the numeric kernels, once per installation: ``python -m motm_twin.warm_up``.

Numba caches compiled kernels for later starts. The parts that a run needs are distributed to as many processes as there
are cores; other kernels are compiled at their first call, and `program_clock` does not count that time.
"""

import gc
import math
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import msgspec
import numpy as np
from numba.core import event

from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.geometry import reach_radius, room_at, rotation_error
from motm_twin.control.arm.grasp_room import height_over, over_middle
from motm_twin.control.arm.monitor import ArmMonitor
from motm_twin.control.arm.motion import palm_drop
from motm_twin.control.arm.parameters import ArmParameters
from motm_twin.control.arm.program import base_bounds, joint_bounds
from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles
from motm_twin.control.monitor import Monitor, MonitorParameters, count_unseen
from motm_twin.control.self_check import SelfCheck, SelfCheckSettings
from motm_twin.measures.agents import compile_gaps
from motm_twin.methods.registry import find_method
from motm_twin.model.arm_kernels import manipulability_gradient
from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import frozen
from motm_twin.model.known import known_world
from motm_twin.model.plant import ARM_STEP, PERIOD, Actuation, Observation, Scan
from motm_twin.model.profile import READY, Lidar, RobotProfile
from motm_twin.model.scene import Scene
from motm_twin.model.scene_file import load_scene
from motm_twin.perception.detection_check import Beliefs, DetectionSettings, Screens
from motm_twin.perception.mapper import Mapper
from motm_twin.perception.objects import ObjectTracker
from motm_twin.perception.tracks import DynamicTracker
from motm_twin.planning.in_time import fill_waits
from motm_twin.planning.rejections import mark_free
from motm_twin.planning.staa import run_search
from motm_twin.planning.warm_up import warm_up_evasion, warm_up_foresight, warm_up_placement, warm_up_search
from motm_twin.processes import at_end_of_input
from motm_twin.sim.agent_kernels import look_about
from motm_twin.sim.kernels import polygon_distance
from motm_twin.sim.plant import SimulatedPlant
from motm_twin.sim.referee_geometry import update_gaps
from motm_twin.twin import Twin

LOOK = 0.2  # [s] between two checks of the compiling processes
PERIODS = 10
WATCHED = 80  # periods with dynamic obstacles
METHODS = ("motm", "foresight", "irm")  # together they use all kernels of methods
EVERYTHING = ("arm", "perception", "placement", "agents", "foresight")  # all parts but those that others contain
DRIVES = (("exp1", 250), ("exp2", 100))  # scenes and periods for the other kernels: a carried cube, Temis


class _Compilation(event.Listener):
    """Time [s] that this process has spent compiling kernels."""

    def __init__(self) -> None:
        """Start at 0 s."""
        self.seconds, self._depth, self._began = 0.0, 0, 0.0

    def on_start(self, event: event.Event) -> None:
        """Note the start of an outermost kernel; kernels that it calls are nested."""
        if not self._depth:
            self._began = time.perf_counter()
        self._depth += 1

    def on_end(self, event: event.Event) -> None:
        """Add the time of an outermost kernel."""
        self._depth -= 1
        if not self._depth:
            self.seconds += time.perf_counter() - self._began


_compilation = _Compilation()
event.register("numba:compile", _compilation)


def program_clock() -> float:
    """`time.perf_counter` [s] without the time in which this process compiled kernels."""
    return time.perf_counter() - _compilation.seconds


def is_warm(parts: Iterable[str] = ("arm", "perception", "placement", "plant", "search")) -> bool:
    """True when the largest kernel of each part is in numba's cache; `drop_stale_kernels` deletes it after a change."""
    return all(_is_kept(PARTS[part].largest) for part in parts)


def _is_kept(kernel: Any) -> bool:
    module = Path(kernel.py_func.__code__.co_filename).stem
    return any(Path(kernel.stats.cache_path).glob(f"{module}.{kernel.__name__}-*.nbi"))


def can_keep() -> bool:
    """True when compiled kernels can be written to numba's cache."""
    return os.access(run_search.stats.cache_path, os.W_OK)


def parts_of(parameters: Mapping[str, ParameterValue], *, agents: bool) -> tuple[str, ...]:
    """Parts that a run with these parameters needs, with or without agents."""
    plant = "agents" if agents else "plant"
    search = "foresight" if parameters.get("risk_weight", 0.0) else "search"
    return ("arm", "perception", "placement", plant, search)


def _tell(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def compile_kernels(parts: Iterable[str] = EVERYTHING, tell: Callable[[str], None] = _tell) -> None:
    """Compile the parts that are not compiled yet, in processes of their own; ``tell`` gets the progress as text."""
    parts = [part for part in parts if not is_warm([part])]
    if not parts:
        return
    if not can_keep():
        tell(
            f"Compiled kernels cannot be kept in {run_search.stats.cache_path}: every start compiles for a minute. "
            "Set NUMBA_CACHE_DIR to a folder of yours."
        )
        return
    import joblib  # slow to import; it counts the cores that this process may use, in a container too

    tell("Compiling the numeric kernels, once per installation: half a minute on a quick machine, two on a slow one.")
    began, done = time.monotonic(), 0
    started = [(_start(share), share) for share in shares(parts, joblib.cpu_count())]
    try:
        running, failed = True, False
        while running:
            time.sleep(LOOK)
            running = any(process.poll() is None for process, _ in started)
            failed = any(process.returncode for process, _ in started)
            ended = sum(is_warm([part]) for part in parts) if running or failed else len(parts)
            if ended > done:
                done = ended
                tell(f"  {done} of {len(parts)} parts after {time.monotonic() - began:.0f} s")
        if failed:
            tell("Some kernels failed to compile, with the errors above: they compile again when they are called.")
    finally:
        for process, _ in started:
            process.kill()
            process.wait()


def shares(parts: Iterable[str], most: int) -> list[list[str]]:
    """The parts distributed to at most ``most`` processes, which take about equally long."""
    found: list[list[str]] = [[] for _ in range(most)]
    for part in sorted(parts, key=lambda name: -PARTS[name].seconds):
        min(found, key=lambda share: sum(PARTS[name].seconds for name in share)).append(part)
    return [sorted(share, key=list(PARTS).index) for share in found if share]


def _start(parts: Iterable[str]) -> subprocess.Popen[bytes]:
    """A process that compiles parts; it ends when its standard input ends, with this process at the latest."""
    here = str(Path(__file__).parents[1])
    environment = os.environ | {
        "PYTHONPATH": os.pathsep.join(filter(None, (here, os.environ.get("PYTHONPATH")))),
        "NUMBA_OPT": os.environ.get("NUMBA_OPT", "1"),  # saves a seventh of the time; kernels as fast, same bits
        "NUMBA_DISABLE_ERROR_MESSAGE_HIGHLIGHTING": "1",  # else it colours the text of every wrong overload
    }
    command = [sys.executable, "-m", "motm_twin.warm_up", *parts]
    return subprocess.Popen(command, stdin=subprocess.PIPE, env=environment, start_new_session=True)  # noqa: S603


def _agents() -> None:
    """Run the plant with agents that drive, and with agents that walk."""
    driving = load_scene("exp2")
    walking = tuple(msgspec.structs.replace(agent, behaviour="social_force") for agent in driving.agents)
    _plant(driving)
    _plant(msgspec.structs.replace(driving, agents=walking))


def _plant(scene: Scene | None = None) -> None:
    plant = SimulatedPlant(scene or load_scene("exp1"))
    for _ in range(PERIODS):
        plant.observe()
        plant.step(ARM_STEP)
    polygon_distance(0.0, 0.0, np.zeros((4, 2)), 0, 4)  # used to find what a released cube lies on


def _perception() -> None:
    """Run perception in a round room: the base drives slowly, two discs of different size move, later only one."""
    known = known_world(load_scene("exp2"))
    mapper, tracks, tracker = Mapper(known), DynamicTracker(known), ObjectTracker(known)
    monitor = Monitor(known.robot)
    checks = SelfCheck(known, tracker, SelfCheckSettings(), slow_age=monitor.parameters.slow_age)
    beams = known.robot.lidar.beams
    for k in range(WATCHED):
        now = _observation(known.robot.lidar, PERIOD * k, speed=0.2, ahead=0.2 * PERIOD * k)
        assert now.scan is not None
        for first, width, gap in ((beams // 3 + k, 30, 1.2), (beams // 2 - k, 12, 1.5))[: 2 if k < WATCHED // 2 else 1]:
            now.scan.ranges[first : first + width] = gap
        if k == PERIODS:
            now.scan.ranges[10:] = math.inf  # a lidar that stops seeing anything
        seen = checks.observed(now, None)
        tracker.update(seen)
        world = mapper.update(now)
        world = tracks.update(mapper.taken, world, now.pose)
        acting = Actuation(twist=frozen(np.array([0.2, 0.0])), joint_velocity=frozen(np.zeros(7)), gripper="open")
        checks.note_command(monitor.check(acting, seen, PERIOD, scan_stamp=seen.time, world=world).actuation, seen)
    Beliefs(tracker, now, known.robot, DetectionSettings(), known.bins, Screens.of(known)).screened(np.zeros(3))


def _arm() -> None:
    known = known_world(load_scene("exp1a"))
    reach_radius(0.4, 0.3, 0.7)
    room_at(np.zeros(3), np.zeros(3), 0.0, np.zeros((0, 3)))
    manipulator, monitor, arm_monitor = Manipulator(known), Monitor(known.robot), ArmMonitor(known)
    for k in range(PERIODS):
        observation = _observation(known.robot.lidar, ARM_STEP * k)
        inputs = _arm_inputs(observation)
        actuation = manipulator.step(inputs).actuation
        arm_monitor.check(
            actuation,
            observation,
            np.zeros(2),
            ARM_STEP,
            T_odom_world=inputs.T_odom_world,
            held_side=0.0,
            astray=np.zeros(7),
        )
        monitor.check(actuation, observation, ARM_STEP, scan_stamp=observation.time)
    narrow = _observation(known.robot.lidar, ARM_STEP * PERIODS, radius=0.5, speed=0.5)
    fast = Actuation(twist=frozen(np.array([0.5, 0.1])), joint_velocity=frozen(np.zeros(7)), gripper="open")
    monitor.check(fast, narrow, ARM_STEP, scan_stamp=narrow.time)  # brakes
    height_over(np.zeros((1, 3)), -np.eye(3), known.robot.gripper.max_width, inputs.goal)  # on its way down
    over_middle(0.04, 0.1)
    palm_drop(-np.eye(3), 0.1)
    _called_by_other_arms(known.robot)


def _called_by_other_arms(profile: RobotProfile) -> None:
    """Compile kernels that `Manipulator` calls in kernels only; the holistic arm and gymnasium call them in Python."""
    q, rates = READY.copy(), np.zeros(7)
    base_bounds(np.zeros(2), ARM_STEP, profile)
    joint_bounds(q, rates, ARM_STEP, ArmParameters().qp)
    manipulability_gradient(q)
    rotation_error(np.eye(3), np.eye(3))


def _observation(
    lidar: Lidar, time: float, *, radius: float = 2.0, speed: float = 0.0, ahead: float = 0.0
) -> Observation:
    """Observation of a robot that has driven ``ahead`` [m] in a round room."""
    pose = np.array([ahead, 0.0, 0.0])
    scan = Scan(
        stamp=time,
        ranges=np.full(lidar.beams, radius),
        angle_min=-0.5 * lidar.field_of_view,
        angle_step=lidar.field_of_view / max(1, lidar.beams - 1),
        origin=np.array([lidar.x, lidar.y]),
        range_min=lidar.range_min,
        range_max=lidar.range_max,
        pose=np.zeros(3),
    )
    return Observation(
        time=time, pose=pose, odometry=pose.copy(), twist=np.array([speed, 0.0]), q=READY.copy(), dq=np.zeros(7),
        gripper_width=0.08, gripper_moving=False, scan=scan, detections=(),
    )  # fmt: skip


def _arm_inputs(observation: Observation) -> ArmInputs:
    """Inputs of the arm with a cube and two obstacles within its reach."""
    goal = ArmGoal(
        kind="pick", name="cube", position=np.array([0.7, 0.3, 0.8]), yaw=0.0, side=0.04, position_sd=0.001,
        last_seen=observation.time, neighbours=np.zeros((0, 6)),
    )  # fmt: skip
    near, static = np.array([[0.8, -0.4], [0.8, 0.5]]), np.array([False, True])
    return ArmInputs(
        observation=observation,
        dt=ARM_STEP,
        goal=goal,
        base_twist=np.array([0.01, 0.01]),
        time_to_range=0.0,
        plan_times=np.array([0.3]),
        plan_poses=np.zeros((1, 5)),
        obstacles=ArmObstacles(points=near, static=static),
        T_odom_world=np.zeros(3),
    )


def _foresight() -> None:
    warm_up_search()
    warm_up_foresight()
    warm_up_evasion()
    known = known_world(load_scene("exp2"))
    now = _observation(known.robot.lidar, 0.0)
    comes = frozen(np.array([[0.7, 0.0, -1.0, 0.0, 0.25, 0.03, 1.0, 1.0]]))
    world = msgspec.structs.replace(Mapper(known).update(now), tracks=comes)
    acting = Actuation(twist=frozen(np.array([0.5, 0.0])), joint_velocity=frozen(np.zeros(7)), gripper="open")
    monitor = Monitor(known.robot, MonitorParameters(passive_safety=True))
    monitor.check(acting, now, PERIOD, scan_stamp=now.time, world=world)  # stops


class Part(NamedTuple):
    """Kernels that one process compiles."""

    compile: Callable[[], object]
    largest: Any  # its largest kernel
    seconds: float  # processor time to compile it


PARTS = {  # a process compiles its parts in this order; the search comes last, as it contains most of placement
    "placement": Part(warm_up_placement, mark_free, 10.0),
    "perception": Part(_perception, count_unseen, 20.0),
    "arm": Part(_arm, manipulability_gradient, 28.0),
    "plant": Part(_plant, update_gaps, 10.0),
    "agents": Part(_agents, look_about, 14.0),  # the plant with driving and walking agents
    "search": Part(warm_up_search, run_search, 22.0),
    "foresight": Part(_foresight, fill_waits, 28.0),  # the search with others that it gives way to
}


def main() -> None:
    """Compile everything by running the twin; with names of parts, only these parts."""
    parts = sys.argv[1:]
    if parts and all(part in PARTS for part in parts):
        at_end_of_input(lambda: os._exit(1))
        gc.freeze()
        gc.disable()  # saves a seventh of the time
        for part in parts:
            PARTS[part].compile()
            gc.collect()
        return
    compile_kernels()
    compile_gaps()
    for name in METHODS:
        for scene, periods in DRIVES:
            twin = Twin(load_scene(scene), method=find_method(name))
            for _ in range(periods):
                twin.advance()


if __name__ == "__main__":
    main()
