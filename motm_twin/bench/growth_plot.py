"""The picture of how the period grows."""

from pathlib import Path
from typing import Any

PERIOD_MS = 50.0


def plot(found: dict[str, list[dict[str, Any]]], units: dict[str, str], target: Path) -> None:
    """One panel per respect, p50 and p99 [ms] against how much of it, both logarithmic, with a line that is linear."""
    import matplotlib as mpl

    mpl.use("Agg")
    from matplotlib import pyplot as plt

    names = [name for name, rows in found.items() if len(rows) > 1]
    columns = 3
    figure, axes = plt.subplots(
        -(-len(names) // columns), columns, figsize=(11, 3.2 * -(-len(names) // columns)), squeeze=False
    )
    for axis in axes.flat[len(names) :]:
        axis.set_axis_off()
    for axis, name in zip(axes.flat, names, strict=False):
        rows = [row for row in found[name] if row["count"] > 0]  # no viewer is not on a logarithmic axis
        counts = [row["count"] for row in rows]
        for part, style in (("p50", "o-"), ("p99", "s-")):
            axis.plot(counts, [row["period_ms"][part] for row in rows], style, label=part)
        first = rows[0]["period_ms"]["p99"]
        axis.plot(counts, [first * count / counts[0] for count in counts], ":", color="grey", label="linear")
        axis.axhline(PERIOD_MS, color="firebrick", linewidth=0.8)
        axis.set(xscale="log", yscale="log", ylim=(1.0, 200.0), title=name)
        axis.set_xlabel(f"[{units[name]}]" if units[name] else "")
        axis.set_xticks(counts, [f"{count:g}" for count in counts], minor=False)
        axis.minorticks_off()
        axis.grid(alpha=0.3)
    axes[0, 0].legend(fontsize=8)
    for row in axes:
        row[0].set_ylabel("period [ms]")
    figure.tight_layout()
    target.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(target, dpi=110)
    plt.close(figure)
