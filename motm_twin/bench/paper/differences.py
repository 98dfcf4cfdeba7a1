"""What is otherwise here than in the paper: what it leaves open, what we changed, what we cannot compare."""

from motm_twin.bench.measures.gripper import STATIC_AFTER
from motm_twin.bench.paper.html import paragraphs, table, text
from motm_twin.control.arm.parameters import AvoidanceParameters
from motm_twin.methods.registry import METHODS
from motm_twin.perception.movers import MoverParameters

OPEN = (
    (
        "Speed limits of the base",
        "0.5 m/s and 100°/s: those of the paper's Bézier figure, which reproduce its task times",
        "Sec. III-E",
    ),
    ("Accelerations of the base", "0.5 m/s² and 1.75 rad/s²: not published, chosen here", "-"),
    (
        "'Sufficiently close' of the search's termination",
        "paper_literal: 0.15 m and 20°; motm predicts when the job is done",
        "Sec. III-C",
    ),
    ("Noise of localisation, lidar, camera and slots", "1 cm and 0.5°, 1 cm, 2 mm to 2 cm, 3 cm: chosen here", "-"),
    ("Field of view of the lidar", "all round, at 0.2 m: not published", "-"),
    (
        "Height of the table, size of the bins",
        "0.78 m ± 0.02 m and 0.4 m: measured in the authors' pictures",
        "Sec. VI",
    ),
    ("Which drop location comes first", "drop location 1", "Sec. VI-B"),
    ("The second box of Experiment 1a", "where its label says; the drawing has it 0.17 m further left", "Sec. VI-C"),
    ("The fifty random arrangements", "drawn anew from seeds 0 to 49: the paper's are not published", "Sec. VI-B"),
    (
        "Routes and speed of the Temis",
        "round the table in both directions at 0.4 m/s, yielding: not published",
        "Sec. VI-D",
    ),
)
CHANGED = (
    "The termination of motm is not the printed one: a node finishes the search when the job is predicted to be done "
    "on the "
    "way past, and nodes after it are judged by their way on to the next target. paper_literal has the printed one; "
    "both are "
    "in the tables.",
    "The proximity penalty of motm is 0.3 s over 0.12 m of clearance; STAA*'s grid over 0.6 m costs about 6 s per "
    "trial beside a "
    "table. paper_literal has the grid.",
    "Besides the gripper's centre (Sec. V), elbow, forearm and wrist keep off what the lidar sees, and the whole arm "
    "keeps off "
    "mapped furniture.",
    "A static obstacle beside the target lets its d_s shrink during the grasp: else the object could not be reached. "
    f"Static is what was never seen to move and has been in the same place for {STATIC_AFTER:g} s, or was seen to move "
    f"and has rested for {MoverParameters().waits:g} s since. Others keep {AvoidanceParameters().d_s} m.",
    "The damper line bounds the speed of approach. As printed it reads as a bound of the distance's rate.",
)
CANNOT = (
    "Reister et al. ran their methods on ARMAR-6, with 1.55 m of reach. Here they run on Frankie with 0.855 m, on "
    "the same base "
    "controller and limits as the paper's method: our rivals, at their best, are not their systems. The published "
    "reductions "
    "compare published times; ours compare methods on one robot. Both are shown, and neither replaces the other.",
    "The paper simulated in Unity, and measured ten trials on a real robot. This is another simulation, with "
    "contacts judged by "
    "a referee that shares no code with the controller; it says nothing of a real gripper's grasp.",
    "Box plots of the paper have no numbers. None were read off: only what Table I prints is drawn as published.",
)


def body() -> str:
    """The section, as HTML."""
    methods = [
        (
            method.title,
            name,
            method.source,
            method.known or "-",
            method.chosen or "-",
            ", ".join(f"{key} = {value}" for key, value in method.parameters.items()) or "as shipped",
        )
        for name, method in METHODS.items()
    ]
    return (
        "<h3>What the paper leaves open, and what is taken here</h3>"
        + table(("What", "Here", "Paper"), OPEN)
        + "<h3>What is done otherwise</h3>"
        + paragraphs(CHANGED)
        + "<h3>What cannot be compared</h3>"
        + paragraphs(CANNOT)
        + "<h3>Every method: what was known, and what was chosen</h3>"
        + table(("Method", "Name", "Source", "Known", "Chosen here", "Parameters"), methods)
        + f"<p>{text('docs/method.md gives the reason of every choice.')}</p>"
    )
