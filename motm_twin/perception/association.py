"""Data association: names for anonymous detections, from the believed places of the objects.

The detections of a picture and the objects are assigned jointly: as many as possible, with the least total cost in
standard deviations (global nearest neighbour). An unmatched detection is a candidate. One seen repeatedly at one place
becomes an object that somebody has moved, if one is missing from its believed place; one seen once is ignored.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Protocol

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from motm_twin.model.geometry import Array, from_frame
from motm_twin.model.number import OWN, Number
from motm_twin.model.plant import PERIOD, Detection

MOST_CANDIDATES = 50  # that are remembered
MOST_DENIED = 20  # that are remembered
SAME = 0.03  # [m] within which it is the same place
LIKELY = 0.2  # [s] for which one detection that was matched says where an object is that has no name yet


class AssociationSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the matching; choices of this project."""

    pushed: Annotated[
        float, Number("m", OWN, "from where an object was seen, that a thing is taken for it in the same picture")
    ] = 0.15
    vague: Annotated[float, Number("m", OWN, "sd of a place from which on one detection elsewhere is too little")] = (
        0.01
    )
    absent: Annotated[float, Number("s", OWN, "in view and not reported, after which an object is elsewhere")] = 0.15
    astray: Annotated[
        float, Number("m", OWN, "from where an object was seen, at which it may be found without that place in view")
    ] = 0.5
    disproved: Annotated[
        float, Number("s", OWN, "in view and not reported, after which where an object was seen tells nothing")
    ] = 2.0
    forget: Annotated[
        float, Number("s", OWN, "without a detection, after which a candidate that was not confirmed is forgotten")
    ] = 0.5
    keep: Annotated[float, Number("s", OWN, "the same of one that was")] = 10.0
    rival: Annotated[
        float,
        Number(
            "", OWN, "difference in cost below which another object that is out of view may be the one that is seen"
        ),
    ] = 6.0


