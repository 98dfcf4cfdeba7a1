"""Plot the speed of the base while the twin runs: bars in the terminal, or a picture.

python examples/plot_speed.py                             # until Ctrl-C
python examples/plot_speed.py --seconds 20 --save speed.png    # needs matplotlib
"""

import argparse
from contextlib import suppress

from motm_twin.client import connect
from motm_twin.program import clean_exit

WIDTH = 50  # characters
FULL = 0.5  # [m/s]


@clean_exit()
def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--endpoint")
    parser.add_argument("--twin")
    parser.add_argument("--seconds", type=float, help="simulated time to plot")
    parser.add_argument("--save", metavar="PNG", help="write a picture at the end")
    options = parser.parse_args()
    times, speeds = [], []
    with suppress(KeyboardInterrupt), connect(options.endpoint, options.twin) as twin:
        for tick in twin.ticks():
            times.append(tick.time)
            speeds.append(tick.robot.twist[0])
            bar = "#" * round(WIDTH * abs(speeds[-1]) / FULL)
            print(f"{tick.time:7.2f} s {speeds[-1]:6.3f} m/s |{bar:<{WIDTH}}|", flush=True)
            if options.seconds and tick.time - times[0] >= options.seconds:
                break
    if options.save:
        save(options.save, times, speeds)


def save(path, times, speeds):
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(8, 3), layout="constrained")
    axes.plot(times, speeds)
    axes.set(xlabel="time [s]", ylabel="base speed [m/s]")
    axes.grid(alpha=0.3)
    figure.savefig(path)


if __name__ == "__main__":
    main()
