"""What the parts of a report are made from: the results, and one watched trial."""

import functools
import shlex
from dataclasses import dataclass
from pathlib import Path

from rich.console import Console

from motm_twin.bench.experiments.spec import TrialSpec
from motm_twin.bench.paper import data
from motm_twin.bench.paper.data import Store
from motm_twin.bench.paper.episode import Episode, watched
from motm_twin.bench.paper.plan import PLANS
from motm_twin.record.made_with import SOURCE, made_with

EPISODES = "episodes"
EXAMPLE = "cut_ins"  # the measure by which the example of Experiment 2 is chosen
OPTIONS = {"quick": " --quick", "default": "", "full": " --full --yes"}  # of `motm-twin paper`, by plan


@dataclass
class Context:
    """Results, where they come from, and where to write."""

    store: Store
    out: Path
    console: Console
    pages: bool = True  # photographs of the page are wanted
    plan: str = "default"  # that ran the trials
    sources: tuple[str, ...] = ()  # of the trials; (): as it is now

    def command(self, name: str = "", *, plan: str = "") -> str:
        """What makes this report, or only a part of it; ``plan``: another one than that of its trials."""
        only = f" --only {name}" if name else ""
        return f"motm-twin paper{OPTIONS[plan or self.plan]} --out {shlex.quote(str(self.out))}{only}"

    @property
    def larger(self) -> str:
        """The next larger plan."""
        names = list(PLANS)
        return names[min(names.index(self.plan) + 1, len(names) - 1)]

    @functools.cached_property
    def episode(self) -> Episode | None:
        """The example of Experiment 2: of the seeds that were run the one with the most cut-ins; None: none was run."""
        found = data.random(self.store.of("exp2", method="motm"))
        found = [result for result in found if data.completed(result)]
        if not found:
            return None
        best = max(found, key=lambda result: (data.measure(result, EXAMPLE) or 0.0, -result["seed"]))
        self.console.print(f"  watching exp2 seed {best['seed']} again, for its figures")
        spec = TrialSpec("exp2", best["variant"], best["seed"], best["method"])
        source = self.sources[0] if len(self.sources) == 1 else made_with()[SOURCE]
        return watched(spec, self.out / EPISODES, source)
