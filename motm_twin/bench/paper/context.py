"""What the parts of a report are made from: the results, and one watched trial."""

import functools
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from motm_twin.bench.experiments.spec import TrialSpec
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.episode import Episode, watched

EPISODES = "episodes"
EXAMPLE = "cut_ins"  # the measure by which the example of Experiment 2 is chosen


@dataclass
class Context:
    """Results, and where to write."""

    store: Store
    out: Path
    console: Console
    pages: bool = True  # photographs of the page are wanted

    @functools.cached_property
    def episode(self) -> Episode | None:
        """The example of Experiment 2: of the seeds that were run the one with the most cut-ins; None: none was run."""
        found = data.random(self.store.of("exp2", method="motm"))
        found = [result for result in found if data.completed(result)]
        if not found:
            return None
        best = max(found, key=lambda result: (data.measure(result, EXAMPLE) or 0.0, -result["seed"]))
        self.console.print(f"  watching exp2 seed {best['seed']} again, for its figures")
        return watched(TrialSpec("exp2", best["variant"], best["seed"]), self.out / EPISODES)