class Places(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Believed places of the objects at one observation, odometry frame."""

    names: tuple[str, ...]
    positions: Array  # [m], shape (n, 3)
    variances: Array  # [m^2] per axis, shape (n,)
    seen: Array  # it was seen before, shape (n,), bool
    gate: float  # standard deviations between the place of an object and its detection, at most
    gate_floor: float  # [m] or this far
    agreeing: int  # detections at one place that are believed


class Sight(Protocol):
    """World and camera as the association asks them."""

    def places(self) -> Places:
        """Believed places of the objects."""
        ...

    def in_view(self, point: Array) -> bool:
        """The camera surely sees a point (3,) [m], odometry frame, unless something stands before it."""
        ...

    def in_bin(self, point: Array) -> bool:
        """A point (3,) [m], odometry frame, is in a bin."""
        ...


@dataclass
class Candidate:
    """Something that was detected, and is no object where it is believed."""

    position: Array  # [m] odometry frame, newest, shape (3,)
    stamp: float  # [s] newest
    sd: float  # [m] of the newest position
    count: int = 1
    name: str = ""  # of the object that it is taken for
    likely: str = ""  # of the object that it was matched with, when one detection was too little to say so


@dataclass
class AssociationState:
    """Candidates, missing objects, and the answer for the newest picture."""

    stamp: float = -math.inf  # [s] of the newest picture with detections
    looked: float = -math.inf  # [s] when a picture was last gone through
    names: dict[bytes, str] = field(default_factory=dict)  # of its detections by what they say, "" for none
    candidates: list[Candidate] = field(default_factory=list)
    absent: dict[str, float] = field(default_factory=dict)  # [s] since when an object is in view and not reported
    missed: dict[str, Array] = field(default_factory=dict)  # where the fingers last closed on an object in vain
    lost: list[str] = field(default_factory=list)  # objects that are not where they were believed, and unseen since
    denied: list[tuple[str, Array]] = field(default_factory=list)  # objects, and where something is that is another


def names_of(
    state: AssociationState, found: Sequence[Detection], now: float, held: str | None, sight: Sight,
    settings: AssociationSettings,
) -> tuple[str, ...]:  # fmt: skip
    """Names of detections that have none, "" for those that stay without one. ``now``: [s] of the camera's clock."""
    newest = max((one.stamp for one in found), default=-math.inf)
    if found and newest <= state.stamp:
        return tuple(state.names.get(one.p_base.tobytes(), "") for one in found)
    if not found and now - state.looked < PERIOD - 1e-6:
        return ()
    picture = _Picture(found, _with_likely(sight.places(), state.candidates, newest), held, state.denied, settings)
    candidates = _candidates(state, picture)
    match, all_alike = picture.matched(candidates)
    age = max(0.0, now - newest) if found else 0.0
    _watch_absent(state, picture, match, now, sight)

    def absent(name: str) -> bool:
        return _is_absent(state, name, now, age, settings)

    names = [""] * len(found)
    for k, candidate in enumerate(candidates):
        i = match.get(k, -1)
        if i < 0:
            continue
        candidate.name = ""
        vague = picture.places.variances[i] > settings.vague**2
        sure = not vague or candidate.count > 1
        doubtful = all_alike.get(k) != i or picture.ambiguous(k, i, match, absent)
        name = "" if doubtful and not picture.places.seen[i] else picture.places.names[i]
        names[k], candidate.likely = (name, "") if sure else ("", name)
    _claim(candidates, picture, names, match, sight, absent, state.lost)
    state.lost = [name for name in state.lost if name not in names]
    if found:
        state.stamp = newest
        state.names = {one.p_base.tobytes(): name for one, name in zip(found, names, strict=True)}
    state.looked = now
    _forget(state, picture, names, now, sight)
    return tuple(names)


def unexplained(state: AssociationState, sight: Sight) -> bool:
    """Something is detected again and again where no object is known, and none is missing."""
    agreeing = sight.places().agreeing
    return not state.absent and any(
        one.count > agreeing and not one.name and one.stamp == state.stamp and not sight.in_bin(one.position)
        for one in state.candidates
    )


def disproved(state: AssociationState, now: float, settings: AssociationSettings) -> tuple[str, ...]:
    """Objects that have been in view for long where they are believed, and were not reported: they are lost."""
    found = tuple(name for name, since in state.absent.items() if now - since >= settings.disproved)
    for name in found:
        del state.absent[name]
    state.lost += [name for name in found if name not in state.lost]
    return found


def missed(state: AssociationState, name: str, place: Array, places: Places, settings: AssociationSettings) -> str:
    """The object that must be at a place (3,) [m] where the fingers closed on ``name`` and held nothing; "" for none.

    After a second failure at one place it is the nearest other object, if one is believed within ``pushed`` [m].
    """
    before, state.missed[name] = state.missed.get(name), place.copy()
    if before is None or not state.names or np.abs(place - before).max() >= SAME:
        return ""
    apart = np.abs(places.positions - place).max(axis=1)
    apart[places.names.index(name)] = math.inf
    nearest = int(np.argmin(apart))
    if apart[nearest] >= settings.pushed:
        return ""
    state.denied = [*state.denied, (name, place.copy())][-MOST_DENIED:]
    for one in state.candidates:
        one.name = one.likely = ""
    return places.names[nearest]


def _with_likely(places: Places, candidates: Sequence[Candidate], now: float) -> Places:
    """The places of objects that were never named are where a detection was likely theirs in a picture just before.

    Of two look-alikes side by side, the one that is named first would otherwise be as near to both in the next picture.
    """
    positions, variances = places.positions.copy(), places.variances.copy()
    for one in candidates:
        if one.likely and now - one.stamp <= LIKELY:
            i = places.names.index(one.likely)
            if not places.seen[i]:
                positions[i], variances[i] = one.position, one.sd**2
    return msgspec.structs.replace(places, positions=positions, variances=variances)


class _Picture:
    """The detections of one picture, the objects, and how far they are from each other."""

    def __init__(
        self, found: Sequence[Detection], places: Places, held: str | None, denied: Sequence[tuple[str, Array]],
        settings: AssociationSettings,
    ) -> None:  # fmt: skip
        self.found, self.places, self.settings = found, places, settings
        self.stamp = max((one.stamp for one in found), default=-math.inf)  # [s]
        self.at = np.array([from_frame(one.odometry, one.p_base) for one in found]).reshape(-1, 3)
        self.sd = np.array([one.position_sd for one in found])
        variance = self.sd[:, None] ** 2 + places.variances[None, :]  # (detections, objects)
        apart = self.at[:, None, :] - places.positions[None, :, :]
        self.largest = np.abs(apart).max(axis=2, initial=0.0)
        square = apart[:, :, 0] ** 2 + apart[:, :, 1] ** 2 + apart[:, :, 2] ** 2
        self.distance = np.sqrt(square)
        floor = places.gate_floor / places.gate
        spread = [[6.0 * math.log(math.sqrt(value) + floor) for value in row] for row in variance.tolist()]
        self.cost = square / (np.sqrt(variance) + floor) ** 2 + np.array(spread).reshape(variance.shape)
        self.free = np.array([name != held for name in places.names], dtype=bool).reshape(-1)
        self.allowed = np.repeat(self.free[None, :], len(found), axis=0)
        for name, place in denied:
            there = np.abs(self.at - place).max(axis=1, initial=0.0) < SAME
            self.allowed[there, places.names.index(name)] = False
        inside = self.largest <= places.gate_floor + places.gate * np.sqrt(variance)
        self.possible = inside & self.allowed

    def matched(self, candidates: Sequence[Candidate]) -> tuple[dict[int, int], dict[int, int]]:
        """Object of each matched detection: within the gates first, then within ``pushed`` [m] for moved objects.

        New detections near no object seen before are matched last, so that a false one cannot take another's object.
        The second result treats all alike: an object that was never seen is named only when both agree.
        """
        more = np.array([one.count > 1 for one in candidates], dtype=bool)
        seen = np.asarray(self.places.seen, dtype=bool)[None, :]
        again = more | (self.possible & seen).any(axis=1)
        match, all_alike = _assigned(self.cost, self.possible & again[:, None]), _assigned(self.cost, self.possible)
        match |= _assigned(self.cost, self.possible & self._left(match))
        near = self._left(match) & (self.distance < self.settings.pushed) & self.allowed & seen
        return match | _assigned(self.distance, near), all_alike

    def _left(self, match: dict[int, int]) -> NDArray[np.bool_]:
        """Detections and objects that are not matched yet."""
        left = np.ones_like(self.possible)
        left[list(match), :] = False
        left[:, list(match.values())] = False
        return left

    def ambiguous(self, k: int, i: int, match: dict[int, int], absent: Callable[[str], bool]) -> bool:
        """Another object that was never seen may as well be what is detected, unless its place is seen to be empty.

        One picture does not show that: it is the other object, and that of the match is not in view yet.
        """
        taken = set(match.values())
        for other in np.flatnonzero(self.possible[k] & np.logical_not(self.places.seen)).tolist():
            near = self.cost[k, other] - self.cost[k, i] < self.settings.rival
            if other != i and other not in taken and near and not absent(self.places.names[other]):
                return True
        return False


def _assigned(cost: Array, possible: NDArray[np.bool_]) -> dict[int, int]:
    """Rows and columns that belong together: as many as can be, then with the least cost."""
    if not possible.any():
        return {}
    allowed = cost[possible]
    low = float(allowed.min())
    wide = float(allowed.max()) - low + 1.0
    beyond = wide * (1 + min(cost.shape))  # more than all others together
    rows, columns = linear_sum_assignment(np.where(possible, cost - low, beyond))
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if possible[r, c]}


