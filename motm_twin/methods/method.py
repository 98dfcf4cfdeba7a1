"""Import path of `control.method` that methods in files of users name."""

from motm_twin.control.method import (
    ArmParts,
    BaseChoices,
    Materials,
    Method,
    PlannerParts,
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
    "map_ahead",
    "paper_arm",
    "paper_planner",
]
