"""Joints that stick while the hand is at a grasp: ``python tools/stuck_joints.py --seed 3 --joint 4 --phase final``.

In `exp1` a joint sticks for 4 s at each grasp, as soon as the hand is in that phase. Prints the contacts that the
robot caused; docs/notebook/faults.md has results.
"""

import argparse

from motm_twin.control.arm.types import Phase
from motm_twin.control.tick import Completion
from motm_twin.methods.registry import find_method
from motm_twin.model.edits import InjectFault
from motm_twin.model.scene_file import load_scene
from motm_twin.twin import Twin

LASTS = 4.0  # [s]


def contacts(method: str, seed: int, joint: int, phase: Phase) -> tuple[list[str], str]:
    """Contacts that the robot caused in a trial with a stuck joint at each grasp, and how it ended."""
    scene = load_scene("exp1", "random", seed)
    twin, finish, grasp = Twin(scene, method=find_method(method)), Completion(), -1
    while True:
        tick = twin.advance()
        finish.add(tick)
        if finish.over or tick.time >= scene.time_limit:
            break
        if tick.arm[-1].phase == phase and tick.task_index != grasp:
            grasp = tick.task_index
            twin.post(InjectFault(fault="joint_stuck", seconds=LASTS, joint=joint))
    assert tick.truth is not None
    caused = [one for one in tick.truth.contacts if one.caused_by_robot]
    lines = [f"{one.body} - {one.other}, {one.time:.2f} s, {1e3 * one.depth:.1f} mm" for one in caused]
    return lines, f"placed {tick.truth.places} in {tick.time:.1f} s"


def main() -> None:
    """Run one trial and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--method", default="fast")
    parser.add_argument("--seed", type=int, default=3)
    parser.add_argument("--joint", type=int, default=4, choices=range(1, 8))
    parser.add_argument("--phase", default=Phase.FINAL, choices=(Phase.FINAL, Phase.CLOSING))
    asked = parser.parse_args()
    lines, end = contacts(asked.method, asked.seed, asked.joint, Phase(asked.phase))
    print("\n".join([*lines, f"{len(lines)} contacts caused, {end}"]))


if __name__ == "__main__":
    main()
