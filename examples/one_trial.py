"""One trial of Experiment 1 by a method of your own and by the paper's: a line for each, in less than half a minute.

python examples/one_trial.py examples/own_base_controller.py:PURSUIT
"""

import argparse

import msgspec

from motm_twin.methods.registry import find_method
from motm_twin.model.scene_file import load_scene
from motm_twin.program import clean_exit
from motm_twin.trial import run_scene


@clean_exit()
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("method", help="a name, or FILE.py:NAME of your own")
    parser.add_argument("--limit", type=float, help="end each trial after this much simulated time [s]")
    options = parser.parse_args(arguments)
    scene = load_scene("exp1")
    if options.limit is not None:
        scene = msgspec.structs.replace(scene, time_limit=options.limit)
    for method in map(find_method, (options.method, "motm")):
        print(f"{method.name + ':':16}", end="", flush=True)
        trial = run_scene(scene, method=method)
        print(f"{trial['places_done']} of {trial['places_total']} placed in {trial['time_s']:.2f} s, "
              f"contacts {trial['contacts_caused_by_robot']} caused of {len(trial['contacts'])}")  # fmt: skip
    print(f"one trial tells little; ten of each: motm-twin bench exp1 --methods motm {options.method}")


if __name__ == "__main__":
    main()
