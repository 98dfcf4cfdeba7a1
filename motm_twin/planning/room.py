"""Room that plans keep from obstacles: as ever, or less for a robot that finds no way."""

from typing import NamedTuple

from motm_twin.model.profile import Footprint
from motm_twin.planning.parameters import PlanningParameters, growth

LEAST = 0.02  # [m] beyond half the width of the footprint that a way must have, however tight


class Room(NamedTuple):
    """Growth of obstacles for global paths, margin of the local search and clearance of candidates [m]."""

    growth: float
    margin: float
    clearance: float


def room_for(parameters: PlanningParameters, footprint: Footprint, tightness: float) -> Room:
    """The room of a period: 0 as the parameters say, 1 down to the true footprint."""
    staa, placement = parameters.staa, parameters.placement
    wide = growth(footprint, staa)
    least = Room(min(wide, 0.5 * footprint.width + LEAST), min(staa.margin, staa.margin_floor), LEAST)
    most = Room(wide, staa.margin, placement.clearance)
    return Room(*(a + tightness * (b - a) for a, b in zip(most, least, strict=True)))
