"""Reasons why the robot stands."""

from motm_twin.control.arm.types import ArmStep, Phase, ProgramStatus
from motm_twin.control.sequence import TaskSequence
from motm_twin.control.task_list import name_of
from motm_twin.model.plant import Observation
from motm_twin.model.reason import Kind, Reason
from motm_twin.model.scene import DriveTo
from motm_twin.planning.types import BasePlan, PlanStatus

STANDSTILL = (0.03, 0.05)  # [m/s], [rad/s] below which the base stands
WAITING = (0.10, 0.30)  # [m/s], [rad/s] below which it waits for the arm
STARTING = 0.05  # [m/s^2], [rad/s^2] above which the base is about to move
_DOING = {
    Phase.TRANSIT: "the hand is on its way",
    Phase.FINAL: "the fingers go down",
    Phase.CLOSING: "the fingers close",
    Phase.LIFT: "the hand lifts it",
    Phase.RETRY: "the fingers open for another try",
    Phase.RELEASE: "the hand waits until what it drops lands inside",
}


def why_standing(sequence: TaskSequence, plan: BasePlan, step: ArmStep, observation: Observation) -> Reason | None:
    """Reason why the base stands or brakes; None when it drives or is about to."""
    if step.program in (ProgramStatus.STANDING, ProgramStatus.WITHDRAWING):
        return step.why
    task = sequence.active
    arm_s_turn = task is not None and not isinstance(task, DriveTo) and (plan.time_to_range == 0.0 or step.engaged)
    limit = WAITING if arm_s_turn and plan.status in (PlanStatus.GOAL, PlanStatus.ABORTED) else STANDSTILL
    if abs(observation.twist[0]) > limit[0] or abs(observation.twist[1]) > limit[1]:
        return plan.why if plan.status == PlanStatus.BRAKING else None
    if sequence.done:
        return _ended(sequence)
    if task is None:
        return _homeless(sequence)
    if plan.why is not None:
        return plan.why
    if arm_s_turn:
        return _waiting(sequence, name_of(task), step)
    if abs(plan.acceleration[0]) > STARTING or abs(plan.acceleration[1]) > STARTING:
        return None
    return Reason(kind=Kind.NO_BETTER_MOTION, subject=name_of(task), value=plan.expansions)


def _ended(sequence: TaskSequence) -> Reason:
    count, failures = len(sequence.tasks), sequence.failures
    held = f"; {sequence.held} is still in the gripper" if sequence.held else ""
    if failures:
        given_up = f"{'; '.join(failures)}{held}"
        return Reason(kind=Kind.ALL_ENDED, value=count, limit=len(failures), other=given_up)
    return Reason(kind=Kind.ALL_DONE if count else Kind.NO_TASKS, value=count, other=held)


def _homeless(sequence: TaskSequence) -> Reason:
    """Reason of a held object without a place task."""
    tried = f"it did not get into {' and '.join(sequence.refused)}; " if sequence.refused else ""
    return Reason(kind=Kind.NO_PLACE_TASK, subject=sequence.held, other=tried)


def _waiting(sequence: TaskSequence, name: str, step: ArmStep) -> Reason:
    """Reason to wait for the arm: the target is in reach."""
    tries, most = float(sequence.attempts), float(sequence.most_attempts)
    cause = step.why
    if step.program == ProgramStatus.SOLVED and step.limiter and any("lidar" in row for row in step.active):
        what = "gripper" if any(row.startswith("lidar") for row in step.active) else "arm"
        cause = Reason(kind=Kind.HELD_OFF, subject=what, other=step.limiter, value=step.obstacle_distance, unit="m")
    if cause is not None:
        return Reason(kind=Kind.AT_TARGET, subject=name, cause=cause, value=tries, limit=most)
    doing = _DOING.get(step.phase, "it leaves its stow pose")
    if step.phase == Phase.RELEASE and step.actuation.gripper == "open":
        doing = "the fingers let go"
    return Reason(kind=Kind.PHASE, subject=name, other=doing, value=tries, limit=most)
