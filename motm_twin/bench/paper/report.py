"""From results to the report: every part drawn and saved, and all of it in one HTML file."""

from collections.abc import Sequence
from pathlib import Path

from motm_twin.bench.paper import cite, differences, goals, html
from motm_twin.bench.paper.context import Context
from motm_twin.bench.paper.html import Section
from motm_twin.bench.paper.part import Drawn, Missing, Part, save, write_json
from motm_twin.bench.paper.parts import PARTS, SECTIONS
from motm_twin.bench.paper.plan import Plan

FIGURES, REPORT, RESULTS = "figures", "report.html", "results.json"
PART = "part_of_"  # before the names of files that have not everything, so that the whole report stays
TITLE = "Reactive base control for manipulation on the move: the experiments, run again"


def write(context: Context, plan: Plan, command: str, names: Sequence[str], sources: Sequence[str]) -> Path:
    """Draw the named parts, write everything into the folder of the context; the report's path."""
    parts: dict[str, Part] = {}
    for source in PARTS:
        if source.name in names:
            parts[source.name] = part = source.make(context)
            if isinstance(part, Drawn):
                save(part, context.out / FIGURES)
            else:
                context.console.print(f"  {part.name}: not made, {part.reason}", markup=False)
    record = cite.record(context.store, plan.name, command, sources, list(parts.values()))
    prefix = "" if len(parts) == len(PARTS) else PART
    write_json(context.out / f"{prefix}{RESULTS}", record)
    document = html.page(TITLE, _lead(record, plan), _sections(context, plan, parts, record), context.out / FIGURES)
    target = context.out / f"{prefix}{REPORT}"
    target.write_text(document, encoding="utf-8")
    return target


def _lead(record: dict, plan: Plan) -> str:
    failed = len(record["without_success"])
    said = [
        f"motm_twin {record['version']}, source {record['source']}; {record['trials']} trials, {failed} of them "
        "without success; "
        f"{record['machine']}; written {record['written']}.",
        *plan.notes,
    ]
    return html.paragraphs(said) + f'<p class="about">Made by <code>{html.text(record["command"])}</code></p>'


def _sections(context: Context, plan: Plan, parts: dict[str, Part], record: dict) -> list[Section]:
    sections = [Section("numbers", "The numbers to reach", body=_numbers(context))]
    for anchor, title in SECTIONS.items():
        these = [parts[source.name] for source in PARTS if source.section == anchor and source.name in parts]
        if these:
            sections.append(Section(anchor, title, these))
    sections.append(Section("differences", "What differs from the paper", body=differences.body()))
    sections.append(Section("failed", "Trials without success", body=_failed(record)))
    sections.append(Section("made", "How this was made, and how to cite it", body=_made(record, plan, parts)))
    return sections


def _numbers(context: Context) -> str:
    rows = goals.table(context.store)
    return html.paragraphs(
        [
            "motm is the paper's method, fast our own. A verdict needs 50 trials; with fewer it says 'so far'. "
            "Command: motm-twin paper --full; a single trial: motm-twin run SCENE --variant random --seed N."
        ]
    ) + html.table(goals.HEADER, rows)


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


def _made(record: dict, plan: Plan, parts: dict[str, Part]) -> str:
    rows = [(name, str(value)) for name, value in record["made_with"].items()]
    rows.append(("machine", record["machine"]))
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
    if plan.absent:
        said.append(f"Wanted, but not among the methods: {', '.join(plan.absent)}.")
    if len(record["sources_of_trials"]) > 1:
        said.append(
            f"The trials come from more than one state of the source: {', '.join(record['sources_of_trials'])}."
        )
    if missing:
        said.append(f"Not in this report: {', '.join(missing)}.")
    header = ("Experiment", "Trials", "Methods", "Scenes", "Seeds")
    return html.paragraphs(said) + html.table(header, experiments) + html.table(("What", "Version"), rows)


def _range(seeds: list[int]) -> str:
    whole = seeds == list(range(seeds[0], seeds[-1] + 1)) if seeds else False
    return f"{seeds[0]} to {seeds[-1]}" if whole and len(seeds) > 2 else ", ".join(map(str, seeds))
