"""`bench solvers`: its table says of a run that was cut off that it was, and not that it failed."""

import io
import json

from rich.console import Console

from motm_twin.perf.solvers import bench_solvers


def test_a_quick_look_cuts_the_runs_off_and_says_so(tmp_path):
    said = io.StringIO()
    assert bench_solvers(tmp_path, Console(file=said, width=200), quick=True)
    rows = json.loads((tmp_path / "solvers.json").read_text(encoding="utf-8"))["rows"]
    assert all(row["cut_off"] and not row["success"] and row["task_s"] <= 1.0 for row in rows.values())
    assert said.getvalue().count("cut off") == len(rows)
    assert "NO" not in said.getvalue()
