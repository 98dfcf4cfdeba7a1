"""Why the robot stands, in one sentence with names and numbers."""

from motm_twin.control.arm.types import ArmStep
from motm_twin.control.sequence import TaskSequence
from motm_twin.control.task_list import name_of
from motm_twin.model.plant import Observation
from motm_twin.model.scene import DriveTo
from motm_twin.planning.types import BasePlan

MOVING = (0.03, 0.05)  # [m/s], [rad/s] below which the base stands
WAITING = (0.10, 0.30)  # [m/s], [rad/s] below which it waits for the arm
STARTING = 0.05  # [m/s^2], [rad/s^2] of a base that is about to move
_DOING = {
    "transit": "the hand is on its way",
    "final": "the fingers go down",
    "closing": "the fingers close",
    "lift": "the hand lifts it",
    "retry": "the fingers open for another try",
    "release": "the hand waits until what it drops lands inside",
}


def standing(sequence: TaskSequence, plan: BasePlan, step: ArmStep, observation: Observation) -> str:
    """Why the base stands or brakes; "" when it drives or is about to."""
    if step.qp_status.startswith(("standing", "withdrawing")):
        return step.reason
    task = sequence.active
    arm_s_turn = task is not None and not isinstance(task, DriveTo) and (plan.time_to_range == 0.0 or step.engaged)
    limit = WAITING if arm_s_turn and plan.status in ("goal", "aborted") else MOVING
    if abs(observation.twist[0]) > limit[0] or abs(observation.twist[1]) > limit[1]:
        return plan.reason if plan.status == "braking" else ""
    if sequence.done:
        return _ended(sequence)
    if task is None:
        return _homeless(sequence)
    if plan.reason:
        return plan.reason
    if arm_s_turn:
        return _waiting(sequence, name_of(task), step)
    if abs(plan.acceleration[0]) > STARTING or abs(plan.acceleration[1]) > STARTING:
        return ""
    return f"no motion towards {name_of(task)} is better than standing ({plan.expansions} tried)"


def _ended(sequence: TaskSequence) -> str:
    count, failures = len(sequence.tasks), sequence.failures
    held = f"; {sequence.held} is still in the gripper" if sequence.held else ""
    if not failures:
        return f"all {count} tasks are done{held}" if count else f"there are no tasks{held}"
    return f"all {count} tasks have ended, {len(failures)} given up: {'; '.join(failures)}{held}"


def _homeless(sequence: TaskSequence) -> str:
    """What is held has no place task."""
    tried = f"it did not get into {' and '.join(sequence.refused)}; " if sequence.refused else ""
    return f"{sequence.held} is in the gripper and no task says where it goes: {tried}put a place task first"


def _waiting(sequence: TaskSequence, name: str, step: ArmStep) -> str:
    """The target is in reach: what the arm is at."""
    tries = f" (try {sequence.attempts} of {sequence.most_attempts})" if sequence.attempts > 1 else ""
    if step.qp_status != "solved":
        return _about(name, step.reason) + tries
    if step.limiter and any("lidar" in row for row in step.active):
        what = "gripper" if any(row.startswith("lidar") for row in step.active) else "arm"
        return f"{name}: the {what} is held {step.obstacle_distance:.2f} m from a seen {step.limiter}{tries}"
    if step.reason:
        return _about(name, step.reason) + tries
    doing = _DOING.get(step.phase, "it leaves its stow pose")
    if step.phase == "release" and step.actuation.gripper == "open":
        doing = "the fingers let go"
    return f"waiting for the arm at {name}: {doing}{tries}"


def _about(name: str, reason: str) -> str:
    return reason if name in reason else f"{name}: {reason}"
