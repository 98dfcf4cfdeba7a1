"""The paper's method, the paper to the letter, and every modification of STAA* switched off alone."""

from motm_twin.control.method import Method
from motm_twin.control.tuning import PRESETS
from motm_twin.model.edits import ParameterValue

MOTM = Method(
    name="motm",
    title="MotM, reactive base",
    summary="The paper's method with a termination that predicts when the job is done.",
    source="Paper",
    chosen=(
        "Termination by the predicted end of the job instead of a path that passes the candidate, and driving on to "
        "the next target from there; a proximity penalty of 0.3 s over 0.12 m of clearance instead of STAA*'s grid."
    ),
)

PAPER_LITERAL = Method(
    name="paper_literal",
    title="Paper, as printed",
    summary="Finishes when a path passes the candidate, with STAA*'s proximity grid.",
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
    summary=(
        "The search of STAA* under the same placement and arm, with the limits, local region and closed list of all "
        "methods."
    ),
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


def _without(name: str, title: str, what: str, section: str, **parameters: ParameterValue) -> Method:
    return Method(
        name=name,
        title=title,
        summary=f"The paper's method without {what}.",
        source=f"Paper, Sec. {section}",
        parameters=parameters,
    )


ABLATIONS = (
    _without("no_goal_orientation", "no goal orientation", "the candidate's heading", "III-A", goal_orientation=False),
    _without("no_rotation_cost", "no rotation cost", "rotation in the global cost", "III-B", rotation_cost=False),
    _without("no_pass_through", "no pass-through", "finishing on the way past", "III-C", termination="reach_goal"),
    _without("no_penalty_scaling", "no penalty scaling", "the fading penalty", "III-D", scale_penalty=False),
    _without("no_bezier", "no Bezier", "the Bezier heuristic", "III-E", bezier=False),
    _without("no_next_target", "no next target", "the way on to the next target", "IV", next_weight=0.0),
    _without("no_arm_avoidance", "no arm avoidance", "the arm's obstacle avoidance", "V", arm_avoidance=False),
)
