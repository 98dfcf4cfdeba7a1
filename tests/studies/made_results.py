"""Made-up results of trials, of which everything is known, and parts of the report; a scene that takes no time."""

from pathlib import Path

from motm_twin.sessions.session import SOURCE, made_with
from motm_twin.studies.paper.data import TEN
from motm_twin.studies.paper.drawing import Drawn
from motm_twin.studies.paper.episode import Episode, Moment
from motm_twin.studies.spec import TrialSpec

SCENE = str(Path(__file__).parent / "half_a_metre.yaml")


def result(method="motm", variant="trial1", time_s=80.0, *, hits=0, excess=None, **changes):
    """A trial of Experiment 1 that was completed, with ``hits`` contacts that the robot caused."""
    made = {
        "scene": "exp1", "method": method, "variant": variant, "seed": 0, "success": not hits, "time_s": time_s,
        "picks_done": 6, "picks_total": 6, "places_done": 6, "places_total": 6, "contacts": [],
        "contacts_caused_by_robot": hits, "path_length_m": 40.0, "parameters": {}, "changes": {}, "reason": "",
        "measures": {
            "phases_s": {"driving": time_s - 10.0, "closing": 5.0, "waiting_for_arm": 3.0, "stationary": 2.0},
            "moving_share": 0.9, "retries": 0, "cut_ins": [], "near_misses": [], "evasive_manoeuvres": [],
            "approach_excess_mps": excess,
        },
    }  # fmt: skip
    return made | changes


def trials(method="motm", seconds=(80.0,) * 10, **changes):
    """The published arrangements in turn."""
    return [result(method, variant, value, **changes) for variant, value in zip(TEN, seconds, strict=False)]


def seeds(seconds, method="motm", variant="random", first=0, **changes):
    """Random arrangements, or one variant, with one seed after the other."""
    return [result(method, variant, value, seed=seed, **changes) for seed, value in enumerate(seconds, first)]


def drawn(part):
    """The part, which is not missing."""
    assert isinstance(part, Drawn)
    return part


def moment(index, temi, **changes):
    """A period of Experiment 2 with one Temi at x, y and yaw."""
    made = {
        "time": 0.05 * index, "pose": (0.0, 0.0, 0.0), "task": "", "phase": "stow", "distance": 0.5, "static": False,
        "agents": (("temi_1", *temi),), "plan": (), "path": (), "goal": (0.0, 0.0), "target": None,
    }  # fmt: skip
    return Moment(**made | changes)


def episode(distances=(1.0,) * 100, moments=(), **measures):
    """A watched trial with these measures, in which a Temi drives past."""
    found = {"below_d_s": [], "cut_ins": [], "approach_excess_mps": None, "advance_excess_mps": None}
    passing = [moment(k, (1.0, 0.02 * k, 0.0), distance=each) for k, each in enumerate(distances)]
    return Episode(spec=TrialSpec("exp2", "random", 3, "motm"), source=made_with()[SOURCE],
                   moments=tuple(moments or passing), result={}, measures=found | measures)  # fmt: skip
