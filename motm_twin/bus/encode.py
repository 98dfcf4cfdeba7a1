"""From the Tick of the control loop to the messages on the bus."""

from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np

from motm_twin.bus.messages import (
    GRID_ENCODING,
    GRID_VERSION,
    TICK_VERSION,
    ArmMessage,
    BeliefMessage,
    BodyMessage,
    ContactMessage,
    CutInMessage,
    EventMessage,
    GridInfo,
    PlacementMessage,
    PlanMessage,
    RobotMessage,
    ScoreMessage,
    TaskMessage,
    TickMessage,
)
from motm_twin.control.arm.types import ArmStep
from motm_twin.control.tick import Tick
from motm_twin.model.geometry import Array
from motm_twin.model.plant import BodyTruth, Observation, Truth
from motm_twin.model.scene import PlanarPose
from motm_twin.perception.world_map import WorldMap
from motm_twin.planning.types import BasePlan, Placement

_DRAWN = 4  # digits after the point of what is only drawn: 0.1 mm
_EXACT = 9
_TIME = 6  # simulated time in steps of 1 us: 1.97, not 1.9700000000000015


def seconds(time: float) -> float:
    """A simulated time [s] as it is sent."""
    return round(float(time), _TIME)


def numbers(values: object, digits: int = _DRAWN) -> list:
    """An array as nested lists of rounded numbers: as `numpy.round` does it, in half the time."""
    scale = 10.0**digits
    return (np.rint(np.asarray(values, dtype=float) * scale) / scale).tolist()


def _robot(observation: Observation, truth: Truth | None) -> RobotMessage:
    pose = numbers(observation.pose, _EXACT)
    return RobotMessage(
        pose=pose,
        true_pose=pose if truth is None else numbers(truth.pose, _EXACT),
        twist=numbers(observation.twist, _EXACT),
        q=numbers(observation.q, _EXACT),
        dq=numbers(observation.dq, _EXACT),
        gripper_width=float(observation.gripper_width),
    )


def body_message(body: BodyTruth) -> BodyMessage:
    """One true body."""
    return BodyMessage(
        name=body.name,
        kind=body.kind,
        position=numbers(body.position),
        yaw=float(body.yaw),
        state=body.state,
        size=numbers(body.size),
    )


def _placement(placement: Placement) -> PlacementMessage:
    return PlacementMessage(
        mode=placement.mode,
        radius=float(placement.radius),
        poses=numbers(placement.poses),
        cost_current=numbers(placement.cost_current),
        cost_next=numbers(placement.cost_next),
        cost=numbers(placement.cost),
        rejected=list(placement.rejected),
        chosen=int(placement.chosen),
        goal=numbers(placement.goal),
        goal_has_heading=bool(placement.goal_has_heading),
        reason=placement.reason,
        next_goal=None if placement.next_goal is None else numbers(placement.next_goal),
    )


def _plan(plan: BasePlan) -> PlanMessage:
    return PlanMessage(
        status=plan.status,
        reason=plan.reason,
        acceleration=numbers(plan.acceleration),
        global_path=numbers(plan.global_path),
        next_path=numbers(plan.next_path),
        intermediate_goal=numbers(plan.intermediate_goal),
        local_poses=numbers(plan.local_poses),
        local_times=numbers(plan.local_times),
        bezier=numbers(plan.bezier),
        expansions=int(plan.expansions),
        cut_by_clock=bool(plan.cut_by_clock),
        t_h=float(plan.t_h),
        k=float(plan.k),
        time_to_range=float(plan.time_to_range),
    )


def _arm(step: ArmStep) -> ArmMessage:
    return ArmMessage(
        time=seconds(step.time),
        phase=step.phase,
        base_twist=numbers(step.actuation.twist),
        joint_velocity=numbers(step.actuation.joint_velocity),
        gripper=step.actuation.gripper,
        reference=numbers(step.reference),
        error=float(step.error),
        tilt=float(step.tilt),
        slack=numbers(step.slack, _EXACT),
        manipulability=float(step.manipulability),
        active=list(step.active),
        limiter=step.limiter,
        obstacle_distance=float(step.obstacle_distance),
        allowed_approach=float(step.allowed_approach),
        qp_status=step.qp_status,
        holding=bool(step.holding),
        outcome=step.outcome,
        reason=step.reason,
    )


