"""The methods of the environment: the loop as ever, with a base, or a whole robot, that is commanded from outside."""

from functools import partial

from motm_twin.control.method import ArmParts, Method, PlannerParts
from motm_twin.gym.arm_action import ArmAction
from motm_twin.gym.base_action import BaseAction, NoPlacement
from motm_twin.planning.planner import BasePlanner

MODES = ("base", "whole_body")


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
        check_fits(arm, whole_body=False)
    return Method(
        name=f"gym_{mode}",
        title="an agent, whole body" if whole else f"an agent drives, the arm of {arm.name}",
        summary="What `motm_twin.gym` runs: the actions come from outside.",
        source="own",
        parameters={} if whole else arm.parameters,
        planner=partial(agent_planner, guard=guard),
        arm=agent_arm if whole else arm.arm,
    )


def check_fits(method: Method, *, whole_body: bool) -> None:
    """Raise ValueError for a method that an action mode cannot use; ``whole_body``: which of the two it is."""
    if method.name == "open_loop":
        raise ValueError("open_loop rehearses the whole task beforehand: no action mode can use it")
    if method.name == "holistic" and not whole_body:
        raise ValueError("holistic decides about base and arm together: only actions='whole_body' takes both")
