"""The control period: observe, map, place the base, plan, reach, check, command. Its record is the Tick."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import msgspec
import numpy as np

from motm_twin.control import by_hand
from motm_twin.control.arm.controller import Manipulator
from motm_twin.control.arm.monitor import ArmMonitor
from motm_twin.control.arm.program import AT_SUPPORT
from motm_twin.control.arm.types import ArmGoal, ArmInputs, ArmObstacles, ArmStep
from motm_twin.control.monitor import Monitor
from motm_twin.control.parameters import Parameters
from motm_twin.control.predictor import dwell_to_plan, followed
from motm_twin.control.progress import Progress, ProgressState, base_has_to_move
from motm_twin.control.reasons import why_standing
from motm_twin.control.response import Response
from motm_twin.control.self_check import SelfCheck
from motm_twin.control.sequence import TaskSequence
from motm_twin.control.targets import Targets, world_in_odometry
from motm_twin.control.tick import Event, Stages, Tick
from motm_twin.model.edits import Edit, TaskEdit
from motm_twin.model.geometry import Array, from_frame, to_frame, wrap_angle
from motm_twin.model.known import KnownWorld
from motm_twin.model.motion import command_pose
from motm_twin.model.plant import ARM_STEPS, PERIOD, Observation, Plant, Truth
from motm_twin.model.profile import RobotProfile
from motm_twin.model.reason import Reason
from motm_twin.model.state import HasState, Stateful
from motm_twin.perception.mapper import Mapper
from motm_twin.perception.objects import ObjectTracker
from motm_twin.perception.tracks import DynamicTracker
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.planner import BasePlanner
from motm_twin.planning.rejections import Rejection
from motm_twin.planning.types import BasePlan, BaseProblem, Mode, Placement, PlanStatus, SearchBudget, Target


class Settings(msgspec.Struct, frozen=True, kw_only=True):
    """Budget of the search, and the parameters of all parts."""

    budget: SearchBudget = SearchBudget()
    parameters: Parameters = Parameters()  # planner and arm have their own


@dataclass
class LoopState:
    """Memory of the loop itself between periods."""

    index: int = 0
    dwell: float | None = None  # [s] that the active job still needs in reach, as the arm reported last
    engaged: bool = False
    waiting: Reason | None = None  # why the arm waits, as it reported last
    progress: ProgressState = field(default_factory=ProgressState)
    stuck_at: tuple[tuple[int, Array], ...] = ()  # index of a task, and a base pose from which the arm failed to do it


class ControlLoop(Stateful[LoopState]):
    """Runs a Plant through its tasks, period by period; every decision is in the Tick it returns."""

    def __init__(
        self,
        known: KnownWorld,
        plant: Plant,
        planner: BasePlanner,
        manipulator: Manipulator,
        *,
        settings: Settings | None = None,
        profile: RobotProfile | None = None,
        truth: Callable[[], Truth | None] = lambda: None,
        clock: Callable[[], float] = lambda: 0.0,
    ) -> None:
        """``profile``: the robot's profile before the lag in ``known`` was corrected by the estimated one."""
        self.known = known
        self.plant = plant
        self.settings = settings or Settings()
        p = self.settings.parameters
        self.mapper = Mapper(known, p.map)
        self.tracks = DynamicTracker(known, p.tracks)
        self.tracker = ObjectTracker(known, p.objects)
        self.self_check = SelfCheck(known, self.tracker, p.self_check, slow_age=p.monitor.slow_age)
        self.response = Response(profile or known.robot, p.response)
        self.targets = Targets(known, self.tracker, p.planning.reach, p.arm)
        self.sequence = TaskSequence(known, p.sequence)
        self.planner = planner
        self.manipulator = manipulator
        self.monitor = Monitor(known.robot, p.monitor)
        self.arm_monitor = ArmMonitor(known, p.arm_monitor)
        self.by_hand = by_hand.ByHand(known.robot, PERIOD, p.planning.staa.margin)
        self._truth = truth
        self._clock = clock
        self._state = LoopState()

    def parts(self) -> dict[str, HasState]:
        """Everything of the loop that has state."""
        return {
            "loop": self,
            "mapper": self.mapper,
            "tracks": self.tracks,
            "tracker": self.tracker,
            "self_check": self.self_check,
            "response": self.response,
            "sequence": self.sequence,
            "planner": self.planner,
            "manipulator": self.manipulator,
            "monitor": self.monitor,
            "by_hand": self.by_hand,
        }

    def period(
        self, edits: tuple[Edit, ...] = (), budget: SearchBudget | None = None, *, restarted: bool = False
    ) -> Tick:
        """One period of 50 ms. `budget` replaces the setting (a rerun gives a recorded expansion count).

        `restarted`: the robot was not commanded for a while, so the base may not move as commanded last.
        """
        stages = Stages(self._clock)
        with stages.measure("observe"):
            reported = self.plant.observe()
            observation = self._observed(reported)
        if restarted:
            self.monitor.begin_from(observation.twist)
            self.self_check.begin_from(observation.twist)
        with stages.measure("map"):
            world = self.mapper.update(observation, self._whereabouts(observation) if self.mapper.large else ())
            world = self.tracks.update(self.mapper.taken, world, observation.pose)
            self.tracker.update(observation, self.sequence.held)
        with stages.measure("place"):
            problem = self._problem(observation, world)
            placement = self.planner.place(problem)
        with stages.measure("plan"):
            plan = self.by_hand.plan(problem) or self.planner.drive(problem, placement, budget or self.settings.budget)
        events = self._watch_task(observation, problem.target, placement, plan)
        steps, samples, reports, arm_events, reason = self._arm_steps(observation, reported, world, plan, stages)
        events += arm_events + self.self_check.events(observation.time)
        truth = self._truth()
        state = self._state
        state.waiting = steps[-1].why
        tick = Tick(
            index=state.index,
            time=observation.time,
            observation=observation,
            map=world,
            tasks=self.sequence.report(),
            task_index=self.sequence.index,
            beliefs=self.targets.beliefs(observation, world_in_odometry(observation), self.sequence.held),
            placement=placement,
            plan=plan,
            arm=tuple(steps),
            why=self._stopped_by(reason) or self._why(plan, steps[-1], observation),
            events=tuple(events),
            edits=edits,
            stage_ms=stages.milliseconds(),
            truth=truth,
            done=self.sequence.done,
            success=self.sequence.done and not self.sequence.failures,
            samples=samples,
            reported=reports,
            restarted=restarted,
        )
        state.index += 1
        return tick

    def believed(self) -> Observation:
        """The observation that the next period will believe; no state is changed."""
        every = self.parts()
        parts = [every[name] for name in ("self_check", "response", "tracker")]
        before = [part.snapshot() for part in parts]
        observation = self._observed(self.plant.observe())
        for part, state in zip(parts, before, strict=True):
            part.restore(state)
        return observation

    def _observed(self, reported: Observation) -> Observation:
        return self.self_check.observed(self.response.observed(reported), self.sequence.held)

    @property
    def index(self) -> int:
        """Number of the next period."""
        return self._state.index

    @property
    def _progress(self) -> Progress:
        return Progress(self._state.progress, PERIOD, self.settings.parameters.progress)

    @property
    def engaged(self) -> bool:
        """True while the arm is at work on the active task (final approach to lift, release)."""
        return self._state.engaged

    def retune(self, numbers: Parameters) -> None:
        """Give new parameters to the parts that keep theirs; planner and manipulator are replaced by others."""
        self.sequence.limits, self.by_hand.margin = numbers.sequence, numbers.planning.staa.margin
        if numbers.monitor != self.monitor.parameters:
            before, self.monitor = self.monitor, Monitor(self.known.robot, numbers.monitor)
            self.monitor.restore(before.snapshot())

    def edit_tasks(self, edit: TaskEdit) -> None:
        """Change the task list; raises ValueError when the edit is not possible."""
        if self.sequence.edit(edit, self.known, engaged=self._state.engaged):
            self._begin_another()
            self._state.progress.restart(-1, math.inf)  # the next period starts the clock
        self.planner.retasked(edit)
        self.manipulator.retasked(edit)

    def _begin_another(self) -> None:
        """Forget the state of the last task: another one is active now, perhaps with the same index."""
        self._state.dwell, self._state.engaged, self._state.stuck_at = None, False, ()

    def _problem(self, observation: Observation, world: WorldMap) -> BaseProblem:
        """The base's problem, at the pose to which the commands already given will take it."""
        lag = self.known.robot.base.velocity_lag
        dwell = dwell_to_plan(self._state.dwell, self._state.engaged, lag)
        return BaseProblem(
            time=observation.time,
            world=world,
            pose=command_pose(observation.pose, observation.twist, lag),
            twist=self.monitor.twist,
            target=self.targets.base_target(self.sequence.active, observation, dwell),
            next_target=self.targets.base_target(self.sequence.following, observation, None),
            engaged=self._state.engaged,
            period=PERIOD,
            recovery=self._progress.recovery(observation.time),
            stuck_at=np.array([pose for of, pose in self._state.stuck_at if of == self.sequence.index]).reshape(-1, 3),
        )

    def _watch_task(
        self, observation: Observation, target: Target | None, placement: Placement, plan: BasePlan
    ) -> list[Event]:
        """Events of the active task: arrived, in reach too long, blocked, outside the map, base without progress."""
        waits = placement.mode == Mode.CLOSEST and plan.status == PlanStatus.IDLE
        blocked = "" if not waits else "no way to it" if Rejection.NO_PATH in placement.rejected else "not free"
        outside = (waits or placement.chosen < 0) and self._outside(target)
        busy, in_reach = self.manipulator.busy, plan.time_to_range == 0.0
        events = self.sequence.watch(
            observation.time, in_reach, observation.pose,
            blocked=blocked, outside=outside, busy=busy, why=self._state.waiting,
        )  # fmt: skip
        return [*events, *self._watch_progress(observation, placement, plan, busy=busy)]

    def _watch_progress(
        self, observation: Observation, placement: Placement, plan: BasePlan, *, busy: bool
    ) -> tuple[Event, ...]:
        """Keep the progress clock; returns events of a task on which the base has long made no progress."""
        counts = base_has_to_move(self.sequence, plan, busy=busy, by_hand=plan.status == PlanStatus.BY_HAND)
        time, index = observation.time, self.sequence.index
        stalled = self._progress.watch(time, index, observation.pose, placement, plan, counts=counts)
        events = self.sequence.hold_up(time, stalled, plan.why or placement.why, observation.pose)
        if events:
            self._state.progress.restart(self.sequence.index, time)
            self._begin_another()
        return events

    def _whereabouts(self, observation: Observation) -> list[Array]:
        """Positions of the active target and the next one, shape (2,) [m] each."""
        tasks = (self.sequence.active, self.sequence.following)
        found = (self.targets.base_target(task, observation, None) for task in tasks)
        return [np.asarray(target.position[:2]) for target in found if target is not None]

    def _stopped_by(self, reason: Reason | None) -> Reason | None:
        """Reason of the monitors to slow or stop, else a refused scan or the worst finding; None for none of these."""
        return reason or self.mapper.refusal or self.self_check.trust().reason

    def _why(self, plan: BasePlan, step: ArmStep, observation: Observation) -> Reason | None:
        """Reason why the base stands, or is not driven by its plan; None when it is."""
        return (
            plan.why
            if plan.status in (PlanStatus.BY_HAND, PlanStatus.ESCAPING)
            else why_standing(self.sequence, plan, step, observation)
        )

    def _outside(self, target: Target | None) -> bool:
        """Test that the target is outside the map."""
        if target is None:
            return False
        (x, y), (x_min, y_min, x_max, y_max) = target.position[:2], self.known.bounds
        return not (x_min <= x <= x_max and y_min <= y <= y_max)

    def _arm_steps(
        self, observation: Observation, reported: Observation, world: WorldMap, plan: BasePlan, stages: Stages
    ) -> tuple[list[ArmStep], tuple[Observation, ...], tuple[Observation, ...], list[Event], Reason | None]:
        """Arm steps of this period, the observation and the report of each, events, reason; each moves the plant on."""
        dt = PERIOD / ARM_STEPS
        T_odom_world = world_in_odometry(observation)
        plan_poses = _to_odometry(T_odom_world, plan.local_poses)
        obstacles = ArmObstacles.of(world, T_odom_world, self.manipulator.parameters.avoidance.prediction)
        start = self.monitor.twist
        steps: list[ArmStep] = []
        samples: list[Observation] = []
        reports: list[Observation] = []
        events: list[Event] = []
        reason: Reason | None = None
        for k in range(ARM_STEPS):
            if k:
                with stages.measure("observe"):
                    reported = self.plant.observe()
                    observation = self._observed(reported)
                with stages.measure("map"):
                    self.tracker.update(observation, self.sequence.held)
            with stages.measure("arm"):
                desired = start + plan.acceleration * (k + 1) * dt
                inputs = self._arm_inputs(observation, T_odom_world, plan, plan_poses, obstacles, desired, k * dt)
                step = self.manipulator.step(inputs)
            with stages.measure("monitor"):
                trust = self.self_check.trust()
                kept = self.arm_monitor.check(
                    step.actuation, observation, self.monitor.twist, dt, T_odom_world=T_odom_world,
                    astray=self.self_check.astray,
                    held_side=inputs.goal.side if step.holding and step.phase not in AT_SUPPORT else 0.0,
                )  # fmt: skip
                verdict = self.monitor.check(
                    kept.actuation, observation, dt, scan_stamp=self.mapper.scan_stamp, world=world, trust=trust
                )
            steps.append(step)
            samples.append(observation)
            reports.append(reported)
            reason = verdict.why or kept.why or reason
            self._state.dwell, self._state.engaged = step.dwell, step.engaged
            if step.outcome:
                events += self._ended(step, inputs.goal, observation, T_odom_world)
            self.self_check.note_command(verdict.actuation, observation)
            self.response.note_command(verdict.actuation, reported)
            self.plant.command(verdict.actuation)
            self.plant.step(dt)
        return steps, tuple(samples), tuple(reports), events, reason

    def _ended(self, step: ArmStep, goal: ArmGoal, observation: Observation, T_odom_world: Array) -> tuple[Event, ...]:
        """Apply the outcome of an arm step to beliefs and tasks; returns its events."""
        held, index = self.sequence.held, self.sequence.index
        if step.outcome == "missed":
            self.self_check.missed(goal.name, goal.position, observation)
        elif step.outcome == "stuck":
            self._state.stuck_at += ((index, observation.pose.copy()),)
        elif step.outcome == "lost" and held:
            self._lose(held, step.reference, observation, T_odom_world)
        elif step.outcome == "placed" and held:
            self._let_go(held, goal, observation)
        events = self.sequence.apply(step.outcome, observation.time, step.why)
        if self.sequence.index < index:  # back to a pick: tasks may have other indices now
            self._begin_another()
        elif self.sequence.index > index:
            self._state.dwell, self._state.engaged = None, False
        return tuple(events)

    def _let_go(self, name: str, goal: ArmGoal, observation: Observation) -> None:
        """Move the belief about a placed object to the floor of its bin."""
        low = self.targets.bins[goal.name].floor_z + 0.5 * self.targets.objects[name].side
        place = np.array([goal.position[0], goal.position[1], low])
        self.tracker.move_belief(name, place, observation, self.settings.parameters.objects.bin_sd)

    def _lose(self, name: str, hand: Array, observation: Observation, T_odom_world: Array) -> None:
        """Move the belief about a lost object to the furniture below the hand, or else back to its pick place."""
        top = self.targets.top_below(to_frame(T_odom_world, hand))
        place = self.tracker.belief(name, observation)[0]
        if top is not None:
            place = np.array([hand[0], hand[1], top + 0.5 * self.targets.objects[name].side])
        self.tracker.move_belief(name, place, observation, 2.0 * self.settings.parameters.objects.bin_sd)

    def _arm_inputs(
        self, observation: Observation, T_odom_world: Array, plan: BasePlan, plan_poses: Array,
        obstacles: ArmObstacles, base_twist: Array, passed: float,
    ) -> ArmInputs:  # fmt: skip
        """Inputs of an arm step that begins ``passed`` [s] after the plan was made."""
        time_to_range, plan_times = followed(plan, self.known.robot.base.velocity_lag, passed)
        elsewhere = plan.status == PlanStatus.BY_HAND and not self._state.engaged
        task = None if elsewhere else self.sequence.active  # a base driven by hand: the arm folds away
        goal = self.targets.arm_goal(task, self.sequence.held, observation, T_odom_world)
        return ArmInputs(
            observation=observation,
            dt=PERIOD / ARM_STEPS,
            goal=goal,
            base_twist=base_twist,
            time_to_range=time_to_range,
            plan_times=plan_times,
            plan_poses=plan_poses,
            obstacles=obstacles,
            T_odom_world=T_odom_world,
            stuck_joint=self.self_check.stuck_joint,
            slips_since=self.self_check.slips_since,
        )


def _to_odometry(T_odom_world: Array, poses: Array) -> Array:
    """Local plan nodes (x, y, heading, v, w), world frame, in the odometry frame; shape (j, 5)."""
    moved = np.array(poses, dtype=float)
    if len(moved):
        moved[:, :2] = from_frame(T_odom_world, moved[:, :2])
        moved[:, 2] = [wrap_angle(heading + T_odom_world[2]) for heading in moved[:, 2]]
    return moved
