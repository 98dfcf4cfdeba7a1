"""From results to the report: every part drawn and saved, and all of it in one HTML file."""

from collections.abc import Sequence
from pathlib import Path

from motm_twin.bench.paper import cite, differences, goals, html
from motm_twin.bench.paper.context import Context
from motm_twin.bench.paper.html import Section
from motm_twin.bench.paper.origin import COMMAND, MACHINE, PLAN, Origin, now
from motm_twin.bench.paper.part import Drawn, Missing, Part, save, write_json
from motm_twin.bench.paper.parts import PARTS, SECTIONS, made
from motm_twin.record.made_with import SOURCE

FIGURES, REPORT, RESULTS = "figures", "report.html", "results.json"
PART = "part_of_"  # before the names of files that have not everything, so that the whole report stays
TITLE = "Reactive base control for manipulation on the move: the experiments, run again"


def write(context: Context, origin: Origin, command: str, names: Sequence[str], notes: Sequence[str] = ()) -> Path:
    """Draw the named parts, write everything into the folder of the context; the report's path.

    ``origin``: of the trials; ``command``: that draws them now; ``notes``: on the trials, below the title.
    """
    parts: dict[str, Part] = {}
    for source in PARTS:
        if source.name in names:
            parts[source.name] = part = made(source, context)
            if isinstance(part, Drawn):
                save(part, context.out / FIGURES)
            else:
                context.console.print(f"  {part.name}: not made, {part.reason}", markup=False)
    record = cite.record(context.store, origin, command, list(parts.values()))
    prefix = "" if len(parts) == len(PARTS) else PART
    write_json(context.out / f"{prefix}{RESULTS}", record)
    document = html.page(
        TITLE, _lead(record, stale(origin), notes), _sections(context, parts, record), context.out / FIGURES
    )
    target = context.out / f"{prefix}{REPORT}"
    target.write_text(document, encoding="utf-8")
    return target


def stale(origin: Origin) -> list[str]:
    """A warning where the trials are not all of the source that draws them."""
    if origin.current:
        return []
    return [
        f"Warning: the trials were run by source {', '.join(origin.sources)}, this report was drawn by "
        f"{now()[SOURCE]}. The numbers below tell of the former."
    ]


def _lead(record: dict, warnings: Sequence[str], notes: Sequence[str]) -> str:
    failed, drawn = len(record["without_success"]), record["drawn"]
    said = [
        f"motm_twin {record['version']}, source {record['source']}; {record['trials']} trials, {failed} of them "
        f"without success; plan: {record['plan']}; {record['machine']}.",
        *notes,
    ]
    return (
        html.warnings(warnings)
        + html.paragraphs(said)
        + (
            f'<p class="about">The trials were run by <code>{html.text(record["command"])}</code>; drawn '
            f"{drawn['written']} by <code>{html.text(drawn['command'])}</code>, source {drawn['source']}.</p>"
        )
    )


def _sections(context: Context, parts: dict[str, Part], record: dict) -> list[Section]:
    sections = [Section("numbers", "The numbers to reach", body=_numbers(context))]
    for anchor, title in SECTIONS.items():
        these = [parts[source.name] for source in PARTS if source.section == anchor and source.name in parts]
        if these:
            sections.append(Section(anchor, title, these))
    sections.append(Section("differences", "What differs from the paper", body=differences.body()))
    sections.append(Section("failed", "Trials without success", body=_failed(record)))
    sections.append(Section("made", "How this was made, and how to cite it", body=_made(record, parts)))
    return sections


def _numbers(context: Context) -> str:
    rows = goals.table(context.store)
    said = "motm is the paper's method, fast our own. A verdict needs 50 trials; with fewer it says 'so far'."
    return (
        html.paragraphs([said])
        + html.table(goals.HEADER, rows)
        + html.paragraphs(goals.missed(rows))
        + '<p class="about">Fifty trials of each: <code>'
        + html.text(context.command(plan="full"))
        + "</code>; one of them: <code>motm-twin run SCENE --variant random --seed N --method METHOD</code>.</p>"
    )


def _failed(record: dict) -> str:
    failed = record["without_success"]
    if not failed:
        return "<p>None.</p>"
    rows = [
        (
            each["experiment"],
            f"{each['scene']}/{each['variant']}",
            str(each["seed"]),
            each["method"],
            ", ".join(f"{key} = {value}" for key, value in {**each["parameters"], **each["changes"]}.items()) or "-",
            each["reason"],
        )
        for each in failed
    ]
    note = (
        "None is dropped: means of times are over completed trials, and the number of the others stands beside them. "
        "Each has "
        "its session in EXPERIMENT/sessions, which motm-twin rerun repeats."
    )
    return html.paragraphs([note]) + html.table(("Experiment", "Scene", "Seed", "Method", "Changed", "Reason"), rows)


def _made(record: dict, parts: dict[str, Part]) -> str:
    drawn = record["drawn"]
    ran = {**record["made_with"], **{name: record[name] for name in (MACHINE, PLAN, COMMAND)}}
    rows = [(name, str(value), str(drawn.get(name, "-"))) for name, value in ran.items()]
    experiments = [
        (name, str(each["trials"]), ", ".join(each["methods"]), ", ".join(each["scenes"]), _range(each["seeds"]))
        for name, each in record["experiments"].items()
    ]
    missing = [part.title for part in parts.values() if isinstance(part, Missing)]
    said = [
        "Cite the version, the source hash, the command, and the machine: results.json beside this file has them "
        "with all "
        "parameters and seeds, and EXPERIMENT/results.jsonl has every trial. The same source, seeds and versions of "
        "the numeric "
        "libraries give the same trials, bit for bit.",
    ]
    if missing:
        said.append(f"Not in this report: {', '.join(missing)}.")
    header = ("Experiment", "Trials", "Methods", "Scenes", "Seeds")
    return (
        html.paragraphs(said)
        + html.table(header, experiments)
        + html.table(("What", "Ran the trials", "Drew this"), rows)
    )


def _range(seeds: list[int]) -> str:
    whole = seeds == list(range(seeds[0], seeds[-1] + 1)) if seeds else False
    return f"{seeds[0]} to {seeds[-1]}" if whole and len(seeds) > 2 else ", ".join(map(str, seeds))
