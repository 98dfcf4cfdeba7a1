"""A test rig: load a scene, run it as fast as the machine can, assert what must hold. Exit code 0 or 1.

python examples/test_rig.py exp1 --variant trial1
"""

import argparse
import sys

from motm_twin.client import connect
from motm_twin.program import clean_exit


@clean_exit()
def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene")
    parser.add_argument("--variant")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--places", type=int, help="stop after this many cubes; without it after the last task")
    parser.add_argument("--timeout", type=float, default=600.0)
    parser.add_argument("--endpoint")
    parser.add_argument("--twin")
    options = parser.parse_args()
    with connect(options.endpoint, options.twin, name="test rig") as twin:
        twin.load(options.scene, options.variant, options.seed)
        events = twin.events()
        twin.speed(8.0)
        twin.play()

        def over(tick):
            """The last cube may still fall when the last task is done: the run is over when it has landed."""
            return twin.status().state == "done" or tick.score.places == options.places

        tick = twin.wait_until(over, timeout=options.timeout)
        twin.pause()
        twin.speed(1.0)
        told = []
        while tick.score.places and told.count("placed") < tick.score.places:
            told.append(next(events).kind)
        twin.hand_over()
    caused = [contact for contact in tick.score.contacts if contact.caused_by_robot]
    print(
        f"{tick.score.places} placed after {tick.time:.1f} s, {len(caused)} contacts caused, events: {' '.join(told)}"
    )
    assert not caused, f"the robot touched {caused[0].other}"
    assert tick.score.drops == 0, "it dropped something"
    assert tick.success or tick.score.places == options.places, "not all tasks were done"


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        print(f"failed: {error}", file=sys.stderr)
        sys.exit(1)
