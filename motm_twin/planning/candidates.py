"""Candidate base poses for a target and their costs: rings round it, and fallbacks where no ring has a free one.

A rule of candidates is a function of a target and the `Survey` of a period. It returns candidates with their costs,
a `Judged`. `smallest_ring` is the paper's rule; `every_ring.EveryRing` is another.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from motm_twin.model.exact import angle_of, turn_between
from motm_twin.model.geometry import Array
from motm_twin.model.profile import RobotProfile
from motm_twin.planning.collision import Body, body_of, clearances
from motm_twin.planning.cost_to_go import Rates, Table
from motm_twin.planning.global_path import costs_on, costs_to, poses_at, rates_of
from motm_twin.planning.parameters import PlanningParameters, Room
from motm_twin.planning.reach import ReachModel
from motm_twin.planning.rejections import Here, Rejection, in_sight, leaves_room, may_move, rejections
from motm_twin.planning.types import Mode, Target

# [m], [rad]: this near to a base pose from which the arm failed to get to its target, it may fail again
AVOIDED_PLACE, AVOIDED_HEADING = 0.25, 0.6


@dataclasses.dataclass(kw_only=True)
class PlacementState:
    """The choice of the last period."""

    target: tuple[str, str] | None = None
    goal: Array | None = None
    closest: bool = False  # the choice was the free place closest to the target, not a pose that serves it

    def of(self, target: Target) -> bool:
        """Test that the choice was made for this target."""
        return self.target == (target.kind, target.name)


class PlacementModel:
    """A robot and the parameters of its base placement, as rules of candidates read them."""

    def __init__(self, profile: RobotProfile, parameters: PlanningParameters) -> None:
        p = parameters.placement
        steps = max(1, round((p.radius_max - p.radius_min) / p.radius_step))
        self.profile, self.parameters, self.placement = profile, parameters, p
        self.body: Body = body_of(profile.footprint)
        self.reach = ReachModel(profile, parameters.reach)
        self.rates: Rates = rates_of(profile.base)
        self.radii: Array = np.linspace(p.radius_min, p.radius_max, steps + 1)  # [m] of the rings
        self.mount_offset = math.hypot(profile.arm.mount_x, profile.arm.mount_y)  # [m] of the arm

    def farthest(self, target: Target) -> float:
        """Largest distance [m] of the base from a target that the arm reaches."""
        return self.reach.r_max(target) + self.mount_offset


class Survey(NamedTuple):
    """Inputs of a rule of candidates in one period."""

    model: PlacementModel
    here: Here
    room: Room
    last: PlacementState
    from_robot: Table  # costs from the robot
    to_next: Table | None  # costs to the poses of the next target; None: no next target


class Candidates(NamedTuple):
    """Candidate base poses (m, 3) at places (p, 2), and why each is rejected ("" if it is not)."""

    mode: Mode
    radius: float
    pose: Array
    place: Array
    place_of: Array
    rejected: list[str]

    def viable(self) -> Array:
        """Mask of the poses that are not rejected, shape (m,) of bool."""
        return np.array([not why for why in self.rejected], dtype=bool)


class Judged(NamedTuple):
    """Candidates with C_iC and C_iN [s], inf where rejected, shape (m,)."""

    candidates: Candidates
    current: Array
    onward: Array
    waits: bool = False  # poses to wait at until a dynamic obstacle leaves a candidate; C_iN: from there to a candidate
    waiting: Array | None = None  # [s] share of C_iC spent waiting until each is free, (m,); None: no dynamic obstacle


Rule = Callable[[Target, Survey], Judged]


def smallest_ring(target: Target, survey: Survey) -> Judged:
    """The first candidate set with a pose that is free, in reach and has a path.

    The candidates of the preferred mode stay in the list, with the reasons for their rejection.
    """
    first: Candidates | None = None
    for candidates in candidate_sets(target, survey):
        other = first is not None and first.mode != candidates.mode
        judged = costs_of(joined(first, candidates) if first is not None and other else candidates, survey)
        if np.isfinite(judged.current).any():
            return judged
        first = first if first is not None and first.mode != judged.candidates.mode else judged.candidates
    assert first is not None
    return Judged(first, np.full(len(first.pose), np.inf), np.full(len(first.pose), np.inf))


def candidate_sets(target: Target, survey: Survey) -> Iterator[Candidates]:
    """Candidate sets of the paper, in order of preference."""
    if target.kind == "drive":
        yield _drive(target, survey)
    else:
        yield from _tangential(target, survey)
        yield from _any_heading(target, survey)
    yield from _closest_sets(target, survey)


def costs_of(candidates: Candidates, survey: Survey) -> Judged:
    """The costs of candidates along paths. A candidate without a path is rejected here."""
    n, graph = len(candidates.pose), survey.here.graph
    current, onward = np.full(n, np.inf), np.full(n, np.inf)
    viable = candidates.viable()
    if not viable.any():
        return Judged(candidates, current, onward)
    place_of = candidates.place_of[viable]
    used = np.zeros(len(candidates.place), dtype=bool)
    used[place_of] = True
    number = np.cumsum(used, dtype=np.int32) - np.int32(1)
    poses = poses_at(graph, candidates.pose[viable], candidates.place[used], number[place_of])
    current[viable] = costs_to(graph, survey.from_robot, poses)
    onward[viable] = costs_on(graph, survey.to_next, poses) if survey.to_next is not None else 0.0
    blocked = viable & ~np.isfinite(current)
    for i in np.flatnonzero(blocked):
        candidates.rejected[i] = Rejection.NO_PATH
    onward[~np.isfinite(onward) & viable & ~blocked] = _no_way_on(onward)
    onward[blocked] = np.inf
    return Judged(candidates, current, onward)


def _no_way_on(onward: Array) -> float:
    finite = onward[np.isfinite(onward)]
    return float(finite.max()) if len(finite) else 0.0


def joined(first: Candidates, second: Candidates) -> Candidates:
    """Two sets as one; mode and radius of the second, or of the first when both have the same mode."""
    lead = first if first.mode == second.mode else second
    return Candidates(
        lead.mode,
        lead.radius,
        np.concatenate((first.pose, second.pose)),
        np.concatenate((first.place, second.place)),
        np.concatenate((first.place_of, second.place_of + len(first.place))).astype(np.int32),
        first.rejected + second.rejected,
    )


def next_poses(target: Target, survey: Survey) -> Array:
    """Poses from which the next target can be served, shape (m, 3); a heading of nan is free."""
    for candidates in candidate_sets(target, survey):
        viable = candidates.viable()
        if viable.any():
            poses = candidates.pose[viable]
            if target.kind == "drive" and target.heading is None:
                poses = np.array([[*poses[0, :2], math.nan]])
            most = survey.model.placement.ring_poses
            if len(poses) > most:
                poses = poses[:: 1 + len(poses) // most]
            return poses[np.lexsort((poses[:, 1], poses[:, 0]))]
    return np.array([[target.position[0], target.position[1], math.nan]])


def _tangential(target: Target, survey: Survey) -> Iterator[Candidates]:
    """The paper's rings, the smallest first: those with a viable candidate, and the largest."""
    p = survey.model.placement
    for radius in survey.model.radii:
        pose, place, place_of = ring(target.position, radius, p.positions)
        reached = survey.model.reach.reached_from(pose, target)
        rejected = rejections(pose, survey.room.clearance, survey.here)
        rejected = [why or ("" if ok else Rejection.NO_REACH) for why, ok in zip(rejected, reached, strict=True)]
        candidates = Candidates(Mode.RING, float(radius), pose, place, place_of, rejected)
        if candidates.viable().any() or radius == p.radius_max:
            yield candidates


