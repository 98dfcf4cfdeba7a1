"""Run a trial, read its Ticks, and see where the time goes.

python examples/first_run.py                              # Experiment 1, its first trial
python examples/first_run.py exp2 --seed 7 --method staa --save where.png
"""

import argparse
from collections import Counter

import msgspec

from motm_twin.control.loop import PERIOD
from motm_twin.methods import DEFAULT_METHOD
from motm_twin.methods.registry import find_method
from motm_twin.model.scene_file import load_scene
from motm_twin.program import clean_exit
from motm_twin.trial import run_scene

PARTS = ("driving", "turning", "standing")
MOVING, TURNING = 0.03, 0.05  # [m/s], [rad/s] above which the base moves


def what_the_base_does(tick):
    v, w = tick.observation.twist
    if abs(v) > MOVING:
        return "driving"
    return "turning" if abs(w) > TURNING else "standing"


@clean_exit()
def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scene", nargs="?", default="exp1")
    parser.add_argument("--variant")
    parser.add_argument("--seed", type=int)
    parser.add_argument("--method", default=DEFAULT_METHOD)
    parser.add_argument("--limit", type=float, help="end after this much simulated time [s]")
    parser.add_argument("--save", metavar="PNG", help="draw it")
    options = parser.parse_args()
    scene = load_scene(options.scene, options.variant, options.seed)
    if options.limit is not None:
        scene = msgspec.structs.replace(scene, time_limit=options.limit)

    spent = {}  # task: what the base does: periods
    while_closing = []  # base speed [m/s] while the fingers close

    def read(tick):
        """Called with every Tick: the whole record of a period, which nobody may change."""
        for event in tick.events:
            print(f"{event.time:6.2f} s  {event.text}")
        if tick.done:
            return
        task = tick.tasks[tick.task_index]
        spent.setdefault(f"{task.kind} {task.target}", Counter())[what_the_base_does(tick)] += 1
        if tick.arm[-1].phase == "closing":
            while_closing.append(abs(tick.observation.twist[0]))

    result = run_scene(scene, method=find_method(options.method), on_tick=read)
    print(f"\n{'time [s] for':24}" + "".join(f"{part:>10}" for part in PARTS))
    for task, periods in spent.items():
        print(f"{task:24}" + "".join(f"{PERIOD * periods[part]:10.1f}" for part in PARTS))
    if while_closing:
        print(f"\nbase speed while the fingers close: {sum(while_closing) / len(while_closing):.2f} m/s")
    print(f"{result['places_done']} of {result['places_total']} placed in {result['time_s']:.1f} s")
    if options.save:
        save(options.save, spent)


def save(path, spent):
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 0.5 + 0.35 * len(spent)), layout="constrained")
    begin = [0.0] * len(spent)
    for part, grey in zip(PARTS, ("0.75", "0.45", "0.1"), strict=True):
        seconds = [PERIOD * periods[part] for periods in spent.values()]
        axes.barh(list(spent), seconds, left=begin, color=grey, label=part)
        begin = [left + width for left, width in zip(begin, seconds, strict=True)]
    axes.invert_yaxis()
    axes.set_xlabel("time [s]")
    axes.legend(frameon=False)
    figure.savefig(path)


if __name__ == "__main__":
    main()
