"""Methods by name: the paper's and its ablations, `fast`, rivals, and a user's own from a file."""

import importlib.util
import math
import sys
from pathlib import Path

import msgspec
import numpy as np

from motm_twin.control.method import BaseChoices, Materials, Method, PlannerParts, make_way
from motm_twin.control.tuning import PRESETS
from motm_twin.model.edits import ParameterValue
from motm_twin.model.geometry import frozen
from motm_twin.model.names import MethodError, hint
from motm_twin.model.state import HasState
from motm_twin.perception.still_map import FilteredMap, StaticMap
from motm_twin.perception.tracks import VX, VY, stationary_points
from motm_twin.planning.commitment import KeepPlans
from motm_twin.planning.every_ring import EveryRing
from motm_twin.planning.in_time import InTime
from motm_twin.planning.prediction import GOES
from motm_twin.planning.types import BaseProblem
from motm_twin.rivals.holistic import HOLISTIC
from motm_twin.rivals.motm2022 import MOTM2022
from motm_twin.rivals.open_loop import OPEN_LOOP
from motm_twin.rivals.orca import ORCA
from motm_twin.rivals.stationary import STATIONARY

MOTM = Method(
    name="motm",
    title="MotM, reactive base",
    summary="The paper's method; its search ends when the job is predicted to be done.",
    source="Paper",
    chosen=(
        "Termination by the predicted end of the job instead of a path that passes the candidate, and driving on to "
        "the next target from there; a proximity penalty of 0.3 s over 0.12 m of clearance instead of STAA*'s grid."
    ),
)

PAPER_LITERAL = Method(
    name="paper_literal",
    title="Paper, as printed",
    summary="The search ends when a path passes the candidate; STAA*'s proximity grid gives the penalty.",
    source="Paper, Sec. III and IV",
    chosen=(
        "'Sufficiently close' is 0.15 m and 20 deg: the paper gives no number. What it leaves open is as of motm: "
        "margins, hysteresis of the placement, speeds in the closed list."
    ),
    parameters=PRESETS["The paper's words"],
)

STAA = Method(
    name="staa",
    title="STAA* without the paper's changes",
    summary="STAA*'s own search; placement, arm, limits, local region and closed list are those of the other methods.",
    source="Missura et al., Short-Term Aborting A*",
    known="The authors' code, and with it every number of the search.",
    chosen=(
        "Ours: limits, margins and braking test; a disc of 3.5 m instead of a box of 8 m; obstacles grown by 0.33 m "
        "instead of 0.6 m; speeds in the closed list; 300 expansions instead of 36 ms. What moves is expected for 1 s, "
        "from what the lidar has seen of it instead of from the simulator, and in the search only: costs to the goal "
        "have it where it is. The search ends within 0.15 m of the candidate's position."
    ),
    parameters=PRESETS["STAA*"],
)


def _ablation(name: str, title: str, what: str, section: str, **parameters: ParameterValue) -> Method:
    return Method(
        name=name,
        title=title,
        summary=f"The paper's method without {what}.",
        source=f"Paper, Sec. {section}",
        parameters=parameters,
    )


ABLATIONS = (
    _ablation("no_goal_orientation", "no goal orientation", "the candidate's heading", "III-A", goal_orientation=False),
    _ablation("no_rotation_cost", "no rotation cost", "rotation in the global cost", "III-B", rotation_cost=False),
    _ablation("no_pass_through", "no pass-through", "ending the search on the way", "III-C", termination="reach_goal"),
    _ablation("no_penalty_scaling", "no penalty scaling", "the fading penalty", "III-D", scale_penalty=False),
    _ablation("no_bezier", "no Bezier", "the Bezier heuristic", "III-E", bezier=False),
    _ablation("no_next_target", "no next target", "the way on to the next target", "IV", next_weight=0.0),
    _ablation("no_arm_avoidance", "no arm avoidance", "the arm's obstacle avoidance", "V", arm_avoidance=False),
)


class IgnoreFarMovers:
    """The map without distant dynamic obstacles, which will have moved when the robot arrives."""

    def __init__(self, parts: PlannerParts, quick: float = math.inf) -> None:
        """``quick`` [m/s]: faster tracks go on and are predicted; slower ones that are in the map yield."""
        self._tracks, self._quick = parts.tracks, quick
        self.without_far = FilteredMap(parts.known)
        self.still = StaticMap(parts.known, self._tracks)  # without the near dynamic obstacles, too

    def of(self, problem: BaseProblem) -> BaseProblem:
        """The problem in that map; unchanged without such obstacles if ``quick`` is inf."""
        world = problem.world
        gone = world.movers[world.movers[:, 5] == 0.0][:, :5]
        if self._quick == math.inf:
            kept = self.without_far.keep(world, stationary_points(world, gone, self._tracks))
            return problem if kept is world else msgspec.structs.replace(problem, world=kept)
        speed = np.hypot(world.tracks[:, VX], world.tracks[:, VY])
        go_on, yields = world.tracks[speed >= self._quick], world.tracks[(speed >= GOES) & (speed < self._quick)]
        kept = self.without_far.keep(
            world, stationary_points(world, np.concatenate((gone, go_on[:, :5])), self._tracks)
        )
        kept = msgspec.structs.replace(kept, tracks=frozen(go_on))
        return msgspec.structs.replace(problem, world=kept, yielding=yields)

    def memory(self) -> dict[str, HasState]:
        """Both maps."""
        return {"standing": self.without_far, "still": self.still}


