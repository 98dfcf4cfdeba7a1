"""Data association: names anonymous detections after objects, by the believed positions of the objects.

All detections of a picture are matched with objects at once: as many as possible, at the least total cost (global
nearest neighbour; a cost is a negative log-likelihood). An unmatched detection is a candidate. Seen repeatedly at one
place, it is taken for an object that is missing from its believed position; seen once, it is ignored.
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

MOST_CANDIDATES = 50  # remembered; the oldest are dropped
MOST_DENIED = 20  # remembered; the oldest are dropped
SAME = 0.03  # [m] per axis: positions nearer than this are the same place
LIKELY = 0.2  # [s] for which a single likely detection of a never named object replaces its believed position


class AssociationSettings(msgspec.Struct, frozen=True, kw_only=True):
    """Limits of the matching; choices of this project."""

    pushed: Annotated[
        float,
        Number("m", OWN, "distance from its believed place within which an unmatched detection is a pushed object"),
    ] = 0.15
    vague: Annotated[
        float, Number("m", OWN, "sd of its believed place above which one detection is too little to name an object")
    ] = 0.01
    absent: Annotated[
        float,
        Number("s", OWN, "time in view without a detection after which an object is missing from its believed place"),
    ] = 0.15
    astray: Annotated[
        float, Number("m", OWN, "distance from its believed place, out of view, within which an object may be found")
    ] = 0.5
    disproved: Annotated[
        float,
        Number("s", OWN, "time in view without a detection after which an object's estimate is dropped for its prior"),
    ] = 2.0
    forget: Annotated[
        float, Number("s", OWN, "time without a detection after which an unconfirmed candidate is deleted")
    ] = 0.5
    keep: Annotated[
        float,
        Number("s", OWN, "time without a detection after which a confirmed candidate that is out of view is deleted"),
    ] = 10.0
    rival: Annotated[
        float,
        Number(
            "",
            OWN,
            "cost difference below which a detection may as well be another object never seen: it stays unnamed",
        ),
    ] = 6.0


class Places(msgspec.Struct, frozen=True, kw_only=True, eq=False):
    """Believed positions of the objects at one observation, odometry frame."""

    names: tuple[str, ...]
    positions: Array  # [m], shape (n, 3)
    variances: Array  # [m^2] per axis, shape (n,)
    seen: Array  # mask of objects that were seen before, shape (n,), bool
    gate: float  # largest distance of a detection from its object, in standard deviations
    gate_floor: float  # [m] added to the gate
    agreeing: int  # number of detections at one place from which they are believed


class Sight(Protocol):
    """Queries of the association about objects, camera and bins."""

    def places(self) -> Places:
        """Believed positions of the objects."""
        ...

    def in_view(self, point: Array) -> bool:
        """True when a point (3,) [m], odometry frame, is surely in view, unless an unknown obstacle hides it."""
        ...

    def in_bin(self, point: Array) -> bool:
        """True when a point (3,) [m], odometry frame, is in a bin."""
        ...


@dataclass
class Candidate:
    """A place of detections that match no object at its believed position."""

    position: Array  # [m] odometry frame, newest, shape (3,)
    stamp: float  # [s] newest
    sd: float  # [m] of the newest position
    count: int = 1
    name: str = ""  # object that it is taken for; "" for none
    likely: str = ""  # object that it was matched with, while one detection is not enough to name it


@dataclass
class AssociationState:
    """Candidates, missing objects, and the names given in the newest picture."""

    stamp: float = -math.inf  # [s] of the newest picture with detections
    looked: float = -math.inf  # [s] time of the last update
    names: dict[bytes, str] = field(default_factory=dict)  # of its detections, by the bytes of `p_base`; "" for none
    candidates: list[Candidate] = field(default_factory=list)
    absent: dict[str, float] = field(default_factory=dict)  # [s] since when an object has been in view, not reported
    missed: dict[str, Array] = field(default_factory=dict)  # position of the last failed grasp of each object
    lost: list[str] = field(default_factory=list)  # objects not found at their believed positions, and unseen since
    denied: list[tuple[str, Array]] = field(default_factory=list)  # a name, and a position where a different object is


def names_of(
    state: AssociationState, found: Sequence[Detection], now: float, held: str | None, sight: Sight,
    settings: AssociationSettings,
) -> tuple[str, ...]:  # fmt: skip
    """Names for anonymous detections; "" for one that stays unnamed. ``now``: time on the camera's clock [s]."""
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
    """True when something is detected repeatedly where no object is known, and no object is missing."""
    agreeing = sight.places().agreeing
    return not state.absent and any(
        one.count > agreeing and not one.name and one.stamp == state.stamp and not sight.in_bin(one.position)
        for one in state.candidates
    )


