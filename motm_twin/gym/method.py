"""The methods of the environment: the loop as ever, with a base, or a whole robot, that is commanded from outside."""

from functools import partial

from motm_twin.gym.arm_action import ArmAction
from motm_twin.gym.base_action import BaseAction, NoPlacement
from motm_twin.methods.method import ArmParts, Method, PlannerParts
from motm_twin.planning.planner import BasePlanner

MODES = ("base", "whole_body")
UNDIVIDED = ("holistic", "open_loop")  # their base and arm are decided together: neither goes with another's


def agent_planner(parts: PlannerParts, *, guard: bool) -> BasePlanner:
    """A planner that drives as an agent says; ``guard``: as far as it can stop before whatever the map shows."""
    robot, parameters = parts.known.robot, parts.parameters
    controller = BaseAction(robot, parameters, guard=guard)
    return BasePlanner(robot, parameters, placement=NoPlacement(), controller=controller, graphs=parts.graphs)


def agent_arm(parts: ArmParts) -> ArmAction:
    """An arm that moves as an agent says."""
    return ArmAction(parts.known, parts.parameters)


def agent_method(mode: str, arm: Method, *, guard: bool = False) -> Method:
    """The method of an action mode; ``arm``: whose arm reaches in the mode "base". Raises ValueError."""
    if mode not in MODES:
        raise ValueError(f"action mode {mode!r}: use {' or '.join(map(repr, MODES))}")
    whole = mode == "whole_body"
    if not whole:
        check_divided(arm)
    return Method(
        name=f"gym_{mode}",
        title="an agent, whole body" if whole else f"an agent drives, the arm of {arm.name}",
        summary="What `motm_twin.gym` runs: the actions come from outside.",
        source="own",
        parameters={} if whole else arm.parameters,
        planner=partial(agent_planner, guard=guard),
        arm=agent_arm if whole else arm.arm,
    )


def check_divided(method: Method) -> None:
    """Raise ValueError for a method whose arm does not go with a base that is driven by somebody else."""
    if method.name in UNDIVIDED:
        raise ValueError(f"{method.name} decides about base and arm together: only actions='whole_body' takes both")
