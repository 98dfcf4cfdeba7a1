"""Compare two methods on the same trials: the difference by seed, with its 95 % interval.

python examples/compare_two_controllers.py                                     # motm and staa, five arrangements
python examples/compare_two_controllers.py motm examples/own_base_controller.py:PURSUIT --scene exp1a --trials 20

What has been run already is read from --out, so more trials can be added at any time.
"""

import argparse
from pathlib import Path

from rich.console import Console

from motm_twin.model.scene_file import listing, load_document
from motm_twin.program import clean_exit
from motm_twin.studies.run import run
from motm_twin.studies.spec import Experiment, TrialSpec
from motm_twin.studies.statistics import paired_difference, proportion


def arrangement_of(scene):
    """Random arrangements where the scene has them, else its default variant."""
    return "random" if "random" in listing(load_document(scene)).variants else None


@clean_exit()
def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("methods", nargs="*", default=["motm", "staa"], help="two names, or FILE.py:NAME of your own")
    parser.add_argument("--scene", default="exp1")
    parser.add_argument("--variant", help="default: random arrangements, where the scene has them")
    parser.add_argument("--trials", type=int, default=5)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--limit", type=float, help="end each trial after this much simulated time [s]")
    parser.add_argument("--out", type=Path, default=Path("out/compare"))
    options = parser.parse_args(arguments)
    if len(options.methods) != 2:
        parser.error("name two methods")
    if options.trials < 1 or options.workers < 1:
        parser.error("at least one trial and one worker are needed")
    if options.limit is not None and not 0.0 < options.limit < float("inf"):
        parser.error(f"--limit {options.limit:g}: give a time above 0 s")
    variant = options.variant or arrangement_of(options.scene)
    changes = {} if options.limit is None else {"time_limit": options.limit}
    specs = tuple(
        TrialSpec(options.scene, variant, seed, method=method, changes=changes)
        for seed in range(options.trials)
        for method in options.methods
    )
    experiment = Experiment("compare", f"{' and '.join(options.methods)} on {options.scene}", specs)
    results = run(experiment, out=options.out, workers=options.workers, console=Console())

    one, other = ({r["seed"]: r for r in results.of("compare", method=method)} for method in options.methods)
    for method, trials in zip(options.methods, (one, other), strict=True):
        placed, asked = (sum(trial[key] for trial in trials.values()) for key in ("places_done", "places_total"))
        succeeded = proportion(sum(trial["success"] for trial in trials.values()), len(trials))
        print(f"{method}: {placed} of {asked} placed, success {100 * succeeded.value:.0f} % "
              f"[{100 * succeeded.low:.0f}, {100 * succeeded.high:.0f}]")  # fmt: skip
    both = [seed for seed in one if one[seed]["success"] and other[seed]["success"]]
    if not both:
        print("no trial in which both succeeded: there are no times to compare")
        return
    times = [{seed: trials[seed]["time_s"] for seed in both} for trials in (one, other)]
    difference = paired_difference(times[1], times[0])
    for seed in both:
        print(f"seed {seed:3}: {times[0][seed]:6.1f} s and {times[1][seed]:6.1f} s")
    print(f"{options.methods[1]} takes {difference.text()} s longer than {options.methods[0]} ({len(both)} seeds)")


if __name__ == "__main__":
    main()