def _score(truth: Truth) -> ScoreMessage:
    return ScoreMessage(
        picks=int(truth.picks),
        places=int(truth.places),
        drops=int(truth.drops),
        contacts=[msgspec.convert(contact, ContactMessage, from_attributes=True) for contact in truth.contacts],
        min_base_clearance=float(truth.min_base_clearance),
        min_arm_clearance=float(truth.min_arm_clearance),
        min_ee_obstacle=float(truth.min_ee_obstacle),
        ee_obstacle=float(truth.ee_obstacle),
        path_length=float(truth.path_length),
        cut_ins=[msgspec.convert(cut_in, CutInMessage, from_attributes=True) for cut_in in truth.cut_ins],
        dropped=list(truth.dropped),
    )


def path_message(points: Array) -> list[list[float]]:
    """A polyline, shape (n, 2)."""
    return numbers(points)


def bodies(truth: Truth) -> dict[str, Any]:
    """The fields of a tick that say where bodies are, and which sensors fail."""
    return {
        "objects": [body_message(body) for body in truth.objects],
        "agents": [body_message(body) for body in truth.agents],
        "obstacles": [body_message(body) for body in truth.obstacles],
        "furniture": [body_message(body) for body in truth.furniture],
        "removed": list(truth.removed),
        "faults": list(truth.faults),
    }


_NO_BODIES: dict[str, Any] = {"objects": [], "agents": [], "obstacles": []}


def tick_message(
    tick: Tick,
    run: int,
    server_time: float,
    *,
    began: float = 0.0,
    first: int = 0,
    past: int = -1,
    ended: float | None = None,
    announced: Mapping[str, PlanarPose] | None = None,
) -> TickMessage:
    """The message of one period.

    ``ended`` [s]: when all was done; ``announced``: where the robot was told that pieces of furniture stand.
    """
    truth = tick.truth
    return TickMessage(
        version=TICK_VERSION,
        run=run,
        began=began,
        first=first,
        past=past,
        ended=ended,
        server_time=server_time,
        index=tick.index,
        time=seconds(tick.time),
        robot=_robot(tick.observation, truth),
        **(_NO_BODIES if truth is None else bodies(truth)),
        announced={name: [*numbers(pose[:2]), float(pose[2])] for name, pose in (announced or {}).items()},
        tasks=[TaskMessage(kind=t.kind, target=t.target, status=t.status, attempts=t.attempts) for t in tick.tasks],
        task_index=tick.task_index,
        beliefs=[
            BeliefMessage(
                name=belief.name,
                position=numbers(belief.position),
                yaw=float(belief.yaw),
                position_sd=float(belief.position_sd),
                seen=bool(belief.seen),
                held=bool(belief.held),
            )
            for belief in tick.beliefs
        ],
        placement=_placement(tick.placement),
        plan=_plan(tick.plan),
        arm=[_arm(step) for step in tick.arm],
        stop_reason=tick.stop_reason,
        events=[EventMessage(time=seconds(event.time), kind=event.kind, text=event.text) for event in tick.events],
        stage_ms={name: round(float(value), 3) for name, value in tick.stage_ms.items()},
        score=None if truth is None else _score(truth),
        done=bool(tick.done),
        success=bool(tick.success),
        preview=False,
        edits=list(tick.edits),
    )


def grid_bytes(world: WorldMap) -> bytes:
    """Occupancy and proximity of a map in one byte per cell (see GRID_ENCODING)."""
    cells = np.clip(world.proximity * 254.0, 0.0, 254.0).astype(np.uint8)
    cells[world.occupied != 0] = 255
    return cells.tobytes()


def grid_info(world: WorldMap, run: int) -> GridInfo:
    """The attachment that goes with `grid_bytes`."""
    height, width = world.occupied.shape
    return GridInfo(
        version=GRID_VERSION,
        run=run,
        encoding=GRID_ENCODING,
        resolution=float(world.resolution),
        origin=[float(world.origin[0]), float(world.origin[1])],
        width=int(width),
        height=int(height),
        stamp=seconds(world.stamp),
    )