def _any_heading(target: Target, survey: Survey) -> Iterator[Candidates]:
    """Free poses of any heading from which the arm reaches, the closest rings first, two at a time."""
    model, needed = survey.model, survey.room.clearance
    p = model.placement
    previous: Candidates | None = None
    for radius in np.arange(model.body.inner, model.farthest(target), p.radius_step):
        pose, place, place_of = spokes(target.position, radius, p.positions, p.headings)
        reached = model.reach.reached_from(pose, target, slack=2.0 * model.parameters.reach.plan_slack)
        keep = reached.copy()
        keep[reached] = clearances(pose[reached], needed, survey.here.field, survey.here.body) >= needed
        if not keep.any():
            continue
        found = Candidates(Mode.REACH, float(radius), pose[keep], place, place_of[keep], [""] * int(keep.sum()))
        if previous is not None:
            yield joined(previous, found)
        previous = found
    if previous is not None:
        yield previous


def _closest_sets(target: Target, survey: Survey) -> Iterator[Candidates]:
    """Free places, the closest first; those in sight and clear of obstacles that may move come before all others.

    The place of the last period comes first as long as it is free and none is found that is clearly closer.
    """
    sets = _in_sight_first(target, survey)
    first = next(sets, None)
    kept = _kept_closest(target, survey)
    if kept is not None and (first is None or first.radius > kept.radius - survey.model.placement.clearly_closer):
        yield kept
    if first is not None:
        yield first
    yield from sets


