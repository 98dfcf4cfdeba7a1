"""Makes the sessions of this folder anew: ``python tests/recorded/make_sessions.py``.

Only needed when their story or the format of sessions changes. After a wanted change of behaviour the same stories get
their new state with ``motm-twin rerun FILE --update``.
"""

from pathlib import Path

from motm_twin.model.edits import (
    AddObstacle,
    Announce,
    FreezeBody,
    InjectFault,
    MoveBody,
    MoveObject,
    MoveTask,
    PushRobot,
    ReleaseBody,
    SendAgent,
    SetParameter,
)
from motm_twin.model.scene_file import load_scene
from motm_twin.planning.types import SearchBudget
from motm_twin.record.replay import rerun, updated
from motm_twin.sessions.branches import Branches
from motm_twin.sessions.session import save_session
from motm_twin.twin import Twin

FOLDER = Path(__file__).parent


class Clock:
    """Looks at this clock are 1 ms apart: searches are cut as on a slow machine, the same ones every time."""

    def __init__(self):
        self.looks = 0

    def __call__(self):
        self.looks += 1
        return 1e-3 * self.looks


def run(twin, branches, periods, story):
    """Until period ``periods`` is next."""
    while twin.index < periods:
        branches.note(twin, twin.index)
        for edit in story.get(twin.index, []):
            twin.post(edit)
        twin.advance()


def temi_dragged_before_the_robot():
    """A Temi is put beside the way, dragged into it at 1 m/s, thrown off, sent back, and frozen."""
    story = {20: [AddObstacle(name="guest", shape="temi", x=2.2, y=-1.2)]}
    story |= {40 + 2 * k: [MoveBody(name="guest", x=2.2, y=-1.2 + 0.1 * k)] for k in range(13)}
    story |= {
        80: [ReleaseBody(name="guest", velocity=(0.3, -0.8))],
        120: [SendAgent(name="guest", x=2.6, y=0.2)],
        200: [FreezeBody(name="guest")],
    }
    twin = Twin(load_scene("exp1", "trial1", 0))
    run(twin, Branches(), 280, story)
    return twin.session("A Temi is dragged before the robot")


def furniture_moved_and_announced():
    """The table of a bin is pushed away; the map is told later. A blind second, a push."""
    story = {
        30: [MoveBody(name="drop1_round_table", x=4.6, y=-1.7, held=False)],
        70: [InjectFault(fault="lidar_off", seconds=1.0)],
        110: [Announce(name="drop1_round_table")],
        150: [PushRobot(dx=0.04, dy=-0.03, turn=0.1)],
        170: [MoveBody(name="cabinet", x=0.6, y=-1.9, heading=0.4, held=False), Announce(name="cabinet")],
    }
    twin = Twin(load_scene("exp1", "trial3", 2))
    run(twin, Branches(), 300, story)
    return twin.session("Furniture is moved, and announced later")


def branch_with_other_parameters():
    """Ten seconds, back to 4.5 s, on with other parameters and another order; the clock cuts searches."""
    twin = Twin(
        load_scene("exp2", "random", 3),
        parameters={"hysteresis": 0.5},
        budget=SearchBudget(seconds=0.003),
        clock=Clock(),
    )
    cube = twin.scene.objects[2]
    branches = Branches()
    run(
        twin,
        branches,
        200,
        {50: [AddObstacle(name="crate", x=3.0, y=-0.4)], 130: [SetParameter(name="bezier", value=False)]},
    )
    branches.branch(twin, 90)
    story = {
        90: [SetParameter(name="next_weight", value=0.5), SetParameter(name="rotation_cost", value=False)],
        120: [MoveTask(index=4, to=2)],
        140: [MoveObject(name=cube.name, x=cube.position[0] + 0.1, y=cube.position[1])],
        190: [SetParameter(name="next_weight"), MoveBody(name="crate", x=3.2, y=-0.8, held=False)],
    }
    run(twin, branches, 260, story)
    return twin.session("A branch with other parameters")


def main():
    """Write the files, each with the track of its rerun."""
    for make in (temi_dragged_before_the_robot, furniture_moved_and_announced, branch_with_other_parameters):
        session = make()
        again = rerun(session)
        assert again.ok, make.__name__
        save_session(updated(session, again), FOLDER / f"{make.__name__}.json")
        print(f"{make.__name__}: {session.periods} periods, {len(session.edits)} edits, {len(session.cuts)} cuts")


if __name__ == "__main__":
    main()
