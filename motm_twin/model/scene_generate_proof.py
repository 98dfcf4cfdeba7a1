"""Why a generated scene can be solved: a way for the robot between all poses that it needs, with room to spare.

The robot is taken as the disc round its footprint, grown by what it really needs beyond it (`DISC`). Where the middle
of that disc is free, the robot stands clear with any heading: it can turn on the spot there. Between two places of one
connected part of that free space it can therefore drive, turning on the spot at the corners of its way. A doorway is
narrower than the disc: the strip of places on its axis, along which the robot drives straight with `BESIDE` to spare on
either side, joins the parts that its ends lie in.

A target is served from a standing pose in the part of the start: the robot faces it there, and the arm's mount is then
at most `STAND` less the mount's distance away, less than any pick or release needs. Heights of targets are those at
which the arm reaches that far (`HIGHEST`, `LOWEST`).
"""

from shapely.geometry import LineString, Point
from shapely.geometry.base import BaseGeometry
from shapely.ops import unary_union

from motm_twin.model.profile import RobotProfile

DISC = 0.50  # [m] 0.43 m round the footprint, 0.05 m that the search keeps, 0.02 m of localisation (2 sigma)
BESIDE = 0.12  # [m] of room on either side of the footprint in a doorway
STAND = 0.80  # [m] from the middle of the base to a target: 0.65 m from the mount
NEAREST = 0.55  # [m] the same: the arm does not fold up closer
LOWEST, HIGHEST = 0.55, 0.90  # [m] targets for which `STAND` is in reach
FOOTPRINT = RobotProfile().footprint
Place = tuple[float, float]
Door = tuple[Place, Place]  # ends of the strip on a doorway's axis


def free_parts(room: BaseGeometry, bodies: list[BaseGeometry]) -> list[BaseGeometry]:
    """Connected parts of the places at which the robot can turn on the spot."""
    free = room.buffer(-DISC).difference(unary_union(bodies).buffer(DISC))
    return [part for part in getattr(free, "geoms", [free]) if not part.is_empty]


def reachable(start: Place, parts: list[BaseGeometry], doors: list[Door]) -> BaseGeometry:
    """All places that the robot can get to from its start; empty when it cannot turn there."""
    inside = _parts_at(start, parts)
    joined = [_parts_at(one, parts) | _parts_at(other, parts) for one, other in doors]
    for _ in joined:  # as often as a way may lead through doorways
        for both in joined:
            inside |= both if inside & both else set()
    return unary_union([parts[index] for index in sorted(inside)])


def _parts_at(place: Place, parts: list[BaseGeometry]) -> set[int]:
    return {index for index, part in enumerate(parts) if part.covers(Point(place))}


def passable(door: Door, bodies: list[BaseGeometry]) -> bool:
    """Whether the footprint, driven straight from one end of the strip to the other, keeps `BESIDE` from everything."""
    way = LineString(door).buffer(0.5 * FOOTPRINT.width + BESIDE, cap_style="square")
    return not any(body.intersects(way) for body in bodies)


def at_height(z: float) -> bool:
    """Whether the arm reaches as far as `STAND` asks at a height [m]."""
    return LOWEST <= z <= HIGHEST


def can_stand(target: Place, ground: BaseGeometry) -> bool:
    """Whether there is a reachable place from which a standing robot serves the target."""
    around = Point(target).buffer(STAND, quad_segs=32).difference(Point(target).buffer(NEAREST))
    return bool(around.intersects(ground))


def can_turn(place: Place, ground: BaseGeometry) -> bool:
    """Whether a reachable place is one where the robot stands clear with any heading."""
    return bool(ground.covers(Point(place)))
