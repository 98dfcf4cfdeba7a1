"""`sequential` with other weights of manipulability: how strong a rival is hangs on numbers that are not published.

motm-twin bench exp1 --methods sequential examples/sequential_weights.py:W0 examples/sequential_weights.py:W2

W0 to W40 are for weights of 0 to 40 s; `sequential` has `StationaryParameters.manipulability_weight`. EARLY2 and
EARLY10 are the same for `sequential_overlap`, whose arm moves while the base arrives.
"""

import dataclasses
from functools import partial

from motm_twin.methods.method import BaseChoices
from motm_twin.rivals.stationary import ALL_TERMS, SEQUENTIAL, SEQUENTIAL_OVERLAP, parking, stationary
from motm_twin.rivals.stationary_placement import StationaryParameters


def weighing(seconds, method=SEQUENTIAL):
    """The method, with a pose without manipulability costing so many seconds more than the best one."""
    parameters = StationaryParameters(manipulability_weight=seconds)
    controller = partial(parking, overlap=method is SEQUENTIAL_OVERLAP, parameters=parameters)
    return dataclasses.replace(
        method,
        name=f"{method.name}_{seconds:g}s",
        title=f"{method.title}, {seconds:g} s",
        planner=BaseChoices(placement=stationary(ALL_TERMS, parameters=parameters), controller=controller),
    )


W0, W1, W2, W10, W20, W40 = (weighing(seconds) for seconds in (0.0, 1.0, 2.0, 10.0, 20.0, 40.0))
EARLY2, EARLY10 = (weighing(seconds, SEQUENTIAL_OVERLAP) for seconds in (2.0, 10.0))

if __name__ == "__main__":
    print(__doc__)
