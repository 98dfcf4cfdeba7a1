"""Public import path of `control.method`, for methods in users' files."""

from motm_twin.control.method import (
    ArmParts,
    BaseChoices,
    Materials,
    Method,
    PlannerParts,
    Policies,
    map_ahead,
    paper_arm,
    paper_planner,
)

__all__ = [
    "ArmParts",
    "BaseChoices",
    "Materials",
    "Method",
    "PlannerParts",
    "Policies",
    "map_ahead",
    "paper_arm",
    "paper_planner",
]