def expect_tracks(parts: PlannerParts) -> IgnoreFarMovers:
    """The map without dynamic obstacles that are far away, or that do not yield."""
    return IgnoreFarMovers(parts, parts.parameters.foresight.quick)


def all_rings(materials: Materials) -> EveryRing:
    """Candidates on all rings; where none is viable, and with the view of `fast`, places to wait."""
    view = materials.view
    return EveryRing(view.still if isinstance(view, IgnoreFarMovers) else None)


def all_rings_in_time(materials: Materials) -> InTime:
    """Candidates on all rings, each judged by the dynamic obstacles expected on arrival."""
    return InTime(all_rings(materials), materials.parts.known.robot.base.velocity_lag)


def keep_plans(materials: Materials) -> KeepPlans:
    """Commitment that keeps a plan until a better one is found."""
    return KeepPlans(materials.parts.parameters.commitment)


FAST = Method(
    name="fast",
    title="MotM, fast",
    summary="The paper's method, but it keeps its plans, considers all rings, and ignores moving obstacles far away.",
    source="own",
    chosen=(
        "A plan is kept until a search finds one that is cheaper than the rest of it. Candidates lie on all rings of "
        "0.6 to 0.8 m; the chosen one stays among them while its footprint is free. Dynamic obstacles count only "
        "within 2.0 m. Where they leave a target no candidate, the robot waits beside the one that it can be at "
        "soonest. Where it creeps and cannot turn on the spot, costs come from a lattice on which the footprint is "
        "free. Every node tries 5 x 5 accelerations, for half the computing, and of plans of equal time the steadier "
        "one is taken."
    ),
    parameters={"bezier_offset": 0.1, "notches": 5, "steadiness": 0.02},
    planner=BaseChoices(view=IgnoreFarMovers, candidates=all_rings, commitment=keep_plans),
)

FORESIGHT = Method(
    name="foresight",
    title="MotM, with foresight",
    summary="Like fast, but it predicts others, passes behind those who do not yield, and is passively safe.",
    source="own",
    chosen=(
        "Those who are slow are expected to yield, as in `fast`, but their time counts twice. "
        "Others go on straight, in ellipses that grow. Candidates, ways to them and nodes of the search "
        "cost what the probability of a meeting says at the time when the base is there; a place that is free soon "
        "is waited for. The others' time that a plan takes is a cost. Where the search meets somebody, one in layers "
        "looks 6 s ahead; last comes the motion that stays clear best. The base stands before anything that goes on as "
        "it does is there, or moves away from it; the arm keeps from where that will be in half a second. "
        "Where others keep it from an object for 5 s, it takes the next one first."
    ),
    parameters={
        **FAST.parameters,
        "passive_safety": True,
        "risk_weight": 10.0,
        "courtesy_weight": 2.0,
        "arm_prediction": 0.5,
        "other_order": 5.0,
    },
    planner=BaseChoices(view=expect_tracks, candidates=all_rings_in_time, commitment=keep_plans, evasion=make_way),
)


METHODS: dict[str, Method] = {
    method.name: method
    for method in (
        MOTM,
        PAPER_LITERAL,
        *ABLATIONS,
        STAA,
        MOTM2022,
        HOLISTIC,
        *STATIONARY,
        OPEN_LOOP,
        ORCA,
        FAST,
        FORESIGHT,
    )
}


def find_method(name: str) -> Method:
    """The method of this name, or of ``FILE.py:NAME``, a `Method` of that name in a file of the user's.

    Raises MethodError. A file is run, with the rights of whoever named it: never a name that came over the network.
    """
    if name in METHODS:
        return METHODS[name]
    file, colon, variable = name.rpartition(":")
    if colon and file.endswith(".py"):
        return _from_file(Path(file), variable)
    raise MethodError(f"there is no method {name!r}; {hint(name, METHODS)}; or give FILE.py:NAME of your own")


def _from_file(file: Path, variable: str) -> Method:
    if not file.is_file():
        raise MethodError(f"{file}: there is no such file")
    module_name = f"motm_twin_user_{file.stem}"
    spec = importlib.util.spec_from_file_location(module_name, file.resolve())
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise MethodError(f"{file} cannot be run: {type(error).__name__}: {error}") from error
    found = getattr(module, variable, None)
    if not isinstance(found, Method):
        names = [key for key, value in vars(module).items() if isinstance(value, Method)]
        raise MethodError(f"{file} has no Method called {variable!r}; {hint(variable, names)}")
    if found.name in METHODS:
        raise MethodError(f"{file}: {variable} is named {found.name!r}, as a shipped method is: give it another name")
    return found