def _in_sight_first(target: Target, survey: Survey) -> Iterator[Candidates]:
    for room in waiting_rooms(survey):
        yield from closest_places(target, survey, room, sight=True)
    yield from closest_places(target, survey, 0.0)


def _kept_closest(target: Target, survey: Survey) -> Candidates | None:
    """The place of the last period as the only candidate, while it is free."""
    last = survey.last
    if not last.closest or last.goal is None or not last.of(target):
        return None
    pose = last.goal[None]
    if clearances(pose, 1.0, survey.here.field, survey.here.body)[0] < 0.0:
        return None
    away = math.dist(last.goal[:2], target.position[:2])
    return Candidates(Mode.CLOSEST, away, pose, pose[:, :2], np.zeros(1, np.int32), [""])


def waiting_rooms(survey: Survey) -> tuple[float, ...]:
    """Clearances [m] of a waiting base from obstacles that may move, the preferred one first."""
    return (survey.model.placement.room, 0.0) if len(may_move(survey.here.world)) else (0.0,)


def closest_places(
    target: Target, survey: Survey, room: float, within: float = math.inf, *, sight: bool = False
) -> Iterator[Candidates]:
    """Free places ``within`` [m] of a target, the closest first, at least ``room`` [m] from obstacles that may move.

    Places behind walls are left out: however close they are, the arm does not get to the target from there.
    """
    model, here, needed = survey.model, survey.here, survey.room.clearance
    farthest = model.body.reach + model.parameters.staa.local_radius
    for radius in np.arange(0.0, farthest, 2.0 * model.placement.radius_step):
        if radius > within:
            return
        pose, place, place_of = spokes(target.position, radius, model.placement.positions, 4)
        keep = clearances(pose, needed, here.field, here.body) >= needed
        keep &= ~model.reach.behind_walls(pose, target)
        if room > 0.0:
            keep &= leaves_room(pose, room, here)
        if sight and keep.any():
            keep[keep] = in_sight(pose[keep], here)
        if keep.any():
            yield Candidates(Mode.CLOSEST, float(radius), pose[keep], place, place_of[keep], [""] * int(keep.sum()))


def times_avoided(pose: Array, avoid: Array) -> NDArray[np.int64]:
    """Number of the poses to be avoided (k, 3) that are near each pose, (m, 3) -> (m,)."""
    away = np.hypot(*(pose[:, None, :2] - avoid[None, :, :2]).transpose(2, 0, 1))
    swing = turn_between(pose[:, None, 2], avoid[None, :, 2])
    return np.sum((away <= AVOIDED_PLACE) & (swing <= AVOIDED_HEADING), axis=1)


