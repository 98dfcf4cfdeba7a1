"""The period of a served twin against the number of pages that look at it: in another process than they are."""

from typing import Any

from motm_twin.bench import page_measures
from motm_twin.bench.page_serve import served
from motm_twin.bench.period import spread

VIEWERS = (0, 1, 5, 20)
SECONDS = 20.0  # of the run, for each number of viewers
NAME = "viewers"


def viewer_rows(seconds: float = SECONDS) -> list[dict[str, Any]]:
    """Serve Experiment 1 and read its page with so many websocket clients; a row of `growth` for each number."""
    rows = []
    with served("exp1") as twin:
        page_measures.periods(twin, 3.0, 0)  # warm
        for viewers in VIEWERS:
            times, rate = page_measures.periods(twin, seconds, viewers)
            rows.append(
                {
                    "count": viewers,
                    "period_ms": spread(times),
                    "stages_ms": {},
                    "kb_per_s_each": round(rate / 1000.0, 1),
                    "factor": 1.0,
                    "success": None,
                }
            )
    return rows