def _candidates(state: AssociationState, picture: _Picture) -> list[Candidate]:
    """The detections, each seen once more or for the first time."""
    old, places = [one for one in state.candidates if one.stamp < picture.stamp], picture.places
    there = np.array([one.position for one in old]).reshape(-1, 3)
    apart = picture.at[:, None, :] - there[None, :, :]
    reach = places.gate_floor + places.gate * math.sqrt(2.0) * picture.sd
    same = _assigned(np.sqrt((apart**2).sum(axis=2)), np.abs(apart).max(axis=2, initial=0.0) <= reach[:, None])
    found = []
    for k, (at, sd) in enumerate(zip(picture.at, picture.sd.tolist(), strict=True)):
        if k in same:
            one = old[same[k]]
            one.position, one.stamp, one.sd, one.count = at.copy(), picture.stamp, sd, one.count + 1
        else:
            one = Candidate(at.copy(), picture.stamp, sd)
            state.candidates = [*state.candidates, one][-MOST_CANDIDATES:]
        found.append(one)
    return found


def _watch_absent(state: AssociationState, picture: _Picture, match: dict[int, int], now: float, sight: Sight) -> None:
    """Since when each object is in view and not reported."""
    reported = set(match.values())
    for i, name in enumerate(picture.places.names):
        if i in reported or not picture.free[i] or not sight.in_view(picture.places.positions[i]):
            state.absent.pop(name, None)
        else:
            state.absent.setdefault(name, now)


def _is_absent(state: AssociationState, name: str, now: float, age: float, settings: AssociationSettings) -> bool:
    since = state.absent.get(name)
    return since is not None and now - since >= settings.absent + age


def _claim(
    candidates: Sequence[Candidate], picture: _Picture, names: list[str], match: dict[int, int], sight: Sight,
    absent: Callable[[str], bool], lost: Sequence[str],
) -> None:  # fmt: skip
    """Confirmed candidates are the objects that are missing or ``lost``, the nearest first."""
    places, taken, settings = picture.places, {*match.values()}, picture.settings
    pairs = []
    for k in range(len(names)):
        if k in match:
            continue
        one = candidates[k]
        if one.count < places.agreeing:
            continue
        in_bin = sight.in_bin(picture.at[k])
        for i, name in enumerate(places.names):
            if i in taken or not picture.allowed[k, i]:
                continue
            same_bin = in_bin and sight.in_bin(places.positions[i])
            astray = not in_bin and picture.distance[k, i] < settings.astray and not sight.in_view(places.positions[i])
            astray = astray and (name in lost or (one.count >= 2 * places.agreeing and places.seen[i]))
            if absent(name) or same_bin or astray or one.name == name:
                pairs.append((one.name != name, not same_bin, float(picture.distance[k, i]), k, i, one))
    done: set[int] = set()
    for *_, k, i, one in sorted(pairs, key=lambda pair: pair[:5]):
        if k not in done and i not in taken:
            done.add(k)
            taken.add(i)
            names[k] = one.name = places.names[i]


def _forget(state: AssociationState, picture: _Picture, names: Sequence[str], now: float, sight: Sight) -> None:
    """Candidates that are objects where these are believed, that did not come again, or are in view and gone."""
    settings, own = picture.settings, [at for at, name in zip(picture.at, names, strict=True) if name]
    kept = []
    for one in state.candidates:
        explained = not one.name and any(np.array_equal(one.position, at) for at in own)
        out_of_view = one.count >= picture.places.agreeing and not sight.in_view(one.position)
        limit = settings.keep if out_of_view else settings.forget
        if not explained and now - one.stamp <= limit:
            kept.append(one)
    state.candidates = kept