def is_avoided(pose: Array, avoid: Array) -> bool:
    """Test that the arm failed near this pose (3,) before: having the target in reach is not enough there."""
    return len(avoid) > 0 and bool(times_avoided(np.asarray(pose)[None], avoid)[0])


def _drive(target: Target, survey: Survey) -> Candidates:
    """Candidates at a point to drive to, with its heading or headings all round."""
    count = survey.model.placement.headings if target.heading is None else 1
    pose = np.empty((count, 3))
    pose[:, :2] = target.position[:2]
    pose[:, 2] = 0.0 if target.heading is None else target.heading
    pose[:, 2] += np.arange(count) * (2.0 * math.pi / count)
    pose[:, 2] = angle_of(np.sin(pose[:, 2]), np.cos(pose[:, 2]))
    rejected = rejections(pose, survey.room.clearance, survey.here)
    if survey.last.closest and survey.last.of(target):
        # The point was not free before. Out of sight, the obstacle seen there may have been forgotten.
        seen = in_sight(pose, survey.here)
        rejected = [why or ("" if ok else Rejection.HIDDEN) for why, ok in zip(rejected, seen, strict=True)]
    return Candidates(Mode.DRIVE, 0.0, pose, pose[:1, :2], np.zeros(count, np.int32), rejected)


def ring(centre: Array, radius: float, positions: int) -> tuple[Array, Array, Array]:
    """Candidates on a circle: poses (2 n, 3), places (n, 2), place of each pose. Headings are tangential.

    Even entries drive round the target counter-clockwise, odd ones clockwise (Paper, Sec. IV).
    """
    unit, heading, place_of = _unit_ring(positions)
    place = np.asarray(centre)[:2] + radius * unit
    pose = np.empty((len(heading), 3))
    pose[:, :2], pose[:, 2] = place[place_of], heading
    return pose, place, place_of


def rings(centre: Array, radii: Array, positions: int) -> tuple[Array, Array, Array]:
    """`ring` of each of the radii (k,), one after the other: poses (2 k n, 3), places (k n, 2), place of each pose."""
    unit, heading, place_of = _unit_ring(positions)
    place = (np.asarray(centre)[:2] + radii[:, None, None] * unit).reshape(-1, 2)
    place_of = (place_of + positions * np.arange(len(radii), dtype=np.int32)[:, None]).ravel()
    return np.column_stack((place[place_of], np.tile(heading, len(radii)))), place, place_of


@functools.cache
def _unit_ring(positions: int) -> tuple[Array, Array, NDArray[np.int32]]:
    """Places (n, 2) on a circle of 1 m, two headings (2 n,) at each, and the place of each heading."""
    angle = np.arange(positions) * (2.0 * math.pi / positions)
    place_of = np.repeat(np.arange(positions, dtype=np.int32), 2)
    heading = np.repeat(angle, 2) + np.tile((0.5 * math.pi, -0.5 * math.pi), positions)
    return np.column_stack((np.cos(angle), np.sin(angle))), angle_of(np.sin(heading), np.cos(heading)), place_of


def spokes(centre: Array, radius: float, positions: int, headings: int) -> tuple[Array, Array, Array]:
    """All headings at every position of a circle: poses (n h, 3), places (n, 2), place of each pose."""
    unit, heading, place_of = _unit_spokes(positions, headings)
    place = np.asarray(centre)[:2] + radius * unit
    return np.column_stack((place[place_of], heading)), place, place_of.copy()


@functools.cache
def _unit_spokes(positions: int, headings: int) -> tuple[Array, Array, NDArray[np.int32]]:
    """Places (n, 2) on a circle of 1 m, headings (n h,) at each, and the place of each heading."""
    angle = np.arange(positions) * (2.0 * math.pi / positions)
    place_of = np.repeat(np.arange(positions, dtype=np.int32), headings)
    away = np.tile(np.arange(headings) * (2.0 * math.pi / headings), positions)
    heading = np.repeat(angle, headings) + math.pi + away
    return np.column_stack((np.cos(angle), np.sin(angle))), angle_of(np.sin(heading), np.cos(heading)), place_of