def disproved(state: AssociationState, now: float, settings: AssociationSettings) -> tuple[str, ...]:
    """Objects whose believed position has long been in view without a report; they count as lost from now on."""
    found = tuple(name for name, since in state.absent.items() if now - since >= settings.disproved)
    for name in found:
        del state.absent[name]
    state.lost += [name for name in found if name not in state.lost]
    return found


def missed(state: AssociationState, name: str, place: Array, places: Places, settings: AssociationSettings) -> str:
    """Object that is really at a place (3,) [m] where the fingers closed on ``name`` and held nothing; "": unknown.

    After a second failure at one place, it is the nearest other object that is believed within ``pushed`` [m].
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
    """The places, with each object never named at its likely detection, if that is at most `LIKELY` [s] old.

    Otherwise the first of two look-alikes to be named would be as near to both detections of the next picture.
    """
    positions, variances = places.positions.copy(), places.variances.copy()
    for one in candidates:
        if one.likely and now - one.stamp <= LIKELY:
            i = places.names.index(one.likely)
            if not places.seen[i]:
                positions[i], variances[i] = one.position, one.sd**2
    return msgspec.structs.replace(places, positions=positions, variances=variances)


class _Picture:
    """The detections of one picture, the objects, and the distances and costs of all pairs."""

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

        New detections in no gate of an object seen before are matched after the others, so that a false one takes no
        object from them. The second result matches all at once: a never seen object is named only if both agree.
        """
        more = np.array([one.count > 1 for one in candidates], dtype=bool)
        seen = np.asarray(self.places.seen, dtype=bool)[None, :]
        again = more | (self.possible & seen).any(axis=1)
        match, all_alike = _assigned(self.cost, self.possible & again[:, None]), _assigned(self.cost, self.possible)
        match |= _assigned(self.cost, self.possible & self._left(match))
        near = self._left(match) & (self.distance < self.settings.pushed) & self.allowed & seen
        return match | _assigned(self.distance, near), all_alike

    def _left(self, match: dict[int, int]) -> NDArray[np.bool_]:
        """Mask of the pairs whose detection and object are both unmatched."""
        left = np.ones_like(self.possible)
        left[list(match), :] = False
        left[:, list(match.values())] = False
        return left

    def ambiguous(self, k: int, i: int, match: dict[int, int], absent: Callable[[str], bool]) -> bool:
        """True when detection ``k`` fits another object, unmatched and never seen, about as well as its match ``i``.

        That object is excluded once its place is seen to be empty. One picture is not enough: the match may not be in
        view yet.
        """
        taken = set(match.values())
        for other in np.flatnonzero(self.possible[k] & np.logical_not(self.places.seen)).tolist():
            near = self.cost[k, other] - self.cost[k, i] < self.settings.rival
            if other != i and other not in taken and near and not absent(self.places.names[other]):
                return True
        return False


def _assigned(cost: Array, possible: NDArray[np.bool_]) -> dict[int, int]:
    """Assignment of rows to columns: as many as possible, then at the least total cost."""
    if not possible.any():
        return {}
    allowed = cost[possible]
    low = float(allowed.min())
    wide = float(allowed.max()) - low + 1.0
    beyond = wide * (1 + min(cost.shape))  # more than all possible pairs together
    rows, columns = linear_sum_assignment(np.where(possible, cost - low, beyond))
    return {int(r): int(c) for r, c in zip(rows, columns, strict=True) if possible[r, c]}


def _candidates(state: AssociationState, picture: _Picture) -> list[Candidate]:
    """Candidate of each detection: one of earlier pictures at its place, or a new one."""
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
    """Update the time since which each object is in view, but not reported."""
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
    """Name confirmed candidates after objects that are missing, ``lost`` or in the same bin.

    Order of the pairs: those with the name from before, those in the same bin, the nearest.
    """
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
    """Drop candidates that match an object at its believed position, and those not detected again for a while."""
    settings, own = picture.settings, [at for at, name in zip(picture.at, names, strict=True) if name]
    kept = []
    for one in state.candidates:
        explained = not one.name and any(np.array_equal(one.position, at) for at in own)
        out_of_view = one.count >= picture.places.agreeing and not sight.in_view(one.position)
        limit = settings.keep if out_of_view else settings.forget
        if not explained and now - one.stamp <= limit:
            kept.append(one)
    state.candidates = kept
